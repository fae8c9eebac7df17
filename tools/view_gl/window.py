"""The interactive window: glfw's events in, pictures out. What they do is in controls.py."""

from __future__ import annotations

import sys
from ctypes import c_void_p, cast
from pathlib import Path
from time import monotonic
from typing import Any

import glfw
import moderngl

from . import offscreen
from .controls import FLIGHT, HELP, Controls
from .frame import Frame
from .screen import Screen
from .session import Session

LONGEST_STEP = 0.1  # seconds: after a slow frame a flight goes on where it was
READING = 0.01  # seconds between frames that only wait for the reader
SHIFTS = (glfw.KEY_LEFT_SHIFT, glfw.KEY_RIGHT_SHIFT)
NAMED = {  # the rest is named by what is printed on the key
    glfw.KEY_SPACE: "space",
    glfw.KEY_1: "1",
    glfw.KEY_2: "2",
    glfw.KEY_4: "4",
    glfw.KEY_8: "8",
    glfw.KEY_KP_ADD: "+",
    glfw.KEY_KP_SUBTRACT: "-",
}
PLACES = {
    key: getattr(glfw, f"KEY_{key.upper()}") for key in FLIGHT
}  # where they are on a US keyboard


class CurrentContext:
    """Where moderngl finds OpenGL's functions: in the window's context, of X11 or Wayland alike."""

    def load_opengl_function(self, name: str) -> int:
        """The address of a function, 0 where there is none."""
        return cast(glfw.get_proc_address(name), c_void_p).value or 0

    def __enter__(self) -> CurrentContext:
        return self

    def __exit__(self, *_: object) -> None:
        """The context stays current: there is no other one."""

    def release(self) -> None:
        """glfw does that."""


