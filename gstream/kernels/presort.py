"""Sorting snapped triangles into cells: counting, then scattering packed records.

A small triangle (extent below half a cell) is packed relative to each cell that its box touches:
21 bits per coordinate, one u64 per corner, 24 bytes. A large one keeps full-width coordinates.
Source: distribution counting, Knuth TAOCP vol. 3, section 5.2, algorithm D.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel, part

I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
U32 = NDArray[np.uint32]
U64 = NDArray[np.uint64]

SMALL, SPANNING, LARGE, OUTSIDE = 0, 1, 2, 3  # kinds; SPANNING is small, in several cells
U1, U2 = np.uint64(1), np.uint64(2)
COORDINATE_BITS = 21
U21 = np.uint64(COORDINATE_BITS)
U42 = np.uint64(2 * COORDINATE_BITS)
MASK21 = np.uint64((1 << COORDINATE_BITS) - 1)


@kernel
def gather(triangles: NDArray[np.integer], snapped: I64, corners: I32) -> None:
    """corners[t, c] = snapped[triangles[t, c]].

    triangles : (n, 3) unsigned   vertex ids in the chunk
    snapped : (v, 3) i8   snap units
    corners : (n, 3, 3) i4   out
    """
    for t in range(triangles.shape[0]):
        for c in range(3):
            for axis in range(3):
                corners[t, c, axis] = snapped[triangles[t, c], axis]


@part
def span(
    corners: I32, t: int, axis: int, rules: tuple[int, int, int, bool]
) -> tuple[int, int, int]:
    """First and last cell that triangle t's box meets along an axis, by the tie rule; its kind."""
    k, cell_bits, resolution, closed = rules
    a = np.int64(corners[t, 0, axis])
    b = np.int64(corners[t, 1, axis])
    c = np.int64(corners[t, 2, axis])
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
def is_degenerate(corners: I32, t: int) -> bool:
    """The snapped triangle has no area."""
    for axis in range(3):
        p, q = (axis + 1) % 3, (axis + 2) % 3
        ep = np.int64(corners[t, 1, p]) - corners[t, 0, p]
        eq = np.int64(corners[t, 1, q]) - corners[t, 0, q]
        fp = np.int64(corners[t, 2, p]) - corners[t, 0, p]
        fq = np.int64(corners[t, 2, q]) - corners[t, 0, q]
        if ep * fq - eq * fp != 0:
            return False
    return True


@part
def cell_key(x: int, y: int, z: int, spread: U32) -> int:
    """Morton code of a cell, unsigned: a signed index costs a test for negative ones."""
    x, y, z = np.uint64(x), np.uint64(y), np.uint64(z)
    return np.uint64(spread[x]) | np.uint64(spread[y]) << U1 | np.uint64(spread[z]) << U2


@kernel
def classify(
    corners: I32, rules: tuple[int, int, int, bool], spread: U32,
    kinds: NDArray[np.uint8], counts: I64,
) -> int:  # fmt: skip
    """Kind of each triangle, and how many small ones each cell gets.

    corners : (n, 3, 3) i4   snap units in the grid
    rules : (snap bits, log2 of the cell edge, resolution, closed ties)
    spread : (256,) u4   Morton code of (i, 0, 0)
    kinds : (n,) u1   out
    counts : (8^bits,) i8   references per Morton cell, added to
    returns : int   triangles whose snapped area is zero (those outside not counted)
    """
    degenerate = 0
    for t in range(corners.shape[0]):
        x0, x1, kind_x = span(corners, t, 0, rules)
        y0, y1, kind_y = span(corners, t, 1, rules)
        z0, z1, kind_z = span(corners, t, 2, rules)
        kind = max(kind_x, kind_y, kind_z)
        kinds[t] = kind
        if kind == OUTSIDE:
            continue
        degenerate += is_degenerate(corners, t)
        if kind == LARGE:
            continue
        for z in range(z0, z1 + 1):
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    counts[cell_key(x, y, z, spread)] += 1
    return degenerate


@kernel
def scatter(
    corners: I32, extras: U32, kinds: NDArray[np.uint8], rules: tuple[int, int, int, bool],
    spread: U32, offsets: I64, packed: U64, packed_extras: U32,
) -> None:  # fmt: skip
    """Write each small triangle to every cell that its box touches.

    extras : (n, 3, e) u4   attribute words at the corners
    offsets : (8^bits,) i8   next free record of each Morton cell, advanced
    packed : (references, 3) u8   out: x | y << 21 | z << 42, snap units from half a cell below
    packed_extras : (references, 3, e) u4   out
    """
    cell = np.int64(1) << (rules[0] + rules[1])
    half = cell >> 1
    for t in range(corners.shape[0]):
        if kinds[t] > SPANNING:
            continue
        x0, x1, _ = span(corners, t, 0, rules)
        y0, y1, _ = span(corners, t, 1, rules)
        z0, z1, _ = span(corners, t, 2, rules)
        for z in range(z0, z1 + 1):
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    key = cell_key(x, y, z, spread)
                    at = np.uint64(offsets[key])
                    offsets[key] += 1
                    for c in range(3):
                        px = np.uint64(corners[t, c, 0] - x * cell + half)
                        py = np.uint64(corners[t, c, 1] - y * cell + half)
                        pz = np.uint64(corners[t, c, 2] - z * cell + half)
                        packed[at, c] = px | (py << U21) | (pz << U42)
                        for e in range(extras.shape[2]):
                            packed_extras[at, c, e] = extras[t, c, e]


@kernel
def unpack(packed: U64, half_cell: int, shift: I64, corners: I64) -> None:
    """Packed corners back to snap units relative to a box inside the cell.

    packed : (n, 3) u8
    half_cell : half the cell's edge, snap units
    shift : (3,) i8   the box' low corner in the cell, snap units
    corners : (n, 3, 3) i8   out
    """
    for t in range(packed.shape[0]):
        for c in range(3):
            word = packed[t, c]
            corners[t, c, 0] = np.int64(word & MASK21) - half_cell - shift[0]
            corners[t, c, 1] = np.int64((word >> U21) & MASK21) - half_cell - shift[1]
            corners[t, c, 2] = np.int64(word >> U42) - half_cell - shift[2]


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
