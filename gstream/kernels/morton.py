"""Morton codes: bit 0 is x, bit 1 y, bit 2 z; up to 21 bits an axis in uint64.

Source: the magic-number spreading of Baert, "Morton encoding/decoding through bit interleaving",
2013, after Anderson, "Bit Twiddling Hacks".
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel, part

S1, S2, S4 = np.uint64(1), np.uint64(2), np.uint64(4)
S8, S16, S32 = np.uint64(8), np.uint64(16), np.uint64(32)
M32 = np.uint64(0x001F00000000FFFF)
M16 = np.uint64(0x001F0000FF0000FF)
M8 = np.uint64(0x100F00F00F00F00F)
M4 = np.uint64(0x10C30C30C30C30C3)
M2 = np.uint64(0x1249249249249249)
M21 = np.uint64(0x00000000001FFFFF)
X_BITS, Y_BITS, Z_BITS = (np.uint32(0o1111111111 << axis) for axis in range(3))


@part
def spread(value):
    """Move bit i of a coordinate below 2^21 to bit 3 i, as uint64."""
    value = np.uint64(value) & M21
    value = (value | (value << S32)) & M32
    value = (value | (value << S16)) & M16
    value = (value | (value << S8)) & M8
    value = (value | (value << S4)) & M4
    return (value | (value << S2)) & M2


@part
def gather(code):
    """Undo spread: bit 3 i of a code goes to bit i, as uint64."""
    value = np.uint64(code) & M2
    value = (value | (value >> S2)) & M4
    value = (value | (value >> S4)) & M8
    value = (value | (value >> S8)) & M16
    value = (value | (value >> S16)) & M32
    return (value | (value >> S32)) & M21


@part
def encode(x, y, z):
    """The uint64 Morton code of one voxel; x, y, z below 2^21."""
    return spread(x) | (spread(y) << S1) | (spread(z) << S2)


@part
def decode(code):
    """The coordinates (x, y, z) of one uint64 Morton code, as uint64."""
    return gather(code), gather(np.uint64(code) >> S1), gather(np.uint64(code) >> S2)


@kernel
def encode_points(points):
    """Morton codes of many voxels.

    points : (n, 3) of any integer type, x, y, z from 0 to 2^21 - 1
    returns: (n,) uint64
    errors : none; higher bits are dropped
    source : Baert 2013
    """
    codes = np.empty(points.shape[0], np.uint64)
    for i in range(points.shape[0]):
        codes[i] = encode(points[i, 0], points[i, 1], points[i, 2])
    return codes


@kernel
def decode_codes(codes):
    """Coordinates of many Morton codes.

    codes  : (n,) u32 or u64
    returns: (n, 3) int32, x, y, z
    errors : none
    source : Baert 2013
    """
    points = np.empty((codes.size, 3), np.int32)
    for i in range(codes.size):
        x, y, z = decode(codes[i])
        points[i, 0], points[i, 1], points[i, 2] = x, y, z
    return points


@kernel
def tight_bounds(codes):
    """Smallest and largest coordinates of Morton codes.

    codes  : (n >= 1,) u32, below 2^30
    returns: (x, y, z), (x, y, z)   low and high corner, both included, as ints
    errors : none
    source : spread bits keep the order of numbers, so that only six of them are gathered
    """
    low_x = low_y = low_z = np.uint32(0xFFFFFFFF)
    high_x = high_y = high_z = np.uint32(0)
    for i in range(codes.size):
        x, y, z = codes[i] & X_BITS, codes[i] & Y_BITS, codes[i] & Z_BITS
        low_x, low_y, low_z = min(low_x, x), min(low_y, y), min(low_z, z)
        high_x, high_y, high_z = max(high_x, x), max(high_y, y), max(high_z, z)
    low = (gather(low_x), gather(low_y >> S1), gather(low_z >> S2))
    return low, (gather(high_x), gather(high_y >> S1), gather(high_z >> S2))


@kernel
def bounds_of_each(codes, counts):
    """Smallest and largest coordinates of each of many blocks.

    codes  : (sum of counts,) u32, below 2^24, one block after the other; counts : (m,) int64, not 0
    returns: (m, 2, 3) u8   low and high corner, both included
    errors : none
    source : tight_bounds
    """
    bounds = np.empty((counts.size, 2, 3), np.uint8)
    begin = 0
    for b in range(counts.size):
        low, high = tight_bounds(codes[begin : begin + counts[b]])
        for axis in range(3):
            bounds[b, 0, axis], bounds[b, 1, axis] = low[axis], high[axis]
        begin += counts[b]
    return bounds


def scan_order(log2_edge: int) -> NDArray[np.int32]:
    """Where a dense [z, y, x] cube of edge 2^log2_edge holds its voxels, in Morton order.

    returns: (8^log2_edge,) int32   entry c = flat C index of the voxel with code c
    """
    codes = np.arange(8**log2_edge, dtype=np.uint32)
    points: NDArray[Any] = decode_codes(codes)
    x, y, z = points.T
    order: NDArray[np.int32] = ((z << log2_edge | y) << log2_edge | x).astype(np.int32)
    return order


def spread_table(bits: int) -> NDArray[np.uint64]:
    """spread(v) for every v below 2^bits: three look-ups make a code of small coordinates."""
    values = np.zeros((1 << bits, 3), np.int32)
    values[:, 0] = np.arange(1 << bits)
    table: NDArray[np.uint64] = encode_points(values)
    return table
