"""A context without a window, and pictures as files."""

from __future__ import annotations

from pathlib import Path

import moderngl
import numpy as np
from numpy.typing import NDArray
from PIL import Image


def context() -> moderngl.Context:
    """OpenGL 4.5 without a display: EGL, in software where there is no GPU.

    errors : RuntimeError that says what to install
    """
    try:
        made = moderngl.create_context(require=450, standalone=True, backend="egl")  # type: ignore[arg-type]
    except Exception as error:  # glcontext raises what the driver gives
        raise RuntimeError(
            f"no OpenGL 4.5 ({error}): install the driver's EGL, or on Debian libegl1 and libgl1"
        ) from error
    return made


def save(picture: NDArray[np.uint8], path: str | Path) -> None:
    """Write (height, width, 4) pixels without their alpha as PNG."""
    Image.fromarray(np.ascontiguousarray(picture[..., :3])).save(path)
