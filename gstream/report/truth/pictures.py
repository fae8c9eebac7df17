"""How far a picture is from one with many samples in each pixel, in codes of 8 bits.

Both show a grey object that is nowhere black, on BACKGROUND, which is no grey: the colours
themselves say what of a pixel the object covers.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.report.truth.scene import Codes, codes_of_linear, linear_of_codes

BACKGROUND = (0.0, 0.0, 0.5)  # sRGB, 0 to 1


def read_picture(path: Path) -> Codes:
    """(h, w, 3) u1 sRGB codes of a PNG. Needs Pillow, as the viewer does."""
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def picture_errors(picture: Codes, finer: Codes) -> dict[str, float]:
    """Root mean squares over the pixels that show the object, and over those that are its edge.

    picture : (h, w, 3) sRGB codes
    finer : (k h, k w, 3) the same view; k^2 pixels to a pixel, averaged in linear light
    """
    red, blue = _cells(finer[..., 0], picture), _cells(finer[..., 2], picture)
    shown = (red > 0).any(axis=-1)
    edge = shown & (red != blue).any(axis=-1)
    channels = [_cells(linear_of_codes(finer[..., c]), picture).mean(axis=-1) for c in range(3)]
    squares = (picture - codes_of_linear(np.stack(channels, axis=-1))) ** 2
    return {
        "image_rms": float(np.sqrt(squares[shown].mean())),
        "edge_rms": float(np.sqrt(squares[edge].mean())),
    }


def differing_pixels(picture: Codes, other: Codes) -> int:
    """Pixels of two pictures of one size that are not the same."""
    return int((picture != other).any(axis=-1).sum())


def _cells(values: NDArray[Any], picture: Codes) -> NDArray[Any]:
    """(h, w, k^2) of (k h, k w): the values in each pixel of a picture."""
    height, width = picture.shape[:2]
    k = values.shape[0] // height
    split = values.reshape(height, k, width, k).swapaxes(1, 2)
    return split.reshape(height, width, k * k)