class Window:
    """A window on a session, until it is closed.

    size : pixels; tint : colour by level
    errors : NoOpenGLError
    """

    def __init__(self, session: Session, size: tuple[int, int], *, tint: bool = False) -> None:
        self._session = session
        self._handle = _open(size, _name(session))
        try:
            # Its annotation has the settings as dict[str, Any]: each keyword is one.
            context = moderngl.create_context(require=450, context=CurrentContext())  # type: ignore[arg-type]
            shown = glfw.get_framebuffer_size(self._handle)
            self._renderer = session.renderer(context, shown, tint=tint)
            self._screen = Screen(context)
        except BaseException:
            glfw.terminate()
            raise
        size = glfw.get_window_size(self._handle)
        most = context.max_samples
        self._controls = Controls(self._renderer, session.camera, size, most, levels=tint)
        self._changed = True
        self._pointer = (0.0, 0.0)
        glfw.set_key_callback(self._handle, self._on_key)
        glfw.set_cursor_pos_callback(self._handle, self._on_pointer)
        glfw.set_scroll_callback(self._handle, self._on_wheel)
        glfw.set_framebuffer_size_callback(self._handle, self._on_size)
        glfw.set_window_refresh_callback(self._handle, self._on_refresh)

    def run(self, frames: int = 0) -> None:
        """Show it until it is closed, or for so many frames."""
        try:
            self._loop(frames)
        finally:
            self._renderer.close()
            glfw.terminate()

    def _loop(self, frames: int) -> None:
        still, drawn, before = False, 0, monotonic()
        while not glfw.window_should_close(self._handle) and not 0 < frames <= drawn:
            now = monotonic()
            self._fly(min(now - before, LONGEST_STEP))
            before = now
            if still and not self._changed and not frames:
                glfw.wait_events()  # a picture that nothing changes costs nothing
                before = monotonic()
                continue
            self._changed = False
            frame = self._renderer.frame(self._controls.camera)
            self._show(frame)
            still, drawn = frame.converged, drawn + 1
            if frame.wanted and not frame.uploaded:
                glfw.wait_events_timeout(READING)
            else:
                glfw.poll_events()

    def _show(self, frame: Frame) -> None:
        self._screen.show(self._renderer.target, HELP if self._controls.help else "")
        glfw.swap_buffers(self._handle)
        read = self._session.file.source.bytes / (1 << 20)
        error = f"{frame.pixel_error:.3g}"
        parts = [_name(self._session), f"{frame.voxels:,} voxels", f"{read:.1f} MiB read"]
        parts.append(f"voxels of {error} pixels, {self._renderer.target.samples} samples")
        parts.append(
            "paused" if self._renderer.paused else "loading" if frame.wanted else "H: keys"
        )
        glfw.set_window_title(self._handle, " · ".join(parts))

    def _fly(self, seconds: float) -> None:
        held = {key for key, place in PLACES.items() if self._down(place)}
        if held and not self._control():
            self._controls.fly(held, seconds, fast=self._shift())
            self._changed = True

    def _on_key(self, _: Any, key: int, scancode: int, action: int, mods: int) -> None:
        if action == glfw.RELEASE:
            return
        name = NAMED.get(key) or glfw.get_key_name(key, scancode) or ""
        if key == glfw.KEY_ESCAPE:
            glfw.set_window_should_close(self._handle, True)
        elif key == glfw.KEY_F12 or (name == "s" and mods & glfw.MOD_CONTROL):
            self._save()
        elif key in PLACES.values():
            self._changed = True
        elif (action == glfw.PRESS or name in "+=-") and not mods & glfw.MOD_CONTROL:
            self._changed |= self._controls.press(name)

    def _on_pointer(self, _: Any, x: float, y: float) -> None:
        right, down = x - self._pointer[0], y - self._pointer[1]
        self._pointer = x, y
        turning = glfw.get_mouse_button(self._handle, glfw.MOUSE_BUTTON_LEFT) == glfw.PRESS
        shifting = glfw.get_mouse_button(self._handle, glfw.MOUSE_BUTTON_RIGHT) == glfw.PRESS
        if shifting or (turning and self._shift()):
            self._controls.shift(right, down)
        elif turning:
            self._controls.turn(right, down)
        self._changed |= turning or shifting

    def _on_wheel(self, _: Any, __: float, notches: float) -> None:
        self._controls.wheel(notches)
        self._changed = True

    def _on_size(self, _: Any, width: int, height: int) -> None:
        if width and height:  # not while it is an icon
            self._renderer.resize((width, height))
            self._controls.size = glfw.get_window_size(self._handle)
            self._changed = True

    def _on_refresh(self, _: Any) -> None:
        self._changed = True

    def _down(self, key: int) -> bool:
        return bool(glfw.get_key(self._handle, key) == glfw.PRESS)

    def _shift(self) -> bool:
        return any(self._down(key) for key in SHIFTS)

    def _control(self) -> bool:
        return self._down(glfw.KEY_LEFT_CONTROL) or self._down(glfw.KEY_RIGHT_CONTROL)

    def _save(self) -> None:
        """Write the picture, without the list of keys, under a new name in the current folder."""
        stem = Path(_name(self._session)).stem
        number = 1
        while (path := Path(f"{stem}-{number:04d}.png")).exists():
            number += 1
        offscreen.save(self._renderer.picture(), path)
        print(f"view_gl: {path}", file=sys.stderr)


def _open(size: tuple[int, int], title: str) -> Any:
    glfw.ERROR_REPORTING = "ignore"  # what goes wrong is said here, in one line
    if not glfw.init():
        raise offscreen.NoOpenGLError(f"no window: {_why()}; is there a display? or --offscreen")
    hints = {
        glfw.CONTEXT_VERSION_MAJOR: 4,
        glfw.CONTEXT_VERSION_MINOR: 5,
        glfw.OPENGL_PROFILE: glfw.OPENGL_CORE_PROFILE,
        glfw.DEPTH_BITS: 0,  # the renderer has its own
        glfw.STENCIL_BITS: 0,
        glfw.SAMPLES: 0,
    }
    for hint, value in hints.items():
        glfw.window_hint(hint, value)
    handle = glfw.create_window(*size, title, None, None)
    if not handle:
        said = _why()
        glfw.terminate()
        raise offscreen.NoOpenGLError(f"no window with OpenGL 4.5: {said}; try --offscreen")
    glfw.make_context_current(handle)
    glfw.swap_interval(1)
    return handle


def _why() -> str:
    said: Any = glfw.get_error()[1]  # bytes or None
    return " ".join((said or b"glfw says nothing").decode(errors="replace").split())


def _name(session: Session) -> str:
    return session.file.source.name.rsplit("/", 1)[-1]
