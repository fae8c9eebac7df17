"""Triangles whose voxels fit in a box of 8^3, in packets of 64 side by side.

`fragments.py` asks voxel by voxel and leaves early; on triangles of 1 to 3 voxels most of its time
goes to mispredicted branches. Here each value is a row of 64 lanes, one per triangle of the packet,
and the loops over a row have no branches, so that the compiler turns them into vector instructions.
Every test of every voxel of the box is made: a word that is negative iff the voxel is beyond the
edge or plane; words are or-ed, and the sign decides whether the fragment just written is kept.
Areas come from `cover.py`.

Whether a triangle comes here depends on the triangle alone, and no lane on its neighbours, so its
fragments are the same in any packet and in any box.

Frame: the low corner of the lowest voxel the triangle may meet, corners sorted by coordinates, axes
(u, v, w) with w the normal's largest component: (x, y, z), (y, z, x) or (z, x, y). Ties are
one-sided.

Values are rows of lanes in flat arrays, see `lanes.py`.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel, part
from gstream.kernels.cover import (
    SLOT_ROWS,
    cover_edge,
    cover_level,
)
from gstream.kernels.lanes import (
    LANES,
    at,
)
from gstream.kernels.packet_frame import (
    first_axis,
    load,
    measure_normal,
    move_to_frame,
    name_axis,
    pick,
)
from gstream.kernels.packet_overlap import (
    limit_axis,
    meet,
    prepare_centres,
    prepare_edges,
    test_centre,
    test_squares,
    test_voxel,
)
from gstream.kernels.packet_rows import (
    AFFINE_ROWS,
    ALL_MISSED,
    CENTRE,
    EDGE,
    EDGE_ROWS,
    MISSED,
    NAME_ROWS,
    OWNER,
    REAL_ROWS,
    SHAPES,
    THRESHOLD,
    VALUE,
    VERDICT_ROWS,
    WORD_ROWS,
)
from gstream.kernels.packet_values import (
    area_of_voxel,
    mean_channels,
    mean_of_voxel,
    name_voxel,
    prepare_channels,
    start_row,
    write_channels,
    write_voxel,
)

I64 = NDArray[np.int64]
I32 = NDArray[np.int32]
U32 = NDArray[np.uint32]
U8 = NDArray[np.uint8]
F64 = NDArray[np.float64]

SNAP_BITS = 16  # up to here corners fit 20 bits and plane values 62
DEEPEST = 4  # a column along w meets at most that many voxels: n_w is the largest component
LEAST_BUFFER = LANES * EDGE * EDGE * DEEPEST + 1


@part
def shape(k: int, words: I64) -> None:
    """Into row VALUE: a code of the box' voxels along u, v, w, or SHAPES where it is not small."""
    for lane in range(LANES):
        x0, y0, z0 = words[at(0, lane)], words[at(1, lane)], words[at(2, lane)]
        x1, y1, z1 = words[at(3, lane)], words[at(4, lane)], words[at(5, lane)]
        x2, y2, z2 = words[at(6, lane)], words[at(7, lane)], words[at(8, lane)]
        x = (max(x0, x1, x2) >> k) - (min(x0, x1, x2) >> k)
        y = (max(y0, y1, y2) >> k) - (min(y0, y1, y2) >> k)
        z = (max(z0, z1, z2) >> k) - (min(z0, z1, z2) >> k)
        n_x = abs((y1 - y0) * (z2 - z0) - (z1 - z0) * (y2 - y0))
        n_y = abs((z1 - z0) * (x2 - x0) - (x1 - x0) * (z2 - z0))
        n_z = abs((x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0))
        u = first_axis(n_x, n_y, n_z)
        wide, long, deep = pick(u, x, y, z), pick(u, y, z, x), pick(u, z, x, y)
        # In serpentines, so that neighbours in the order differ by one voxel along one axis.
        turned_wide = EDGE - 1 - wide if long & 1 else wide
        turned_long = EDGE - 1 - long if deep & 1 else long
        code = EDGE * EDGE * deep + EDGE * turned_long + turned_wide
        small = (max(x, y, z) < EDGE) & ((max(n_x, n_y, n_z) > 0) | (code == 0))
        words[at(VALUE, lane)] = code if small else SHAPES


@kernel
def arrange(
    corners: I64, rules: tuple[int, int, bool, bool], order: I32, shapes: NDArray[np.int16]
) -> int:
    """Order triangles by the shape of their box; those for `fragments.emit` come last.

    corners : (n, 3, 3) i8   snap units
    order : (n,) i4   out: a permutation of the triangles, stable within a shape
    shapes : (n,) i2   out: the shape of triangle order[i], see `shape`
    returns : int   how many of `order` go to `emit_packets`
    """
    n = corners.shape[0]
    codes = np.empty(n, np.int16)
    starts = np.zeros(SHAPES + 2, np.int64)
    words = np.empty(WORD_ROWS * LANES, np.int64)
    for t in range(n):
        order[t] = t
    k, mode, closed, _ = rules
    possible = k <= SNAP_BITS and mode != 26 and not closed
    for first in range(0, n, LANES):
        count = min(LANES, n - first)
        if possible:
            load(corners, order, first, count, words)
            shape(k, words)
        for lane in range(count):
            code = words[at(VALUE, lane)] if possible else SHAPES
            codes[first + lane] = code
            starts[code + 1] += 1
    for code in range(SHAPES + 1):
        starts[code + 1] += starts[code]
    small = starts[SHAPES]
    for t in range(n):
        place = starts[codes[t]]
        order[place], shapes[place] = t, codes[t]
        starts[codes[t]] = place + 1
    return np.int64(small)


