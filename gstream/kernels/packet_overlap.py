"""Packets of small triangles: which voxels of the box does each triangle meet, and which targets?

Every test gives a word that is negative iff the voxel is beyond an edge, a plane or the room. See
`packets.py`; rows are those of `packet_rows.py`.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import part
from gstream.kernels.lanes import (
    LANES,
    at,
)
from gstream.kernels.packet_frame import (
    pick,
    turned,
)
from gstream.kernels.packet_rows import (
    ALL_MISSED,
    BASE,
    CENTRE,
    CENTRE_OVER,
    CENTRE_UNDER,
    CORNER,
    EDGE,
    FIRST_AXIS,
    LAST,
    LINE,
    MISSED,
    NORMAL,
    OUTSIDE,
    OVER,
    ROW_START,
    UNDER,
    VALUE,
)

I64 = NDArray[np.int64]
I32 = NDArray[np.int32]

NEVER = -(1 << 62)


@part
def limit_axis(words: I64, room: tuple[int, int, int], axis: int, size: int, limits: I32) -> None:
    """Words of voxels along an axis: negative outside the triangle's box or the room."""
    for i in range(size):
        for lane in range(LANES):
            which = turned(words[at(FIRST_AXIS, lane)], axis)
            place = words[at(BASE + axis, lane)] + i
            beyond = pick(which, room[0], room[1], room[2]) - 1 - place
            limits[at(EDGE * axis + i, lane)] = np.int32(
                place | beyond | (words[at(LAST + axis, lane)] - i)
            )


@part
def edge_of(
    words: I64, axis: int, start: int, end: int, turn: int, lane: int
) -> tuple[int, int, int]:
    """(a, b, c): seen along an axis, side `turn` of the edge from corner `start` to corner `end` is
    where a*p + b*q + c >= 0; p and q are the two axes that follow."""
    p, q = (axis + 1) % 3, (axis + 2) % 3
    start_p, start_q = words[at(3 * start + p, lane)], words[at(3 * start + q, lane)]
    a = turn * (start_q - words[at(3 * end + q, lane)])
    b = turn * (words[at(3 * end + p, lane)] - start_p)
    return a, b, -a * start_p - b * start_q


@part
def prepare_edges(words: I64, k: int, axis: int, edges: I32) -> None:
    """The three edge tests of the projection along an axis; see `overlap.edges_of_projection`."""
    for lane in range(LANES):
        n = words[at(NORMAL + axis, lane)]
        turn = -1 if n < 0 else 1
        a0, b0, c0 = edge_of(words, axis, 0, 1, turn, lane)
        a1, b1, c1 = edge_of(words, axis, 1, 2, turn, lane)
        a2, b2, c2 = edge_of(words, axis, 2, 0, turn, lane)
        # A projection without area is a segment: its longest edge, forwards and backwards.
        flat = n == 0
        long_0, long_1, long_2 = abs(a0) + abs(b0), abs(a1) + abs(b1), abs(a2) + abs(b2)
        second, third = long_1 > long_0, long_2 > max(long_0, long_1)
        a = a2 if third else (a1 if second else a0)
        b = b2 if third else (b1 if second else b0)
        c = c2 if third else (c1 if second else c0)
        a0, b0, c0 = a if flat else a0, b if flat else b0, c if flat else c0
        a1, b1, c1 = -a if flat else a1, -b if flat else b1, -c if flat else c1
        a2, b2, c2 = 0 if flat else a2, 0 if flat else b2, 0 if flat else c2
        # Of (p, q), the earlier one of x, y, z decides ties: q where the projection is along y.
        q_first = turned(words[at(FIRST_AXIS, lane)], axis) == 1
        c0 -= tie(a0, b0, q_first)
        c1 -= tie(a1, b1, q_first)
        c2 -= tie(a2, b2, q_first)
        row, centre = 9 * axis, CENTRE + 3 * axis
        edges[at(row, lane)], edges[at(row + 1, lane)] = np.int32(a0), np.int32(b0)
        edges[at(row + 3, lane)], edges[at(row + 4, lane)] = np.int32(a1), np.int32(b1)
        edges[at(row + 6, lane)], edges[at(row + 7, lane)] = np.int32(a2), np.int32(b2)
        edges[at(row + 2, lane)] = np.int32((c0 + ((max(a0, 0) + max(b0, 0)) << k)) >> k)
        edges[at(row + 5, lane)] = np.int32((c1 + ((max(a1, 0) + max(b1, 0)) << k)) >> k)
        edges[at(row + 8, lane)] = np.int32((c2 + ((max(a2, 0) + max(b2, 0)) << k)) >> k)
        edges[at(centre, lane)] = np.int32((c0 + ((a0 + b0) << (k - 1))) >> k)
        edges[at(centre + 1, lane)] = np.int32((c1 + ((a1 + b1) << (k - 1))) >> k)
        edges[at(centre + 2, lane)] = np.int32((c2 + ((a2 + b2) << (k - 1))) >> k)


@part
def tie(a: int, b: int, b_first: bool) -> int:
    """1 where a value of exactly 0 is beyond the edge; see `overlap.tie`."""
    first, second = b if b_first else a, a if b_first else b
    return np.int64((first > 0) | ((first == 0) & (second > 0)))


