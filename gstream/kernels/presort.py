"""Sorting snapped triangles into cells: counting, then an index of its own for each cell.

A small triangle (extent below half a cell) goes to each cell that its box touches, by three u16
indices into vertices relative to the cell: 21 bits per coordinate, one u64 per vertex. That is 10
to 11 bytes a triangle where triangles share vertices, 24 if each had its own. A large one keeps
full-width coordinates. Source: distribution counting, Knuth TAOCP vol. 3, section 5.2, algorithm D.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel, part

I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
U16 = NDArray[np.uint16]
U32 = NDArray[np.uint32]
U64 = NDArray[np.uint64]

SMALL, SPANNING, LARGE, OUTSIDE = 0, 1, 2, 3  # kinds; SPANNING is small, in several cells
U1, U2 = np.uint64(1), np.uint64(2)
COORDINATE_BITS = 21
U21 = np.uint64(COORDINATE_BITS)
U42 = np.uint64(2 * COORDINATE_BITS)
MASK21 = np.uint64((1 << COORDINATE_BITS) - 1)
SEGMENT_VERTICES = 1 << 16  # what indices of 16 bits can name


@kernel
def gather(triangles: NDArray[np.integer], points: NDArray[np.integer], corners: NDArray) -> None:
    """corners[t, c] = points[triangles[t, c]].

    triangles : (n, 3) unsigned; points : (v, 3) integers
    corners : (n, 3, 3) integers   out
    errors : none; indices are below v
    """
    for t in range(triangles.shape[0]):
        for c in range(3):
            v = np.uint64(triangles[t, c])
            for axis in range(3):
                corners[t, c, axis] = points[v, axis]


@part
def span(a: int, b: int, c: int, rules: tuple[int, int, int, bool]) -> tuple[int, int, int]:
    """First and last cell that a triangle's box meets along an axis, by the tie rule; its kind."""
    k, cell_bits, resolution, closed = rules
    low, high = min(a, b, c), max(a, b, c)
    large = high - low >= np.int64(1) << (k + cell_bits - 1)
    low, high = -((-low) >> k) - 1 if closed else low >> k, high >> k
    if high < 0 or low >= resolution:
        return 0, 0, OUTSIDE
    first, last = max(low, 0) >> cell_bits, min(high, resolution - 1) >> cell_bits
    if large:
        return first, last, LARGE
    spans = low < 0 or high >= resolution or first != last
    return first, last, SPANNING if spans else SMALL


@part
def spans(
    vertices: I32, triangles: U32, t: int, rules: tuple[int, int, int, bool]
) -> tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]:
    """`span` of triangle t along x, y, z."""
    a, b, c = np.uint64(triangles[t, 0]), np.uint64(triangles[t, 1]), np.uint64(triangles[t, 2])
    x = span(np.int64(vertices[a, 0]), np.int64(vertices[b, 0]), np.int64(vertices[c, 0]), rules)
    y = span(np.int64(vertices[a, 1]), np.int64(vertices[b, 1]), np.int64(vertices[c, 1]), rules)
    z = span(np.int64(vertices[a, 2]), np.int64(vertices[b, 2]), np.int64(vertices[c, 2]), rules)
    return x, y, z


@part
def lone_cell(
    vertices: I32, triangles: U32, t: int, rules: tuple[int, int, int, bool]
) -> tuple[int, int, int]:
    """The cell of a SMALL triangle, x = -1 for any other: as `spans`, in a third of its time."""
    k, cell_bits, resolution, closed = rules
    a, b, c = np.uint64(triangles[t, 0]), np.uint64(triangles[t, 1]), np.uint64(triangles[t, 2])
    x0, y0, z0 = np.int64(vertices[a, 0]), np.int64(vertices[a, 1]), np.int64(vertices[a, 2])
    x1, y1, z1 = np.int64(vertices[b, 0]), np.int64(vertices[b, 1]), np.int64(vertices[b, 2])
    x2, y2, z2 = np.int64(vertices[c, 0]), np.int64(vertices[c, 1]), np.int64(vertices[c, 2])
    x_low, x_high = min(x0, x1, x2), max(x0, x1, x2)
    y_low, y_high = min(y0, y1, y2), max(y0, y1, y2)
    z_low, z_high = min(z0, z1, z2), max(z0, z1, z2)
    extent = max(x_high - x_low, y_high - y_low, z_high - z_low)
    # Closed ties reach one voxel further down where the low corner lies on the lattice.
    touch = np.int64(closed)
    x_low, y_low, z_low = (x_low - touch) >> k, (y_low - touch) >> k, (z_low - touch) >> k
    x_high, y_high, z_high = x_high >> k, y_high >> k, z_high >> k
    inside = (min(x_low, y_low, z_low) >= 0) & (max(x_high, y_high, z_high) < resolution)
    across = ((x_low ^ x_high) | (y_low ^ y_high) | (z_low ^ z_high)) >> cell_bits
    if inside & (across == 0) & (extent < np.int64(1) << (k + cell_bits - 1)):
        return x_low >> cell_bits, y_low >> cell_bits, z_low >> cell_bits
    return -1, 0, 0