@kernel
def emit_packets(
    corners: I64,
    values: F64,
    order: I32,
    shapes: NDArray[np.int16],
    small: int,
    rules: tuple[int, int, bool, bool],
    room: tuple[int, int, int],
    first: int,
    normals: F64,
    masks: U8,
    assigned: NDArray[np.bool_],
    keys: U32,
    owners: I32,
    hits: NDArray[np.bool_],
    areas: F64,
    channels: F64,
) -> tuple[int, int]:
    """Fragments of the small triangles of a batch, until the buffer is full or all are done.

    order, shapes, small : as `arrange` made them
    first : place in `order` to go on with
    others : see `fragments.emit`; buffers of at least LEAST_BUFFER
    returns : (place in `order` to go on with, fragments written)
    """
    k, mode, _, both = rules
    six = mode == 6
    words = np.empty(WORD_ROWS * LANES, np.int64)
    edges = np.empty(EDGE_ROWS * LANES, np.int32)
    limits = np.empty(3 * EDGE * LANES, np.int32)
    squares = np.empty(3 * EDGE * EDGE * LANES, np.int32)
    centres = np.empty(3 * EDGE * EDGE * LANES if six else 0, np.int32)
    verdicts = np.empty(VERDICT_ROWS * LANES, np.int32)
    codes = np.empty(3 * EDGE * LANES, np.uint32)
    names = np.empty(NAME_ROWS * LANES, np.uint32)
    reals = np.empty(REAL_ROWS * LANES)
    slots = np.empty(SLOT_ROWS * LANES, np.int64)
    own, beyond = np.empty(SHAPES * LANES), np.empty(SHAPES * LANES)
    channel_count = values.shape[2]
    moments = np.empty(3 * SHAPES * LANES if channel_count else 0)
    affine = np.empty(AFFINE_ROWS * channel_count * LANES)
    count = 0
    while first < small:
        used = min(LANES, small - first)
        size = largest(shapes, first, used)
        wide, long, deep = size
        if count + LANES * wide * long * min(deep, DEEPEST) >= keys.shape[0]:
            break
        load(corners, order, first, used, words)
        for lane in range(LANES):
            names[at(OWNER, lane)] = order[first + min(lane, used - 1)]
        move_to_frame(words, k)
        measure_normal(words, names, used, both, reals, normals, masks)
        for axis in range(3):
            name_axis(words, axis, size[axis], codes)
            limit_axis(words, room, axis, size[axis], limits)
        for lane in range(used, LANES):  # a repeated triangle writes nothing
            for i in range(wide):
                limits[at(i, lane)] = -1
        prepare_edges(words, k, 0, six, edges)
        prepare_edges(words, k, 1, six, edges)
        prepare_edges(words, k, 2, six, edges)
        test_squares(edges, limits, 0, THRESHOLD, 3, long, deep, squares)
        test_squares(edges, limits, 1, THRESHOLD + 9, 3, deep, wide, squares)
        test_squares(edges, limits, 2, THRESHOLD + 18, 3, wide, long, squares)
        if six:
            prepare_centres(words, k)
            test_squares(edges, limits, 0, CENTRE, 1, long, deep, centres)
            test_squares(edges, limits, 1, CENTRE + 3, 1, deep, wide, centres)
            test_squares(edges, limits, 2, CENTRE + 6, 1, wide, long, centres)
        for i in range(np.uint64(wide * long * deep * LANES)):
            own[i] = 0.0
            beyond[i] = 0.0
        if channel_count:
            moments[: 3 * wide * long * deep * LANES] = 0.0
            prepare_channels(words, k, values, names, affine)
        cover_edge(words, k, 0, 1, size, reals, slots, own, beyond, moments)
        cover_edge(words, k, 1, 2, size, reals, slots, own, beyond, moments)
        cover_edge(words, k, 2, 0, size, reals, slots, own, beyond, moments)
        for level in range(1, deep):
            cover_level(words, k, level, size, reals, slots, own, beyond, moments)
        for lane in range(LANES):
            verdicts[at(ALL_MISSED, lane)] = -1
            verdicts[at(MISSED, lane)] = 0
        for l in range(deep):
            for j in range(long):
                start_row(words, reals, j, l)
                for i in range(wide):
                    test_voxel(words, squares, i, j, l, verdicts)
                    if six:
                        test_centre(words, centres, i, j, l, verdicts)
                    meet(words, verdicts)
                    voxel = (l * long + j) * wide + i
                    if channel_count:
                        mean_of_voxel(own, moments, voxel, wide * long * deep, i, j, reals)
                        mean_channels(reals, channel_count, affine)
                        write_channels(verdicts, affine, np.uint64(count), channels)
                    area_of_voxel(own, beyond, voxel, reals)
                    name_voxel(codes, i, j, l, names)
                    count = write_voxel(
                        verdicts, names, reals, np.uint64(count), keys, owners, hits, areas
                    )
        for lane in range(used):
            if verdicts[at(ALL_MISSED, lane)] >= 0:
                assigned[names[at(OWNER, lane)]] = True
        first += used
    return first, count


@part
def largest(shapes: NDArray[np.int16], first: int, used: int) -> tuple[int, int, int]:
    """Voxels along u, v, w of a box that holds the box of every triangle of a packet."""
    wide, long, deep = 0, 0, 0
    for place in range(first, first + used):
        code = np.int64(shapes[place])
        this_deep, this_long, this_wide = code >> 6, code >> 3 & 7, code & 7
        this_long = EDGE - 1 - this_long if this_deep & 1 else this_long
        this_wide = EDGE - 1 - this_wide if this_long & 1 else this_wide
        wide, long, deep = max(wide, this_wide), max(long, this_long), max(deep, this_deep)
    return wide + 1, long + 1, deep + 1