@part
def test_squares(
    edges: I32, limits: I32, axis: int, threshold: int, stride: int, wide: int, long: int,
    squares: I32,
) -> None:  # fmt: skip
    """Words of squares seen along an axis: negative beyond an edge or outside the limits.

    threshold, stride : row of the projection's first threshold, rows from edge to edge
    wide, long : squares along p and q
    squares : rows 64 * axis + 8 * (square along q) + (square along p), out
    """
    row, limit = 9 * axis, EDGE * ((axis + 1) % 3)
    for e in range(3):
        for lane in range(LANES):
            edges[at(ROW_START + e, lane)] = edges[at(threshold + stride * e, lane)]
    for j in range(long):
        for e in range(3):
            for lane in range(LANES):
                edges[at(LINE + e, lane)] = edges[at(ROW_START + e, lane)]
                edges[at(ROW_START + e, lane)] += edges[at(row + 3 * e + 1, lane)]
        for i in range(wide):
            square = EDGE * EDGE * axis + EDGE * j + i
            for lane in range(LANES):
                squares[at(square, lane)] = (
                    edges[at(LINE, lane)]
                    | edges[at(LINE + 1, lane)]
                    | edges[at(LINE + 2, lane)]
                    | limits[at(limit + i, lane)]
                )
            for e in range(3):
                for lane in range(LANES):
                    edges[at(LINE + e, lane)] += edges[at(row + 3 * e, lane)]


@part
def prepare_centres(words: I64, k: int) -> None:
    """Rows CENTRE_OVER and CENTRE_UNDER; see `overlap.prepare_plane`."""
    half = np.int64(1) << (k - 1)
    for lane in range(LANES):
        value = np.int64(0)
        total = np.int64(0)
        for c in range(3):
            value += words[at(NORMAL + c, lane)] * words[at(CORNER + c, lane)]
            total += words[at(NORMAL + c, lane)]
        n_u, n_v = words[at(NORMAL, lane)], words[at(NORMAL + 1, lane)]
        n_w, which = words[at(NORMAL + 2, lane)], words[at(FIRST_AXIS, lane)]
        x, y, z = pick(which, n_u, n_w, n_v), pick(which, n_v, n_u, n_w), pick(which, n_w, n_v, n_u)
        first = x if x != 0 else (y if y != 0 else z)
        for c in range(3):
            n = words[at(NORMAL + c, lane)]
            middle = (total - n) * half - value
            over = max(n, 0) + ((middle - np.int64(first > 0)) >> k)
            under = -min(n, 0) + ((-middle - np.int64(first < 0)) >> k)
            # A segment in the plane's direction is never met: the tie rule moves the plane off it.
            words[at(CENTRE_OVER + c, lane)] = over if n != 0 else NEVER
            words[at(CENTRE_UNDER + c, lane)] = under if n != 0 else NEVER


@part
def test_voxel(words: I64, squares: I32, i: int, j: int, l: int, verdicts: I32) -> None:
    """Row OUTSIDE of the voxel (i, j, l) whose value is at hand."""
    u, v, w = EDGE * l + j, EDGE * EDGE + EDGE * i + l, 2 * EDGE * EDGE + EDGE * j + i
    for lane in range(LANES):
        verdicts[at(OUTSIDE, lane)] = (
            squares[at(u, lane)] | squares[at(v, lane)] | squares[at(w, lane)]
        )
    for lane in range(LANES):
        value = words[at(VALUE, lane)]
        word = (words[at(OVER, lane)] + value) | (words[at(UNDER, lane)] - value)
        verdicts[at(OUTSIDE, lane)] |= np.int32(word >> 32)


@part
def test_centre(words: I64, centres: I32, i: int, j: int, l: int, verdicts: I32) -> None:
    """Row MISSED of the voxel (i, j, l): negative iff no centre segment is met."""
    u, v, w = EDGE * l + j, EDGE * EDGE + EDGE * i + l, 2 * EDGE * EDGE + EDGE * j + i
    for lane in range(LANES):
        value = words[at(VALUE, lane)]
        along_u = (words[at(CENTRE_OVER, lane)] + value) | (words[at(CENTRE_UNDER, lane)] - value)
        along_v = (words[at(CENTRE_OVER + 1, lane)] + value) | (
            words[at(CENTRE_UNDER + 1, lane)] - value
        )
        along_w = (words[at(CENTRE_OVER + 2, lane)] + value) | (
            words[at(CENTRE_UNDER + 2, lane)] - value
        )
        verdicts[at(MISSED, lane)] = (
            (np.int32(along_u >> 32) | centres[at(u, lane)])
            & (np.int32(along_v >> 32) | centres[at(v, lane)])
            & (np.int32(along_w >> 32) | centres[at(w, lane)])
        )


@part
def meet(words: I64, verdicts: I32) -> None:
    """Note targets met, and go on to the next value of the row."""
    for lane in range(LANES):
        verdicts[at(ALL_MISSED, lane)] &= verdicts[at(OUTSIDE, lane)] | verdicts[at(MISSED, lane)]
    for lane in range(LANES):
        words[at(VALUE, lane)] += words[at(NORMAL, lane)]
