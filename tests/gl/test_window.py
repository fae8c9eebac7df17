"""The window as a user handles it: real keys and mouse events in a virtual display, screenshots."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from display import need_opengl, virtual_display
from PIL import Image, ImageGrab

SIZE = (320, 240)
BACKGROUND = 26  # 0.1 of 255, all three
HANGS = 120.0  # seconds, after which nothing comes any more


class Viewer:
    """A viewer's process and its window in a display that has no other one."""

    def __init__(self, display, path, folder, *options):
        self.display, self.folder = display, folder
        self.environment = {**os.environ, "DISPLAY": display}
        self.environment.pop("WAYLAND_DISPLAY", None)
        size = "x".join(map(str, SIZE))
        command = [sys.executable, "-m", "gstream_tools.view_gl", path, "--size", size, *options]
        self.process = subprocess.Popen(
            command, cwd=folder, env=self.environment, stderr=subprocess.PIPE, text=True
        )
        self.window = self.until(self.find, "a window")
        self.until(lambda: "voxels" in self.title(), "a title")
        self.do("windowfocus", "--sync", self.window)

    def do(self, *arguments):
        command = ["xdotool", *map(str, arguments)]
        done = subprocess.run(
            command, env=self.environment, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    def find(self):
        return self.do("search", "--onlyvisible", "--pid", self.process.pid)

    def until(self, found, what):
        """Wait for something true, and return it."""
        end = time.monotonic() + HANGS
        while not (value := found()):
            assert self.process.poll() is None, self.process.stderr.read()
            assert time.monotonic() < end, f"{what} did not come: {self.title()}"
            time.sleep(0.1)
        return value

    def title(self):
        return self.do("getwindowname", self.window)

    def cpu_seconds(self):
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def picture(self, size=SIZE):
        """(height, width, 3) what the window shows once it does no more."""

        def still():
            before = self.cpu_seconds()
            time.sleep(0.6)
            return self.cpu_seconds() == before

        self.until(still, "a still picture")
        return np.asarray(ImageGrab.grab(xdisplay=self.display).convert("RGB"))[
            : size[1], : size[0]
        ]

    def drag(self, button, start, end):
        self.do("mousemove", "--window", self.window, *start, "mousedown", button)
        self.do("mousemove", "--window", self.window, *end, "mouseup", button)

    def end(self):
        """Esc; the exit status, and what was said on stderr."""
        self.do("key", "Escape")
        said = self.process.communicate(timeout=HANGS)[1]
        return self.process.returncode, said


@pytest.fixture(scope="module")
def display():
    need_opengl()
    with virtual_display() as name:
        yield name


@pytest.fixture
def viewer(display, torus, tmp_path):
    started = []

    def start(*options):
        started.append(Viewer(display, torus.path, tmp_path, *options))
        return started[-1]

    yield start
    for one in started:
        one.process.kill()
        one.process.communicate()


def covered(picture):
    return (picture != BACKGROUND).any(axis=-1)


def centre(picture):
    """(x, y) of what is not background."""
    y, x = np.nonzero(covered(picture))
    return np.array([x.mean(), y.mean()])


def test_the_object_is_in_the_window_and_esc_ends_it_with_status_0(viewer):
    window = viewer("--pixel-error", "3")
    picture = window.picture()
    assert 0.1 < covered(picture).mean() < 0.8
    assert (picture[[0, 0, -1, -1], [0, -1, 0, -1]] == BACKGROUND).all()
    name, voxels, *_ = window.title().split(" · ")
    assert name == "torus.gsb"
    assert int(voxels.split()[0].replace(",", "")) > 1000
    assert window.end() == (0, "")


def test_esc_while_it_loads_ends_it_with_status_0(viewer):
    assert viewer("--pixel-error", "0.5").end() == (0, "")


def test_a_left_drag_turns_and_f_keeps_the_turn_but_fits_again(viewer):
    window = viewer("--pixel-error", "3")
    before = window.picture()
    window.drag(1, (100, 100), (160, 110))
    turned = window.picture()
    assert (covered(turned) != covered(before)).mean() > 0.01
    window.do("click", 4, "click", 4, "click", 4)  # the wheel, away from the user
    near = window.picture()
    assert covered(near).sum() > 1.8 * covered(turned).sum()
    window.do("key", "f")
    np.testing.assert_allclose(centre(window.picture()), centre(turned), atol=1)


@pytest.mark.parametrize("shift", [True, False], ids=["shift and left", "right"])
def test_a_shifted_object_stays_below_the_pointer(viewer, shift):
    window = viewer("--pixel-error", "3")
    before = centre(window.picture())
    if shift:
        window.do("keydown", "shift")
    window.drag(1 if shift else 3, (100, 100), (130, 85))
    if shift:
        window.do("keyup", "shift")
    # What is nearer than the target moves by more, and weighs more.
    np.testing.assert_allclose(centre(window.picture()) - before, (30, -15), rtol=0.15)


def test_flying_forwards_goes_on_while_the_key_is_down(viewer):
    window = viewer("--pixel-error", "3")
    before = covered(window.picture()).sum()
    window.do("keydown", "w")
    time.sleep(1)
    window.do("keyup", "w")
    first = covered(window.picture())
    assert first.sum() > 1.1 * before
    assert (covered(window.picture()) == first).all()


def test_h_shows_the_keys_and_hides_them(viewer):
    window = viewer("--pixel-error", "3")
    before = window.picture()
    window.do("key", "h")
    text = window.picture()
    bright = (text.min(axis=-1) > 200) & (before.max(axis=-1) == BACKGROUND)
    assert bright.sum() > 300  # letters where there was background
    window.do("key", "h")
    np.testing.assert_array_equal(window.picture(), before)


def test_keys_change_samples_error_colours_and_pause(viewer):
    window = viewer("--pixel-error", "2", "--samples", "2")
    grey = window.picture().astype(int)
    assert np.ptp(grey, axis=-1).max() == 0
    assert "voxels of 2 pixels, 2 samples" in window.title()
    window.do("key", "1")
    window.until(lambda: "voxels of 2 pixels, 1 samples" in window.title(), "one sample")
    window.do("key", "plus", "key", "plus")
    window.until(lambda: "voxels of 4 pixels" in window.title(), "a larger error")
    window.do("key", "l")
    assert np.ptp(window.picture().astype(int), axis=-1).max() > 60
    window.do("key", "space")
    window.until(lambda: window.title().endswith("paused"), "a pause")
    window.do("key", "space")
    window.until(lambda: window.title().endswith("H: keys"), "no pause")


def test_f12_writes_what_the_window_shows_without_the_keys_over_it(viewer, tmp_path):
    window = viewer("--pixel-error", "3")
    before = window.picture()
    window.do("key", "h")
    window.picture()
    window.do("key", "F12")
    window.do("key", "ctrl+s")
    window.until((tmp_path / "torus-0002.png").exists, "a second picture")
    for name in ("torus-0001.png", "torus-0002.png"):
        np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / name)), before)
    said = "".join(f"view_gl: torus-000{number}.png\n" for number in (1, 2))
    assert window.end() == (0, said)


