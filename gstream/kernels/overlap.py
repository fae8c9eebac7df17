"""Exact overlap of a triangle with voxels and their targets: thresholds for integer tests.

All coordinates are int64 snap units (2^-k voxel) in the triangle's own frame: relative to the low
corner of the lowest voxel of its box. A test is `A*i + B*j + threshold >= 0` on voxel indices: the
division by 2^k is done once, in the threshold, by a floor that loses nothing (voxel corners are
multiples of 2^k). Tie rule `one-sided`: the surface is shifted by an infinitesimal (e1 >> e2 >> e3
> 0), so an axis value of exactly 0 takes the sign of the axis' first non-zero component.

Bits: extents up to 2^26, normals up to 2^52. Plane values are taken relative to the low voxel of
the window being filled (at most 256^3 voxels): that one value is summed modulo 2^64 in uint64,
where wrapping is defined (signed overflow is not, and LLVM uses that), and is exact once
`plane_out_of_reach` has shown that it is below 2^62; inside the window nothing reaches 2^63.

Source: Akenine-Moeller 2001 (separating axes), Laine 2013 (targets), numerics.md section 1 and 2.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import part
from gstream.kernels.clip import VECTOR_UNITS

I64 = NDArray[np.int64]
F64 = NDArray[np.float64]

# Slots of the `plane` array.
N_X, N_Y, N_Z, CEIL, FLOOR, N_POSITIVE, N_NEGATIVE = 0, 1, 2, 3, 4, 5, 6
CENTRE_CEIL, CENTRE_FLOOR = 7, 10  # three slots each: targets along x, y, z
PLANE_SLOTS = 13


@part
def first_sign(x: int, y: int, z: int) -> int:
    """Sign of the first non-zero component: the side to which the infinitesimal shift moves."""
    if x != 0:
        return 1 if x > 0 else -1
    if y != 0:
        return 1 if y > 0 else -1
    if z != 0:
        return 1 if z > 0 else -1
    return 0


@part
def tie(sign: int, closed: bool) -> int:
    """1 where an axis value of exactly 0 separates: the shift moves the triangle up the axis."""
    return 1 if sign > 0 and not closed else 0


@part
def prepare_normal(tri: I64, plane: I64) -> None:
    """The exact normal (b - a) x (c - a) of the sorted corners, and sums of its signed parts."""
    positive, negative = 0, 0
    for c in range(3):
        p, q = (c + 1) % 3, (c + 2) % 3
        n = (tri[1, p] - tri[0, p]) * (tri[2, q] - tri[0, q]) - (tri[1, q] - tri[0, q]) * (
            tri[2, p] - tri[0, p]
        )
        plane[c] = n
        positive += max(n, 0)
        negative += min(n, 0)
    plane[N_POSITIVE] = positive
    plane[N_NEGATIVE] = negative


@part
def dominant_axis(plane: I64, box: I64) -> int:
    """The axis of the largest normal component; of the smallest extent where the area is zero."""
    x, y, z = abs(plane[0]), abs(plane[1]), abs(plane[2])
    if x == 0 and y == 0 and z == 0:
        x, y, z = -box[2, 0], -box[2, 1], -box[2, 2]
    if z >= x and z >= y:
        return 2
    return 1 if y >= x else 0


@part
def face_mask(plane: I64, turn: int, both: bool) -> int:
    """Bits -x, +x, -y, +y, -z, +z of the exact normal's non-zero components."""
    mask = 0
    for c in range(3):
        n = plane[c] * turn
        if n != 0:
            mask |= 3 << (2 * c) if both else (2 if n > 0 else 1) << (2 * c)
    return mask


@part
def prepare_direction(plane: I64, turn: int, normal: F64) -> float:
    """The normal of the input's winding, VECTOR_UNITS long; returns the integer normal's length."""
    x, y, z = np.float64(plane[0]), np.float64(plane[1]), np.float64(plane[2])
    length = np.sqrt(x * x + y * y + z * z)
    for c in range(3):
        normal[c] = turn * VECTOR_UNITS * (plane[c] / length) if length > 0.0 else 0.0
    return length


@part
def plane_out_of_reach(plane: I64, tri: I64, k: int, low: I64) -> bool:
    """True when the plane is so far from voxel `low` that it misses the 256^3 voxels above it.

    A float64 estimate with an error below 2^20 against a margin of 2^60: it decides nothing that is
    near. Where it is False, the plane values of the window are below 2^63.
    """
    scale = 1.0 / (1 << k)
    estimate = 0.0
    for c in range(3):
        estimate += plane[c] * (low[c] - tri[0, c] * scale)
    return abs(estimate) > 2.0**62