@part
def is_degenerate(vertices: I32, triangles: U32, t: int) -> bool:
    """The snapped triangle has no area."""
    a, b, c = np.uint64(triangles[t, 0]), np.uint64(triangles[t, 1]), np.uint64(triangles[t, 2])
    x, y, z = np.int64(vertices[a, 0]), np.int64(vertices[a, 1]), np.int64(vertices[a, 2])
    e_x, e_y, e_z = vertices[b, 0] - x, vertices[b, 1] - y, vertices[b, 2] - z
    f_x, f_y, f_z = vertices[c, 0] - x, vertices[c, 1] - y, vertices[c, 2] - z
    n_x, n_y, n_z = e_y * f_z - e_z * f_y, e_z * f_x - e_x * f_z, e_x * f_y - e_y * f_x
    return n_x | n_y | n_z == 0


@part
def cell_key(x: int, y: int, z: int, spread: U32) -> int:
    """Morton code of a cell, unsigned: a signed index costs a test for negative ones."""
    x, y, z = np.uint64(x), np.uint64(y), np.uint64(z)
    return np.uint64(spread[x]) | np.uint64(spread[y]) << U1 | np.uint64(spread[z]) << U2


@kernel
def classify(
    vertices: I32, triangles: U32, rules: tuple[int, int, int, bool], spread: U32,
    kinds: NDArray[np.uint8], keys: U32, counts: I64,
) -> int:  # fmt: skip
    """Kind of each triangle, and how many small ones each cell gets.

    vertices, triangles : (v, 3) i4, (n, 3) u4   snap units in the grid; rows of vertices
    rules : (snap bits, log2 of the cell edge, resolution, closed ties)
    spread : (256,) u4   Morton code of (i, 0, 0)
    kinds : (n,) u1   out
    keys : (n,) u4   out: Morton code of the one cell of each SMALL triangle
    counts : (8^bits,) i8   references per Morton cell, added to
    returns : int   triangles whose snapped area is zero (those outside not counted)
    """
    degenerate = 0
    for t in range(np.uint64(triangles.shape[0])):
        x, y, z = lone_cell(vertices, triangles, t, rules)
        if x >= 0:
            kinds[t], keys[t] = SMALL, cell_key(x, y, z, spread)
            counts[np.uint64(keys[t])] += 1
            degenerate += is_degenerate(vertices, triangles, t)
            continue
        (x0, x1, kind_x), (y0, y1, kind_y), (z0, z1, kind_z) = spans(vertices, triangles, t, rules)
        kind = max(kind_x, kind_y, kind_z)
        kinds[t] = kind
        if kind == OUTSIDE:
            continue
        degenerate += is_degenerate(vertices, triangles, t)
        if kind == LARGE:
            continue
        for z in range(z0, z1 + 1):
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    keys[t] = cell_key(x, y, z, spread)
                    counts[np.uint64(keys[t])] += 1
    return degenerate


