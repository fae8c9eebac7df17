"""How far a picture is from one with many samples in each pixel, in codes of 8 bits; and frames.

All show a grey object that is nowhere black, on BACKGROUND, which is no grey: the colours
themselves say what of a pixel the object covers.
"""

from collections.abc import Sequence
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


def flicker(frames: Sequence[Codes]) -> float:
    """How unevenly pixels change while the camera moves evenly, by less than a pixel a frame.

    Root mean square of the second differences in time, over the pixels that ever show the object:
    of a picture without aliases it would be near 0 (Chajdas 2014, 4.10).
    """
    codes = np.stack(frames).astype(np.float64)
    shown = (np.stack(frames)[..., 0] > 0).any(axis=0)
    uneven = codes[:-2] - 2 * codes[1:-1] + codes[2:]
    return float(np.sqrt((uneven[:, shown] ** 2).mean()))


def shortfall(frames: Sequence[Codes]) -> dict[str, float]:
    """What was still missing while the last frame's picture came about, in whole pictures.

    Each is a sum over all frames: parts of the object's pixels that showed the background, and
    parts that were not yet what they became.
    """
    last = frames[-1]
    shown = last[..., 0] > 0
    pixels = max(int(shown.sum()), 1)
    return {
        "holes": sum(int((shown & (f[..., 0] == 0)).sum()) for f in frames) / pixels,
        "unfinished": sum(int(((f != last).any(axis=-1) & shown).sum()) for f in frames) / pixels,
    }


def _cells(values: NDArray[Any], picture: Codes) -> NDArray[Any]:
    """(h, w, k^2) of (k h, k w): the values in each pixel of a picture."""
    height, width = picture.shape[:2]
    k = values.shape[0] // height
    split = values.reshape(height, k, width, k).swapaxes(1, 2)
    return split.reshape(height, width, k * k)
