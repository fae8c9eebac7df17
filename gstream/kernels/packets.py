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
from gstream.kernels.clip import AREA_UNITS, VECTOR_UNITS
from gstream.kernels.cover import SLOT_ROWS, WALK_ROWS, cover_edge, cover_level
from gstream.kernels.lanes import LANES, at

I64 = NDArray[np.int64]
I32 = NDArray[np.int32]
U32 = NDArray[np.uint32]
U8 = NDArray[np.uint8]
F64 = NDArray[np.float64]

EDGE = 8  # most voxels of the box along an axis
SHAPES = EDGE**3
NEVER = -(1 << 62)
SNAP_BITS = 16  # up to here corners fit 20 bits and plane values 62
DEEPEST = 4  # a column along w meets at most that many voxels: n_w is the largest component
LEAST_BUFFER = LANES * EDGE * EDGE * DEEPEST + 1

# Rows of `words`. An axis' three rows are u, v, w; so are each corner's.
CORNER = 0  # 9: 3 * corner + axis
NORMAL = 9
OVER, UNDER = 12, 13  # the plane meets voxel x iff over + n.x >= 0 and under - n.x >= 0
BASE, LAST = 14, 17  # the box' first voxel in the room, and its last one relative to it
TURN = 20  # -1 where sorting mirrored the triangle, else 1
FIRST_AXIS = 21  # which of x, y, z axis u is
CENTRE_OVER, CENTRE_UNDER = 22, 25  # as over and under, for the centre segments along u, v, w
VALUE = 28  # n.x of the voxel at hand
MASK = 29  # face mask
PLACES = 30  # 3: the input's corner at each sorted place
WORD_ROWS = 33
# Rows of `edges`: 9 per projection, (a, b, threshold) of three edges; then 9 centre thresholds.
THRESHOLD, CENTRE = 2, 27
ROW_START, LINE = 36, 39  # of three edges, at the start of a row of squares and in it
EDGE_ROWS = 42
# Rows of `verdicts`: sign words of the voxel at hand, and of all voxels so far.
OUTSIDE, MISSED, ALL_MISSED = 0, 1, 2
VERDICT_ROWS = 3
# Rows of `names`: the Morton code of the voxel at hand, the triangle.
CODE, OWNER = 0, 1
NAME_ROWS = 2
# Rows of `reals`, after those of the walks: area units per square of the projection along w; area
# in the voxel at hand, and in those before it in its row; the normal along x, y, z; moment
# along v of those before; the centroid of the fragment at hand.
FACTOR, AREA, PASSED, DIRECTION = WALK_ROWS, WALK_ROWS + 1, WALK_ROWS + 2, WALK_ROWS + 3
PASSED_V, MEAN_U, MEAN_V = WALK_ROWS + 6, WALK_ROWS + 7, WALK_ROWS + 8
REAL_ROWS = WALK_ROWS + 9
# Rows of `affine`, 6 per channel: value at (0, 0), slopes along u and v, least and largest value,
# mean of the fragment at hand. The corners' values stand in the first three while it is made.
LEAST, LARGEST, MEAN = 3, 4, 5
AFFINE_ROWS = 6


@part
def pick(axis: int, x: int, y: int, z: int) -> int:
    """The value of an axis, 0 to 2."""
    return x if axis == 0 else (y if axis == 1 else z)


@part
def load(corners: I64, chosen: I32, first: int, count: int, words: I64) -> None:
    """Rows of the corners of triangles chosen[first : first + count], the last one repeated."""
    for lane in range(LANES):
        t = np.uint64(chosen[np.uint64(first + min(lane, count - 1))])
        for a in range(3):
            for c in range(3):
                words[at(CORNER + 3 * a + c, lane)] = corners[t, a, c]


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


@part
def first_axis(x: int, y: int, z: int) -> int:
    """Axis u, where w is that of the largest of three; of equals the last (as `dominant_axis`)."""
    return 0 if (z >= x) & (z >= y) else (2 if y >= x else 1)


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
        prepare_edges(words, k, 0, edges)
        prepare_edges(words, k, 1, edges)
        prepare_edges(words, k, 2, edges)
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
def turned(first: int, axis: int) -> int:
    """Which of x, y, z an axis of (u, v, w) is, where u is `first`."""
    which = first + axis
    return which - 3 if which >= 3 else which


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
def start_row(words: I64, reals: F64, j: int, l: int) -> None:
    """Values of the first voxel of row (j, l)."""
    for lane in range(LANES):
        words[at(VALUE, lane)] = words[at(NORMAL + 2, lane)] * l + words[at(NORMAL + 1, lane)] * j
        reals[at(PASSED, lane)] = 0.0
        reals[at(PASSED_V, lane)] = 0.0


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


@part
def area_of_voxel(own: F64, beyond: F64, voxel: int, reals: F64) -> None:
    """Row AREA of the next voxel of a row."""
    for lane in range(LANES):
        passed = reals[at(PASSED, lane)]
        reals[at(AREA, lane)] = abs(passed + own[at(voxel, lane)]) * reals[at(FACTOR, lane)]
        reals[at(PASSED, lane)] = passed + beyond[at(voxel, lane)]


