"""A context without a window, and pictures as files."""

from __future__ import annotations

import os
from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray
from PIL import Image


class NoOpenGLError(RuntimeError):
    """There is no OpenGL to draw with; one line that says what to install."""


def context() -> moderngl.Context:
    """OpenGL 4.5 without a display: EGL, in software where there is no GPU.

    errors : NoOpenGLError
    """
    try:
        # Its annotation has the settings as dict[str, Any]: each keyword is one.
        made = moderngl.create_context(require=450, standalone=True, backend="egl")  # type: ignore[arg-type]
    except Exception as error:  # glcontext raises what the driver gives
        said = " ".join(str(error).split())
        raise NoOpenGLError(
            f"no OpenGL 4.5 ({said}): install the driver's EGL, or on Debian libegl1 and libgl1"
        ) from error
    return made


def save(picture: NDArray[np.uint8], path: str | Path) -> None:
    """Write (height, width, 4) pixels without alpha as PNG; the name appears when all is in it.

    errors : OSError
    """
    unfinished = Path(f"{path}.wip")
    Image.fromarray(np.ascontiguousarray(picture[..., :3])).save(unfinished, "PNG")
    os.replace(unfinished, path)