@part
def prepare_plane(tri: I64, k: int, closed: bool, low: I64, plane: I64) -> None:
    """Plane thresholds of a triangle for the voxels of a window.

    tri : (3, 3) i8   corners in the triangle's frame, snap units
    low : (3,) i8   the window's low voxel in the triangle's frame
    plane : (PLANE_SLOTS,) i8   normal as prepare_normal left it; out: ceil and floor of
        n.(v - low * 2^k) / 2^k with the tie rule folded in, and ceil and floor for the segments
        through the voxel centre along x, y, z
    source : numerics.md section 2, tier L
    """
    sign = first_sign(plane[N_X], plane[N_Y], plane[N_Z])
    up, down = tie(sign, closed), tie(-sign, closed)
    mask = (1 << k) - 1
    wrapped, fraction = np.uint64(0), 0
    for c in range(3):
        n, v = plane[c], tri[0, c]
        # n.(v - low * 2^k) = 2^k * whole + fraction
        wrapped += np.uint64(n) * np.uint64((v >> k) - low[c])
        wrapped += np.uint64((n >> k) * (v & mask))
        fraction += (n & mask) * (v & mask)
    whole = np.int64(wrapped)
    plane[CEIL] = whole - ((-fraction - up) >> k)
    plane[FLOOR] = whole + ((fraction - down) >> k)
    half = np.int64(1) << (k - 1)
    for r in range(3):
        across = plane[(r + 1) % 3] + plane[(r + 2) % 3]
        odd = half * (across & 1)
        plane[CENTRE_CEIL + r] = whole - (across >> 1) - ((odd - fraction - up) >> k)
        plane[CENTRE_FLOOR + r] = whole - (across >> 1) + ((fraction - down - odd) >> k)


@part
def prepare_edges(tri: I64, plane: I64, k: int, closed: bool, edges: I64, centres: I64) -> None:
    """Thresholds of the nine edge-times-axis tests: three 2D edge tests in each projection.

    edges : (3, 3, 3) i8   out [axis r, edge, (A, B, threshold)]: the voxel's square in the plane
        (r+1, r+2) is not beyond the edge iff A*i + B*j + threshold >= 0
    centres : (3, 3) i8   out: the same thresholds for the square's centre, not its nearest corner
    A projection of zero area is a segment: two opposite half planes and one that always holds.
    """
    # Spelt out, so that the axes are constants: a loop over r took twice the time.
    edges_of_projection(tri, plane, k, closed, 0, 1, 2, edges, centres)
    edges_of_projection(tri, plane, k, closed, 1, 2, 0, edges, centres)
    edges_of_projection(tri, plane, k, closed, 2, 0, 1, edges, centres)


@part
def edges_of_projection(
    tri: I64, plane: I64, k: int, closed: bool, r: int, p: int, q: int, edges: I64, centres: I64
) -> None:
    """The three edge tests of the projection along axis r onto (p, q)."""
    if plane[r] == 0:
        edge = longest_edge(tri, p, q)
        end = edge + 1 if edge < 2 else 0
        edge_rule(tri, edge, end, k, closed, 1, r, p, q, 0, edges, centres)
        edge_rule(tri, edge, end, k, closed, -1, r, p, q, 1, edges, centres)
        edge_rule(tri, edge, end, k, closed, 0, r, p, q, 2, edges, centres)
    else:
        turn = 1 if plane[r] > 0 else -1
        edge_rule(tri, 0, 1, k, closed, turn, r, p, q, 0, edges, centres)
        edge_rule(tri, 1, 2, k, closed, turn, r, p, q, 1, edges, centres)
        edge_rule(tri, 2, 0, k, closed, turn, r, p, q, 2, edges, centres)


@part
def edge_rule(
    tri: I64, start: int, end: int, k: int, closed: bool, turn: int,
    r: int, p: int, q: int, slot: int, edges: I64, centres: I64,
) -> None:  # fmt: skip
    """Test `slot` of projection r: beyond the edge from corner `start` to `end`, on side `turn`."""
    a = turn * (tri[start, q] - tri[end, q])
    b = turn * (tri[end, p] - tri[start, p])
    sign = first_sign(b, a, 0) if r == 1 else first_sign(a, b, 0)
    c = -a * tri[start, p] - b * tri[start, q] - tie(sign, closed)
    edges[r, slot, 0] = a
    edges[r, slot, 1] = b
    edges[r, slot, 2] = (c + ((max(a, 0) + max(b, 0)) << k)) >> k
    centres[r, slot] = (c + ((a + b) << (k - 1))) >> k


@part
def longest_edge(tri: I64, p: int, q: int) -> int:
    """The edge whose projection onto (p, q) is longest."""
    longest, found = np.int64(0), 0
    for e in range(3):
        end = e + 1 if e < 2 else 0
        d = abs(tri[end, p] - tri[e, p]) + abs(tri[end, q] - tri[e, q])
        if d > longest:
            longest, found = d, e
    return found


@part
def plane_range(plane: I64, inverse: float, w: int, base: int, size: int) -> tuple[int, int]:
    """Voxels 0..size-1 along axis w of a window whose closed cubes the plane meets.

    base : n.(i, j, 0), voxels of the column relative to the window
    inverse : 1 / n_w as a float64: a first guess, made exact by integer tests
    returns : (first, last), both included; first > last when there is none
    """
    n = plane[w]
    above = base - plane[CEIL] + plane[N_POSITIVE]  # + n*l >= 0
    below = base - plane[FLOOR] + plane[N_NEGATIVE]  # + n*l <= 0
    if n < 0:  # mirror, so that both bounds grow with l
        above, below, n = -below, -above, -n
        inverse = -inverse
    first = np.int64(min(max(np.ceil(-above * inverse), 0.0), float(size)))
    while first > 0 and above + n * (first - 1) >= 0:
        first -= 1
    while first < size and above + n * first < 0:
        first += 1
    last = np.int64(min(max(np.floor(-below * inverse), -1.0), size - 1.0))
    while last < size - 1 and below + n * (last + 1) <= 0:
        last += 1
    while last >= 0 and below + n * last > 0:
        last -= 1
    return first, last