def test_a_resized_window_is_filled(viewer):
    window = viewer("--pixel-error", "3")
    before = window.picture()
    window.do("windowsize", "--sync", window.window, 500, 400)
    window.do("key", "f")
    picture = window.picture((500, 400))
    assert (picture[[0, 0, -1, -1], [0, -1, 0, -1]] == BACKGROUND).all()
    assert covered(picture).sum() > 2 * covered(before).sum()
    np.testing.assert_allclose(centre(picture), (250, 200), atol=25)


def test_a_window_shows_a_scene_for_as_many_frames_as_are_asked_for(display, torus, tmp_path):
    (tmp_path / "s.toml").write_text(
        "camera = {samples = 4, sraa = true}\n[[light]]\ndirection = [-1, 1, -2]\nshadows = true\n"
    )
    command = [sys.executable, "-m", "gstream_tools.view_gl", torus.path, "--scene", "s.toml"]
    done = subprocess.run(
        [*command, "--window-frames", "3"], cwd=tmp_path, timeout=HANGS, capture_output=True,
        text=True, check=False, env={**os.environ, "DISPLAY": display},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_still_picture_costs_nothing(viewer):
    window = viewer("--pixel-error", "3")
    window.picture()
    before = window.cpu_seconds()
    time.sleep(3)
    assert window.cpu_seconds() - before < 0.1
    window.do("mousemove", "--window", window.window, 50, 60)  # and nothing happens
    time.sleep(0.5)
    assert window.cpu_seconds() - before < 0.1