@part
def prepare_channels(words: I64, k: int, values: F64, names: U32, affine: F64) -> None:
    """Each channel as an affine function of (u, v), or the corners' mean where there is no area."""
    scale = 1.0 / (1 << k)
    for c in range(values.shape[2]):
        row = AFFINE_ROWS * c
        for lane in range(LANES):
            t = np.uint64(names[at(OWNER, lane)])
            for a in range(3):
                corner = np.uint64(words[at(PLACES + a, lane)])
                affine[at(row + a, lane)] = values[t, corner, c]
        for lane in range(LANES):
            u, v = words[at(CORNER, lane)], words[at(CORNER + 1, lane)]
            a, b = words[at(CORNER + 3, lane)] - u, words[at(CORNER + 4, lane)] - v
            d, e = words[at(CORNER + 6, lane)] - u, words[at(CORNER + 7, lane)] - v
            det = np.float64(a * e - b * d) * scale
            first = affine[at(row, lane)]
            second, third = affine[at(row + 1, lane)] - first, affine[at(row + 2, lane)] - first
            some = words[at(NORMAL + 2, lane)] != 0
            along_u = (second * e - third * b) / det if some else 0.0
            along_v = (third * a - second * d) / det if some else 0.0
            start = first - (along_u * u + along_v * v) * scale
            affine[at(row, lane)] = start if some else first + (second + third) / 3.0
            affine[at(row + 1, lane)], affine[at(row + 2, lane)] = along_u, along_v
            affine[at(row + LEAST, lane)] = first + min(0.0, min(second, third))
            affine[at(row + LARGEST, lane)] = first + max(0.0, max(second, third))


@part
def mean_of_voxel(
    own: F64, moments: F64, voxel: int, voxels: int, i: int, j: int, reals: F64
) -> None:
    """Rows MEAN_U and MEAN_V of the next voxel of a row; before `area_of_voxel`."""
    along_u, along_v, beyond_v = voxel, voxel + voxels, voxel + 2 * voxels
    for lane in range(LANES):
        passed, passed_v = reals[at(PASSED, lane)], reals[at(PASSED_V, lane)]
        area = passed + own[at(voxel, lane)]
        some = area != 0.0
        u = (0.5 * passed + moments[at(along_u, lane)]) / area if some else 0.5
        v = (passed_v + moments[at(along_v, lane)]) / area if some else 0.5
        reals[at(MEAN_U, lane)] = i + min(max(u, 0.0), 1.0)
        reals[at(MEAN_V, lane)] = j + min(max(v, 0.0), 1.0)
        reals[at(PASSED_V, lane)] = passed_v + moments[at(beyond_v, lane)]


@part
def mean_channels(reals: F64, count: int, affine: F64) -> None:
    """Row MEAN of each channel, within the range of the triangle's corners."""
    for c in range(count):
        row = AFFINE_ROWS * c
        for lane in range(LANES):
            value = (
                affine[at(row, lane)]
                + affine[at(row + 1, lane)] * reals[at(MEAN_U, lane)]
                + affine[at(row + 2, lane)] * reals[at(MEAN_V, lane)]
            )
            least, most = affine[at(row + LEAST, lane)], affine[at(row + LARGEST, lane)]
            affine[at(row + MEAN, lane)] = min(max(value, least), most)


@part
def write_channels(verdicts: I32, affine: F64, count: np.uint64, channels: F64) -> None:
    """As `write_voxel`, the channels alone; before it."""
    for c in range(channels.shape[1]):  # outside: else this short loop becomes the vector
        place = count
        for lane in range(LANES):
            channels[place, np.uint64(c)] = affine[at(AFFINE_ROWS * c + MEAN, lane)]
            outside = np.uint64(np.uint32(verdicts[at(OUTSIDE, lane)])) >> np.uint64(31)
            place += np.uint64(1) - outside


@part
def name_voxel(codes: U32, i: int, j: int, l: int, names: U32) -> None:
    """Row CODE of the voxel (i, j, l)."""
    for lane in range(LANES):
        names[at(CODE, lane)] = (
            codes[at(i, lane)] | codes[at(EDGE + j, lane)] | codes[at(2 * EDGE + l, lane)]
        )


@part
def write_voxel(
    verdicts: I32, names: U32, reals: F64, count: np.uint64,
    keys: U32, owners: I32, hits: NDArray[np.bool_], areas: F64,
) -> int:  # fmt: skip
    """Write a fragment for each lane, and keep those that are not outside."""
    for lane in range(LANES):
        keys[count] = names[at(CODE, lane)]
        owners[count] = names[at(OWNER, lane)]
        hits[count] = verdicts[at(MISSED, lane)] >= 0
        areas[count] = reals[at(AREA, lane)]
        count += np.uint64(1) - (np.uint64(np.uint32(verdicts[at(OUTSIDE, lane)])) >> np.uint64(31))
    return np.int64(count)
