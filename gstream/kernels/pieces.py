"""Cutting source triangles at the borders of blocks, so that neighbours share every point.

A triangle is cut by the planes of x, what is left by those of y, then of z. Edge and plane make one
point, rounded once to whole snap units, half up: a pure function of the two, whichever triangle or
block asks. Rounding keeps the order of coordinates along an edge, so along each axis a ring still
rises once and falls once, a plane meets it twice or not at all, and its two parts have one edge in
common. Hence the pieces of a closed mesh close up exactly, whatever the rounding.

Source: Chajdas, thesis, section 4.7 (the use); spec/blockfile.md, section 7.4 (the rule).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel, part
from gstream.kernels.morton import decode_codes, encode, encode_points
from gstream.kernels.voxelize import BoxFullError

I64 = NDArray[np.int64]
Rows = NDArray[np.int32]

POINTS = 16  # each axis cuts a ring at most twice at each of two planes: 3, 7, 11, 15
ROW = 10  # Morton code of the block, then three corners
AXES = 3


def cut_at_borders(corners: I64, block_log2: int, room: I64, most: int = 1 << 40) -> Rows:
    """The pieces of triangles in the blocks of a box.

    corners : (n, 3, 3) i8   snap units relative to the box's low corner
    block_log2 : log2 of a block's edge in snap units
    room : (3,) i8   extent of the box, snap units
    returns : (m, 10) i4   Morton code of the block in the box; three corners relative to the
        block's low corner, no two the same
    errors : BoxFullError for more than `most` pieces, before there is memory for them
    """
    # Scans have 1.1 to 1.3 pieces a triangle: counting first would cut nearly all of them twice.
    rows = np.empty((2 * len(corners), ROW), np.int32)
    count = cut(corners, block_log2, room, rows)
    if count > most:
        raise BoxFullError
    if count > len(rows):
        rows = np.empty((count, ROW), np.int32)
        cut(corners, block_log2, room, rows)
    return rows[:count].copy()


def indexed(corners: NDArray[np.int32]) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Vertices in Morton order, each once, and triangles of their numbers, sorted.

    corners : (n, 3, 3) i4, 0 to 2^21 - 1, no two of a triangle the same
    returns : (v, 3) u4; (n, 3) u4, the smallest number of each first, its orientation kept
    """
    codes, numbers = np.unique(encode_points(corners.reshape(-1, AXES)), return_inverse=True)
    numbers = numbers.reshape(-1, 3).astype(np.int64)
    turn = (numbers.argmin(axis=1)[:, None] + np.arange(3)) % 3
    turned = np.take_along_axis(numbers, turn, axis=1)
    order = np.lexsort((turned[:, 2], turned[:, 0] << 32 | turned[:, 1]))
    return decode_codes(codes).astype(np.uint32), turned[order].astype(np.uint32)


def warm() -> None:
    """Compile the kernels of this file."""
    corners = np.array([[[0, 0, 0], [20, 0, 0], [0, 20, 3]]], np.int64)
    indexed(cut_at_borders(corners, 4, np.full(3, 32))[:, 1:])


@kernel
def cut(corners: I64, block_log2: int, room: I64, rows: Rows) -> int:
    """Write the pieces of triangles, as many as there is room for.

    corners, block_log2, room : as in cut_at_borders
    rows : (m, 10) i4   out
    returns : int   pieces in all, more than m where some were not written
    errors : none; coordinates within 2^27, so that products stay below 2^56
    """
    rings = np.empty((AXES + 1, POINTS, AXES), np.int64)
    begin = 0
    for t in range(corners.shape[0]):
        begin = cut_one(corners[t], block_log2, room, rings, rows, begin)
    return begin


@part
def cut_one(
    triangle: I64, block_log2: int, room: I64, rings: NDArray[Any], rows: Rows, begin: int
) -> int:
    """Write the pieces of one triangle from row `begin` on; returns the row behind them."""
    whole, slab, bar, piece = rings[0], rings[1], rings[2], rings[3]
    count = ring_of(triangle, whole)
    first_x, stop_x = span(whole, count, 0, block_log2, room[0])
    for x in range(first_x, stop_x):
        in_slab = between(whole, count, 0, x, block_log2, room[0], slab)
        first_y, stop_y = span(slab, in_slab, 1, block_log2, room[1])
        for y in range(first_y, stop_y):
            in_bar = between(slab, in_slab, 1, y, block_log2, room[1], bar)
            first_z, stop_z = span(bar, in_bar, 2, block_log2, room[2])
            for z in range(first_z, stop_z):
                corners = between(bar, in_bar, 2, z, block_log2, room[2], piece)
                for i in range(corners):
                    piece[i, 0] -= x << block_log2
                    piece[i, 1] -= y << block_log2
                    piece[i, 2] -= z << block_log2
                begin = write_fan(piece, corners, encode(x, y, z), rows, begin)
    return begin