@kernel
def sort_by_cell(
    vertices: I32, triangles: U32, kinds: NDArray[np.uint8], keys: U32,
    rules: tuple[int, int, int, bool], spread: U32, offsets: I64, order: U32,
) -> None:  # fmt: skip
    """Number of each small triangle, once for every cell that its box touches, cell by cell.

    vertices, triangles, kinds, keys, rules, spread : as of `classify`
    offsets : (8^bits,) i8   next free place of each Morton cell, advanced
    order : (references,) u4   out; within a cell in the triangles' order
    """
    for t in range(np.uint64(triangles.shape[0])):
        if kinds[t] == SMALL:
            key = np.uint64(keys[t])
            order[np.uint64(offsets[key])] = t
            offsets[key] += 1
        elif kinds[t] == SPANNING:
            (x0, x1, _), (y0, y1, _), (z0, z1, _) = spans(vertices, triangles, t, rules)
            for z in range(z0, z1 + 1):
                for y in range(y0, y1 + 1):
                    for x in range(x0, x1 + 1):
                        key = cell_key(x, y, z, spread)
                        order[np.uint64(offsets[key])] = t
                        offsets[key] += 1


@kernel
def index_segment(
    vertices: I32, triangles: U32, chosen: U32, low: I64,
    segment: int, seen: U32, places: U16, packed: U64, indices: U16,
) -> tuple[int, int]:  # fmt: skip
    """Give the vertices of some triangles numbers of their own, by first use, and pack them.

    vertices, triangles : (v, 3) i4, (n, 3) u4
    chosen : (m,) u4   numbers of triangles; the rest is left for another segment at
        SEGMENT_VERTICES vertices
    low : (3,) i8   what packed coordinates are relative to, snap units
    segment, seen : int, (v,) u4   a number of this segment, above 0; of each vertex' last one
    places : (v,) u2   scratch: each vertex' number in its last segment
    packed : (SEGMENT_VERTICES,) u8   out: x | y << 21 | z << 42
    indices : (m or more, 3) u2   out
    returns : (triangles, vertices) that the segment has
    """
    count = np.int64(0)
    for i in range(chosen.size):
        if count > SEGMENT_VERTICES - 3:
            return i, count
        t = np.uint64(chosen[i])
        for c in range(3):
            v = np.uint64(triangles[t, c])
            if seen[v] != segment:
                seen[v], places[v] = segment, count
                x = np.uint64(vertices[v, 0] - low[0])
                y = np.uint64(vertices[v, 1] - low[1])
                z = np.uint64(vertices[v, 2] - low[2])
                packed[count] = x | (y << U21) | (z << U42)
                count += 1
            indices[i, c] = places[v]
    return chosen.size, count


@kernel
def unpack(packed: U64, half_cell: int, shift: I64, points: I64) -> None:
    """Packed vertices back to snap units relative to a box inside the cell.

    packed : (n,) u8
    half_cell : half the cell's edge, snap units
    shift : (3,) i8   the box' low corner in the cell, snap units
    points : (n, 3) i8   out
    """
    for v in range(packed.size):
        word = packed[v]
        points[v, 0] = np.int64(word & MASK21) - half_cell - shift[0]
        points[v, 1] = np.int64((word >> U21) & MASK21) - half_cell - shift[1]
        points[v, 2] = np.int64(word >> U42) - half_cell - shift[2]


@kernel
def within(
    corners: I64, k: int, closed: bool, shift: I64, room: I64, single: NDArray[np.bool_]
) -> None:
    """Which triangles meet voxels of one cell only: presort has told the fate of the others.

    corners : (n, 3, 3) i8   snap units relative to a box in the cell
    shift : (3,) i8   the box' low corner in the cell, snap units
    room : (3,) i8   voxels of the cell along x, y, z
    single : (n or more,) bool   out
    """
    # The first voxel is 0 or more: low >= 0, or > 0 with closed ties. The last: high < room.
    x, y, z = np.int64(closed) - shift[0], np.int64(closed) - shift[1], np.int64(closed) - shift[2]
    wide, deep, high = (room[0] << k) - closed, (room[1] << k) - closed, (room[2] << k) - closed
    for t in range(corners.shape[0]):
        inside = True
        for c in range(3):  # as unsigned numbers, what is below 0 is far above
            inside &= np.uint64(corners[t, c, 0] - x) < np.uint64(wide)
            inside &= np.uint64(corners[t, c, 1] - y) < np.uint64(deep)
            inside &= np.uint64(corners[t, c, 2] - z) < np.uint64(high)
        single[t] = inside
