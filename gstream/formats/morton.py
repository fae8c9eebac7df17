"""Morton codes of voxel and block coordinates in plain NumPy; bit 0 is x, bit 1 y, bit 2 z.

The compiled form is kernels/morton.py. Source: G. M. Morton, "A Computer Oriented Geodetic Data
Base", IBM, 1966; the masks are those of Hacker's Delight, section 7-2, for every third bit.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

U64 = NDArray[np.uint64]
Place = tuple[int, int, int]

_STEPS: Final = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
_LOW: Final = 0x1FFFFF  # 21 bits per axis
PIECE: Final = 1 << 20  # codes that are decoded at once: 64-bit copies of no more


def encode_morton(places: NDArray[Any]) -> U64:
    """Codes (n,) u64 of (n, 3) coordinates x, y, z, each below 2^21."""
    code = np.zeros(len(places), np.uint64)
    for axis in range(3):
        bits = places[:, axis].astype(np.uint64) & np.uint64(_LOW)
        for shift, mask in _STEPS:
            bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
        code |= bits << np.uint64(axis)
    return code


def decode_morton(codes: NDArray[Any]) -> NDArray[np.uint32]:
    """Coordinates (n, 3) u32 of (n,) codes below 2^63."""
    places = np.empty((len(codes), 3), np.uint32)
    masks = [*(mask for _, mask in _STEPS[-2::-1]), _LOW]
    for axis in range(3):
        bits = codes.astype(np.uint64) >> np.uint64(axis) & np.uint64(_STEPS[-1][1])
        for (shift, _), mask in zip(_STEPS[::-1], masks, strict=True):
            bits = (bits | bits >> np.uint64(shift)) & np.uint64(mask)
        places[:, axis] = bits
    return places


def decode_one(code: int) -> Place:
    """Coordinates of one code below 2^63: 1 us, where an array of one takes 40."""
    bits = f"{code:063b}"
    return int(bits[2::3], 2), int(bits[1::3], 2), int(bits[0::3], 2)


def tight_bounds(codes: NDArray[Any]) -> tuple[Place, Place]:
    """Smallest and largest coordinates of (n >= 1,) codes, both included."""
    pieces = (decode_morton(codes[at : at + PIECE]) for at in range(0, len(codes), PIECE))
    bounds = np.array([(piece.min(axis=0), piece.max(axis=0)) for piece in pieces])
    return tuple(bounds[:, 0].min(axis=0).tolist()), tuple(bounds[:, 1].max(axis=0).tolist())


def bounds_of_each(codes: NDArray[Any], counts: NDArray[np.int64]) -> NDArray[np.uint8]:
    """(m, 2, 3) tight_bounds of m blocks of `counts` codes each, one block after the other."""
    blocks = np.split(codes, np.cumsum(counts)[:-1])
    return np.array([tight_bounds(block) for block in blocks], np.uint8)