@part
def ring_of(triangle: I64, ring: I64) -> int:
    """Copy a triangle, its least corner first, so that all that follows is a function of it alone.

    returns : int   corners; 0 where two in a row are the same
    """
    least = 0
    for i in range(1, 3):
        for axis in range(AXES):
            if triangle[i, axis] != triangle[least, axis]:
                if triangle[i, axis] < triangle[least, axis]:
                    least = i
                break
    kept = 0
    for i in range(3):
        at = (least + i) % 3
        kept = append(ring, kept, triangle[at, 0], triangle[at, 1], triangle[at, 2])
    return 3 if kept == 3 else 0


@part
def span(ring: I64, count: int, axis: int, block_log2: int, room: int) -> tuple[int, int]:
    """First and behind the last of the blocks along an axis that a ring has a part in.

    A ring that lies in a border is in the block above, as the tie rule has it.
    """
    if count < 3:
        return 0, 0
    low, high = ring[0, axis], ring[0, axis]
    for i in range(1, count):
        low, high = min(low, ring[i, axis]), max(high, ring[i, axis])
    if low >= room:
        return 0, 0
    last = max(low, min(high, room) - 1) >> block_log2
    return max(low >> block_log2, 0), last + 1


@part
def between(
    ring: I64, count: int, axis: int, block: int, block_log2: int, room: int, out: I64
) -> int:
    """The part of a ring in one block along an axis, or up to where the box ends.

    returns : int   corners in `out`; no two in a row are the same
    """
    least, most = ring[0, axis], ring[0, axis]
    for i in range(1, count):
        least, most = min(least, ring[i, axis]), max(most, ring[i, axis])
    # A plane that only touches the ring does not cut it.
    low = max(block << block_log2, least)
    high = min((block + 1) << block_log2, room)
    high = most + 1 if high >= most else high
    if low == least and high > most:
        for i in range(count):
            out[i, 0], out[i, 1], out[i, 2] = ring[i, 0], ring[i, 1], ring[i, 2]
        return count
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here, there = ring[i, axis], ring[j, axis]
        if low <= here and here < high:
            kept = append(out, kept, ring[i, 0], ring[i, 1], ring[i, 2])
        rising = here < there
        kept = append_cut(ring, i, j, axis, low if rising else high, out, kept)
        kept = append_cut(ring, i, j, axis, high if rising else low, out, kept)
    return kept


@part
def append_cut(ring: I64, i: int, j: int, axis: int, at: int, out: I64, kept: int) -> int:
    """Append where the edge i j meets the plane at `at`, if its ends are on different sides.

    The point is the same from both ends, as what is rounded is exact.
    """
    if (ring[i, axis] < at) == (ring[j, axis] < at):
        return kept
    width, part_of = ring[j, axis] - ring[i, axis], at - ring[i, axis]
    x = ring[i, 0] + rounded((ring[j, 0] - ring[i, 0]) * part_of, width)
    y = ring[i, 1] + rounded((ring[j, 1] - ring[i, 1]) * part_of, width)
    z = ring[i, 2] + rounded((ring[j, 2] - ring[i, 2]) * part_of, width)
    return append(out, kept, x, y, z)


@part
def rounded(a: int, b: int) -> int:
    """a / b to the nearest integer, half up; the same of -a and -b."""
    return (2 * a + b) // (2 * b)


@part
def append(ring: I64, kept: int, x: int, y: int, z: int) -> int:
    """Append a corner unless it is the last one again."""
    if kept and ring[kept - 1, 0] == x and ring[kept - 1, 1] == y and ring[kept - 1, 2] == z:
        return kept
    ring[kept, 0], ring[kept, 1], ring[kept, 2] = x, y, z
    return kept + 1


@part
def are_same(ring: I64, i: int, j: int) -> bool:
    return ring[i, 0] == ring[j, 0] and ring[i, 1] == ring[j, 1] and ring[i, 2] == ring[j, 2]


@part
def write_fan(ring: I64, count: int, block: int, rows: Rows, begin: int) -> int:
    """Write a ring as triangles around its first corner.

    Those with two equal corners are left out: their edges cancel, so the others close up as well.
    returns : int   the row behind them
    """
    for i in range(1, count - 1):
        if are_same(ring, 0, i) or are_same(ring, 0, i + 1):
            continue
        if begin < rows.shape[0]:
            rows[begin, 0] = block
            for axis in range(AXES):
                rows[begin, 1 + axis] = ring[0, axis]
                rows[begin, 4 + axis] = ring[i, axis]
                rows[begin, 7 + axis] = ring[i + 1, axis]
        begin += 1
    return begin
