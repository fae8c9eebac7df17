"""What keys and the mouse do: camera, and a renderer's switches. Nothing here knows a window."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass
from math import radians, tan

import numpy as np

from .camera import Camera
from .frame import Renderer
from .session import refit

TURN = 0.4  # degrees for each pixel of a drag
STEP = 1.15  # of a notch of the wheel: that much nearer
ERROR_STEP = 2**0.5
LEAST_ERROR, MOST_ERROR = 0.25, 64.0  # pixels
SPEED = 0.7  # distances to the target in a second
FAST = 4.0

HELP = """\
left drag           turn about the target
right, shift drag   shift the picture
wheel               nearer, farther
W A S D Q E         fly, with shift faster
F                   fit the whole object
1 2 4 8             samples of a pixel
L                   colour by level
O                   skip what is hidden
P                   closed, or holes while loading
+ -                 pixel error
space               stop and go on loading
F12, ctrl S         write a picture
H                   this list
Esc                 end"""

FLIGHT = {  # right, up, forward
    "w": (0, 0, 1),
    "s": (0, 0, -1),
    "a": (-1, 0, 0),
    "d": (1, 0, 0),
    "q": (0, -1, 0),
    "e": (0, 1, 0),
}


@dataclass(slots=True)
class Controls:
    """The state that a user changes."""

    renderer: Renderer
    camera: Camera
    size: tuple[int, int]  # of the window
    most_samples: int  # of a pixel, that the driver has
    levels: bool = False  # colour by level
    help: bool = False

    def turn(self, right: float, down: float) -> None:
        """The object follows a drag of so many pixels."""
        self.camera = self.camera.orbit(-TURN * right, TURN * down)

    def shift(self, right: float, down: float) -> None:
        """What is at the target's distance stays below the pointer."""
        camera = self.camera
        shown = camera.height or 2 * self._distance * tan(radians(camera.fov) / 2)
        pixel = shown / self.size[1]
        self.camera = camera.move(-right * pixel, down * pixel, 0.0)

    def wheel(self, notches: float) -> None:
        """Towards the target."""
        self.camera = self.camera.zoom(STEP**notches)

    def fly(self, held: Set[str], seconds: float, *, fast: bool) -> None:
        """Move while keys of FLIGHT are held."""
        way = np.sum([FLIGHT[key] for key in held], axis=0) * self._distance * SPEED * seconds
        self.camera = self.camera.move(*(way * (FAST if fast else 1.0)).tolist())

    def press(self, key: str) -> bool:
        """A key of HELP that is a switch; whether there is such a one."""
        renderer = self.renderer
        match key:
            case "f":
                self.camera = refit(self.camera, renderer.file.box, self.size[0] / self.size[1])
            case "1" | "2" | "4" | "8" if self._least_samples <= int(key) <= self.most_samples:
                renderer.resize(renderer.target.size, int(key))
            case "l":
                self.levels = not self.levels
                renderer.tint(self.levels)
            case "o":
                renderer.occlusion ^= "occlusion" in renderer.resolution.effects
            case "p":
                renderer.closed = not renderer.closed
            case "+" | "=":
                self._set_error(renderer.pixel_error * ERROR_STEP)
            case "-":
                self._set_error(renderer.pixel_error / ERROR_STEP)
            case "space":
                renderer.paused = not renderer.paused
            case "h":
                self.help = not self.help
            case _:
                return False
        return True

    def _set_error(self, pixels: float) -> None:
        self.renderer.pixel_error = min(max(pixels, LEAST_ERROR), MOST_ERROR)

    @property
    def _least_samples(self) -> int:
        """SRAA's programs draw voxels' numbers, which one sample has no use for."""
        return 2 if "sraa" in self.renderer.resolution.effects else 1

    @property
    def _distance(self) -> float:
        return float(np.linalg.norm(np.subtract(self.camera.position, self.camera.target)))
