"""Packets of small triangles: from corners to their frame, normals, face masks and voxel names.

See `packets.py`; rows are those of `packet_rows.py`.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import part
from gstream.kernels.clip import (
    AREA_UNITS,
    VECTOR_UNITS,
)
from gstream.kernels.lanes import (
    LANES,
    at,
)
from gstream.kernels.packet_rows import (
    BASE,
    CORNER,
    DIRECTION,
    EDGE,
    FACTOR,
    FIRST_AXIS,
    LAST,
    MASK,
    NORMAL,
    OVER,
    OWNER,
    PLACES,
    TURN,
    UNDER,
)

I64 = NDArray[np.int64]
I32 = NDArray[np.int32]
U32 = NDArray[np.uint32]
U8 = NDArray[np.uint8]
F64 = NDArray[np.float64]


@part
def pick(axis: int, x: int, y: int, z: int) -> int:
    """The value of an axis, 0 to 2."""
    return x if axis == 0 else (y if axis == 1 else z)


@part
def first_axis(x: int, y: int, z: int) -> int:
    """Axis u, where w is that of the largest of three; of equals the last (as `dominant_axis`)."""
    return 0 if (z >= x) & (z >= y) else (2 if y >= x else 1)


@part
def turned(first: int, axis: int) -> int:
    """Which of x, y, z an axis of (u, v, w) is, where u is `first`."""
    which = first + axis
    return which - 3 if which >= 3 else which


@part
def load(corners: I64, chosen: I32, first: int, count: int, words: I64) -> None:
    """Rows of the corners of triangles chosen[first : first + count], the last one repeated."""
    for lane in range(LANES):
        t = np.uint64(chosen[np.uint64(first + min(lane, count - 1))])
        for a in range(3):
            for c in range(3):
                words[at(CORNER + 3 * a + c, lane)] = corners[t, a, c]


@part
def move_to_frame(words: I64, k: int) -> None:
    """From corners in the room to all other rows of a triangle but those of the voxel at hand."""
    low = 0xFFFFF
    for lane in range(LANES):
        x0, y0, z0 = words[at(0, lane)], words[at(1, lane)], words[at(2, lane)]
        x1, y1, z1 = words[at(3, lane)], words[at(4, lane)], words[at(5, lane)]
        x2, y2, z2 = words[at(6, lane)], words[at(7, lane)], words[at(8, lane)]
        base_x, base_y = min(x0, x1, x2) >> k, min(y0, y1, y2) >> k
        base_z = min(z0, z1, z2) >> k
        last_x, last_y = (max(x0, x1, x2) >> k) - base_x, (max(y0, y1, y2) >> k) - base_y
        last_z = (max(z0, z1, z2) >> k) - base_z
        x, y, z = base_x << k, base_y << k, base_z << k
        # One integer per corner, 20 bits per coordinate: sorted without a branch.
        a = ((x0 - x) << 40) + ((y0 - y) << 20) + (z0 - z)
        b = ((x1 - x) << 40) + ((y1 - y) << 20) + (z1 - z)
        c = ((x2 - x) << 40) + ((y2 - y) << 20) + (z2 - z)
        swaps = np.int64(a > b) + np.int64(b > c) + np.int64(a > c)
        smallest, largest = min(a, b, c), max(a, b, c)
        middle = a + b + c - smallest - largest
        x0, y0, z0 = smallest >> 40, (smallest >> 20) & low, smallest & low
        x1, y1, z1 = middle >> 40, (middle >> 20) & low, middle & low
        x2, y2, z2 = largest >> 40, (largest >> 20) & low, largest & low
        n_x = (y1 - y0) * (z2 - z0) - (z1 - z0) * (y2 - y0)
        n_y = (z1 - z0) * (x2 - x0) - (x1 - x0) * (z2 - z0)
        n_z = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
        u = first_axis(abs(n_x), abs(n_y), abs(n_z))
        value = n_x * x0 + n_y * y0 + n_z * z0
        first = n_x if n_x != 0 else (n_y if n_y != 0 else n_z)
        words[at(OVER, lane)] = (
            max(n_x, 0) + max(n_y, 0) + max(n_z, 0) + ((-value - np.int64(first > 0)) >> k)
        )
        words[at(UNDER, lane)] = (
            -min(n_x, 0) - min(n_y, 0) - min(n_z, 0) + ((value - np.int64(first < 0)) >> k)
        )
        first_place = 0 if a == smallest else (1 if b == smallest else 2)
        last_place = 2 if c == largest else (1 if b == largest else 0)
        words[at(PLACES, lane)], words[at(PLACES + 2, lane)] = first_place, last_place
        words[at(PLACES + 1, lane)] = 3 - first_place - last_place
        words[at(TURN, lane)] = 1 - 2 * (swaps & 1)
        words[at(FIRST_AXIS, lane)] = u
        rotate(words, CORNER, lane, u, x0, y0, z0)
        rotate(words, CORNER + 3, lane, u, x1, y1, z1)
        rotate(words, CORNER + 6, lane, u, x2, y2, z2)
        rotate(words, NORMAL, lane, u, n_x, n_y, n_z)
        rotate(words, BASE, lane, u, base_x, base_y, base_z)
        rotate(words, LAST, lane, u, last_x, last_y, last_z)


@part
def rotate(words: I64, row: int, lane: int, u: int, x: int, y: int, z: int) -> None:
    """Write (x, y, z) in the order (u, v, w)."""
    words[at(row, lane)] = pick(u, x, y, z)
    words[at(row + 1, lane)] = pick(u, y, z, x)
    words[at(row + 2, lane)] = pick(u, z, x, y)


@part
def measure_normal(
    words: I64, names: U32, used: int, both: bool, reals: F64, normals: F64, masks: U8
) -> None:
    """Normals, VECTOR_UNITS long, and face masks of the input's winding, and row FACTOR."""
    for lane in range(LANES):
        n_u, n_v = words[at(NORMAL, lane)], words[at(NORMAL + 1, lane)]
        n_w, which = words[at(NORMAL + 2, lane)], words[at(FIRST_AXIS, lane)]
        turn = words[at(TURN, lane)]
        x = np.float64(turn * pick(which, n_u, n_w, n_v))
        y = np.float64(turn * pick(which, n_v, n_u, n_w))
        z = np.float64(turn * pick(which, n_w, n_v, n_u))
        length = np.sqrt(x * x + y * y + z * z)
        some = n_w != 0
        reals[at(FACTOR, lane)] = AREA_UNITS * length / abs(np.float64(n_w)) if some else 0.0
        reals[at(DIRECTION, lane)] = VECTOR_UNITS * (x / length) if some else 0.0
        reals[at(DIRECTION + 1, lane)] = VECTOR_UNITS * (y / length) if some else 0.0
        reals[at(DIRECTION + 2, lane)] = VECTOR_UNITS * (z / length) if some else 0.0
        words[at(MASK, lane)] = face(x, both) | face(y, both) << 2 | face(z, both) << 4
    for lane in range(used):
        t = np.uint64(names[at(OWNER, lane)])
        masks[t] = words[at(MASK, lane)]
        for c in range(3):
            normals[t, 1 + c] = reals[at(DIRECTION + c, lane)]


@part
def face(n: float, both: bool) -> int:
    """Two bits of the face mask: faces towards negative and positive coordinates."""
    front = 2 if n > 0.0 else 1
    return 0 if n == 0.0 else (3 if both else front)


@part
def name_axis(words: I64, axis: int, size: int, codes: U32) -> None:
    """Morton codes of voxels along an axis; of any value outside the room."""
    for i in range(size):
        for lane in range(LANES):
            bits = np.uint64((words[at(BASE + axis, lane)] + i) & 255)
            bits = (bits | (bits << np.uint64(8))) & np.uint64(0x00F00F)
            bits = (bits | (bits << np.uint64(4))) & np.uint64(0x0C30C3)
            bits = (bits | (bits << np.uint64(2))) & np.uint64(0x249249)
            which = turned(words[at(FIRST_AXIS, lane)], axis)
            codes[at(EDGE * axis + i, lane)] = np.uint32(bits << np.uint64(which))
