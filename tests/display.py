"""OpenGL and a virtual display, for the tests of the viewer as a program."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import pytest


def missing(said: str) -> NoReturn:
    """Skip the test; fail where $CI is set, as .ci/run does."""
    (pytest.fail if os.environ.get("CI") else pytest.skip)(said)


def need_opengl() -> None:
    """OpenGL 4.5 without a window, or no test."""
    try:
        from gstream_tools.view_gl import offscreen

        offscreen.context().release()
    except (ImportError, RuntimeError) as error:
        missing(str(error))


@contextmanager
def virtual_display(size: str = "1024x768") -> Iterator[str]:
    """An X server of our own that draws in memory: the name of its display."""
    server = shutil.which("Xvfb")
    if server is None or shutil.which("xdotool") is None:
        missing("Xvfb or xdotool is missing: apt-get install xvfb xdotool")
    ready, written = os.pipe()
    # Without -noreset it starts anew when its last client goes, and refuses the next one meanwhile.
    command = [
        server, "-displayfd", str(written), "-screen", "0", f"{size}x24", "-nolisten", "tcp",
        "-noreset",
    ]  # fmt: skip
    process = subprocess.Popen(command, pass_fds=[written], stderr=subprocess.DEVNULL)
    os.close(written)
    try:
        with os.fdopen(ready) as pipe:  # Xvfb takes a free display, and says which
            yield f":{pipe.readline().strip()}"
    finally:
        process.terminate()
        process.wait()
