"""Morton codes of voxel and block coordinates in plain NumPy; bit 0 is x, bit 1 y, bit 2 z.

The compiled form is kernels/morton.py. Source: G. M. Morton, "A Computer Oriented Geodetic Data
Base", IBM, 1966; the masks are those of Hacker's Delight, section 7-2, for every third bit.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

U64 = NDArray[np.uint64]

_STEPS: Final = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
_LOW: Final = np.uint64(0x1FFFFF)  # 21 bits per axis


def encode_morton(places: NDArray[Any]) -> U64:
    """Codes (n,) u64 of (n, 3) coordinates x, y, z, each below 2^21."""
    code = np.zeros(len(places), np.uint64)
    for axis in range(3):
        bits = places[:, axis].astype(np.uint64) & _LOW
        for shift, mask in _STEPS:
            bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
        code |= bits << np.uint64(axis)
    return code


def decode_morton(codes: NDArray[Any]) -> NDArray[np.uint32]:
    """Coordinates (n, 3) u32 of (n,) codes below 2^63."""
    places = np.empty((len(codes), 3), np.uint32)
    masks = [*(mask for _, mask in _STEPS[-2::-1]), int(_LOW)]
    for axis in range(3):
        bits = codes.astype(np.uint64) >> np.uint64(axis) & np.uint64(_STEPS[-1][1])
        for (shift, _), mask in zip(_STEPS[::-1], masks, strict=True):
            bits = (bits | bits >> np.uint64(shift)) & np.uint64(mask)
        places[:, axis] = bits
    return places
