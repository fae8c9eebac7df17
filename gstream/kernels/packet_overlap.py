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
def product(a: int, b: int) -> int:
    """a * b of numbers below 2^31: one instruction of a vector unit, where 64 bits take three."""
    return np.int64(np.int32(a)) * np.int64(np.int32(b))


@part
def prepare_edges(words: I64, k: int, axis: int, six: bool, edges: I32) -> None:
    """The three edge tests of the projection along an axis; see `overlap.edges_of_projection`.

    Seen along the axis, the triangle's side of an edge is where a*p + b*q + c >= 0; p and q are the
    two axes that follow.
    """
    edge_test(words, k, axis, 0, 1, six, edges)
    edge_test(words, k, axis, 1, 2, six, edges)
    edge_test(words, k, axis, 2, 0, six, edges)
    flat = np.int64(0)
    for lane in range(LANES):
        flat |= np.int64(words[at(NORMAL + axis, lane)] == 0)
    if flat:
        flatten_edges(words, k, axis, edges)


@part
def edge_test(words: I64, k: int, axis: int, start: int, end: int, six: bool, edges: I32) -> None:
    """The test of the edge from corner `start` to `end`, where the projection has an area."""
    p, q = (axis + 1) % 3, (axis + 2) % 3
    row, centre = 9 * axis + 3 * start, CENTRE + 3 * axis + start
    for lane in range(LANES):
        start_p, start_q = words[at(3 * start + p, lane)], words[at(3 * start + q, lane)]
        a, b = start_q - words[at(3 * end + q, lane)], words[at(3 * end + p, lane)] - start_p
        mirrored = words[at(NORMAL + axis, lane)] < 0
        a, b = -a if mirrored else a, -b if mirrored else b
        c = -product(a, start_p) - product(b, start_q) - tie(words, axis, a, b, lane)
        edges[at(row, lane)], edges[at(row + 1, lane)] = np.int32(a), np.int32(b)
        edges[at(row + 2, lane)] = np.int32((c + ((max(a, 0) + max(b, 0)) << k)) >> k)
        if six:
            edges[at(centre, lane)] = np.int32((c + ((a + b) << (k - 1))) >> k)


@part
def flatten_edges(words: I64, k: int, axis: int, edges: I32) -> None:
    """Where a projection has no area it is a segment: its longest edge, forwards and backwards."""
    p, q = (axis + 1) % 3, (axis + 2) % 3
    row, centre = 9 * axis, CENTRE + 3 * axis
    for lane in range(LANES):
        if words[at(NORMAL + axis, lane)] != 0:
            continue
        longest, a, b, c = np.int64(-1), np.int64(0), np.int64(0), np.int64(0)
        for start in range(3):
            end = start + 1 if start < 2 else 0
            start_p, start_q = words[at(3 * start + p, lane)], words[at(3 * start + q, lane)]
            along_p = words[at(3 * end + p, lane)] - start_p
            along_q = words[at(3 * end + q, lane)] - start_q
            if abs(along_p) + abs(along_q) > longest:
                longest, a, b = abs(along_p) + abs(along_q), -along_q, along_p
                c = -a * start_p - b * start_q
        for e in range(3):
            c_tied = c - tie(words, axis, a, b, lane)
            edges[at(row + 3 * e, lane)], edges[at(row + 3 * e + 1, lane)] = a, b
            edges[at(row + 3 * e + 2, lane)] = (c_tied + ((max(a, 0) + max(b, 0)) << k)) >> k
            edges[at(centre + e, lane)] = (c_tied + ((a + b) << (k - 1))) >> k
            a, b, c = (-a, -b, -c) if e == 0 else (np.int64(0), np.int64(0), np.int64(0))


@part
def tie(words: I64, axis: int, a: int, b: int, lane: int) -> int:
    """1 where a value of exactly 0 is beyond the edge; see `overlap.tie`."""
    # Of (p, q), the earlier one of x, y, z decides ties: q where the projection is along y.
    q_first = turned(words[at(FIRST_AXIS, lane)], axis) == 1
    first, second = b if q_first else a, a if q_first else b
    return np.int64((first << 32) + second > 0)


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
