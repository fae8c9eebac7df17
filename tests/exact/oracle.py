"""The voxels of a snapped triangle, in Python integers: slow, obvious, and independent of gstream.

Imports nothing of gstream and shares no idea with its kernels: no separating axis decides
anything here. A triangle is a convex polygon that is cut by half-spaces; a target is met if
something is left.

A point is four integers (x, y, z, w), w > 0, standing for (x/w, y/w, z/w) voxels. Cutting an edge
multiplies and adds such points, so nothing is ever rounded.

One-sided ties: the triangle is really moved by d = (2^-128, 2^-256, 2^-384) voxel. That is below
any gap. By the separating-axis theorem the moved triangle meets a closed target iff every one of
finitely many inequalities c + a.d >= 0 holds; in units of 2^-(k+1) voxel, k <= 17, c is an integer
and a is an integer vector made of products of at most three differences of coordinates below 2^30,
so that its components are below 2^95. As d is below 2^-109 of these units, |a.d| < 1: a non-zero c
decides alone. When c = 0 the first non-zero component of a decides, for each component of d is
2^128 times the next. So any d' = (e1 >> e2 >> e3 > 0) that is small enough gives the same set.
"""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from math import gcd, isqrt

Vector = tuple[int, int, int]
Point = tuple[int, int, int, int]
Polygon = list[Point]
Triangle = Sequence[Sequence[int]]  # three vertices, integers in units of 2^-snap_bits voxel

TIES = ("one-sided", "closed")
SEPARATIONS = ("6", "26", "conservative")
SHIFT_BITS = (128, 256, 384)
DIAGONALS: tuple[Vector, ...] = ((1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1))
UNIT_AREA = 2**26  # units of a fragment's area per square voxel


def polygon_of(triangle: Triangle, snap_bits: int, ties: str) -> Polygon:
    """The triangle as a polygon in voxels, moved by d if ties are one-sided."""
    polygon = []
    for vertex in triangle:
        scaled = [int(c) << SHIFT_BITS[2] for c in vertex]
        if ties == "one-sided":
            scaled = [
                c + (1 << (SHIFT_BITS[2] - bits + snap_bits))
                for c, bits in zip(scaled, SHIFT_BITS, strict=True)
            ]
        polygon.append(reduced(scaled[0], scaled[1], scaled[2], 1 << (SHIFT_BITS[2] + snap_bits)))
    return polygon


def reduced(x: int, y: int, z: int, w: int) -> Point:
    """The same point with the smallest integers."""
    divisor = gcd(x, y, z, w)
    return x // divisor, y // divisor, z // divisor, w // divisor


def clipped(polygon: Polygon, normal: Vector, offset: int) -> Polygon:
    """The part of a convex polygon (or segment, or point) where normal . p >= offset."""
    a, b, c = normal
    heights = [
        a * x + b * y + c * z - offset * w for x, y, z, w in polygon
    ]  # w > 0: the sign is right
    if all(h >= 0 for h in heights):
        return polygon
    kept: Polygon = []
    for i, (q, hq) in enumerate(zip(polygon, heights, strict=True)):
        p, hp = polygon[i - 1], heights[i - 1]
        if (hp < 0 < hq) or (hq < 0 < hp):
            s, t = abs(hq), abs(hp)
            kept.append(reduced(*(s * u + t * v for u, v in zip(p, q, strict=True))))
        if hq >= 0:
            kept.append(q)
    return kept


def on_plane(polygon: Polygon, normal: Vector, offset: int) -> Polygon:
    """The part of a convex polygon where normal . p == offset."""
    return clipped(clipped(polygon, normal, offset), opposite(normal), -offset)


def opposite(normal: Vector) -> Vector:
    return -normal[0], -normal[1], -normal[2]


AXES: tuple[Vector, ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def in_box(polygon: Polygon, low: Vector, edge: int) -> Polygon:
    """The part of a convex polygon in the closed cube low .. low + edge."""
    for axis, normal in enumerate(AXES):
        polygon = clipped(polygon, normal, low[axis])
        polygon = clipped(polygon, opposite(normal), -(low[axis] + edge))
    return polygon


def pieces(polygon: Polygon, low: Vector, edge: int) -> Iterator[tuple[Vector, Polygon]]:
    """Every voxel of the cube that the polygon meets, with its part in that closed voxel."""
    yield from _halved(in_box(polygon, low, edge), low, (edge, edge, edge))


def _halved(polygon: Polygon, low: Vector, size: Vector) -> Iterator[tuple[Vector, Polygon]]:
    """A closed box is the union of its closed halves: a half that is not met is left out."""
    if not polygon:
        return
    axis = size.index(max(size))
    if size[axis] == 1:
        yield low, polygon
        return
    half = size[axis] // 2
    middle = low[axis] + half
    below, above = (
        clipped(polygon, n, m) for n, m in ((opposite(AXES[axis]), -middle), (AXES[axis], middle))
    )
    yield from _halved(below, low, _with(size, axis, half))
    yield from _halved(above, _with(low, axis, middle), _with(size, axis, size[axis] - half))


def _with(vector: Vector, axis: int, value: int) -> Vector:
    x, y, z = (value if i == axis else c for i, c in enumerate(vector))
    return x, y, z


def meets_centre_segments(piece: Polygon, voxel: Vector) -> bool:
    """Target of mode 6: the closed segments through the centre, face centre to face centre."""
    for one, other in ((1, 2), (2, 0), (0, 1)):
        plane = on_plane(piece, _with((0, 0, 0), one, 2), 2 * voxel[one] + 1)
        if on_plane(plane, _with((0, 0, 0), other, 2), 2 * voxel[other] + 1):
            return True
    return False


def meets_diagonals(piece: Polygon, voxel: Vector) -> bool:
    """Target of mode 26: the four closed space diagonals of the voxel."""
    x, y, z = (2 * c + 1 for c in voxel)
    for u, v, w in DIAGONALS:
        # on the line through the centre along (u, v, w), v x - u y and w x - u z are constant
        plane = on_plane(piece, (2 * v, -2 * u, 0), v * x - u * y)
        if on_plane(plane, (2 * w, 0, -2 * u), w * x - u * z):
            return True
    return False


def voxels_of(
    triangle: Triangle, snap_bits: int, low: Vector, edge: int, ties: str
) -> dict[str, set[Vector]]:
    """The voxels of the cube that each mode sets: {"conservative": .., "26": .., "6": ..}."""
    met: dict[str, set[Vector]] = {"conservative": set(), "26": set(), "6": set()}
    for voxel, piece in pieces(polygon_of(triangle, snap_bits, ties), low, edge):
        met["conservative"].add(voxel)
        if meets_diagonals(piece, voxel):
            met["26"].add(voxel)
        if meets_centre_segments(piece, voxel):
            met["6"].add(voxel)
    return met


def half_open_voxels(triangle: Triangle, snap_bits: int, low: Vector, edge: int) -> set[Vector]:
    """{floor(p): p in the triangle}.

    A piece that lies in no single upper face of its voxel has a point below all three: the mean of
    its corners.
    """
    found = set()
    for voxel, piece in pieces(polygon_of(triangle, snap_bits, "closed"), low, edge):
        if all(any(p[axis] < (voxel[axis] + 1) * p[3] for p in piece) for axis in range(3)):
            found.add(voxel)
    return found


def normal_of(triangle: Triangle) -> Vector:
    """(b - a) x (c - a), exact, in units of 2^-2k square voxels; its length is twice the area."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = ([int(c) for c in vertex] for vertex in triangle)
    ux, uy, uz, vx, vy, vz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


def face_mask(triangle: Triangle) -> int:
    """Bits 0..5 = -x, +x, -y, +y, -z, +z: the sign of each non-zero component of the normal."""
    bits = 0
    for axis, component in enumerate(normal_of(triangle)):
        if component:
            bits |= 1 << (2 * axis + (component > 0))
    return bits


def area_fractions(
    triangle: Triangle, snap_bits: int, low: Vector, edge: int
) -> dict[Vector, Fraction]:
    """Area of the triangle within each closed voxel / its area; empty for a degenerate triangle.

    Measured on the projection along an axis in which the normal is not zero.
    """
    normal = normal_of(triangle)
    if not any(normal):
        return {}
    axis = next(axis for axis in range(3) if normal[axis])
    whole = Fraction(normal[axis], 4**snap_bits)
    polygon = polygon_of(triangle, snap_bits, "closed")
    return {v: projected_area(piece, axis) / whole for v, piece in pieces(polygon, low, edge)}


def projected_area(polygon: Polygon, axis: int) -> Fraction:
    """Twice the signed area of the polygon's projection along an axis."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    total = Fraction(0)
    for i, q in enumerate(polygon):
        p = polygon[i - 1]
        total += Fraction(p[u] * q[v] - p[v] * q[u], p[3] * q[3])
    return total


def area_in_units(
    triangle: Triangle, snap_bits: int, fraction: Fraction, unit: int = UNIT_AREA
) -> Fraction:
    """fraction x area of the triangle in units of 1/unit square voxel, low by less than 2^-60."""
    squared = sum(c * c for c in normal_of(triangle))  # (2 A)^2, units 2^-4k
    root = Fraction(isqrt(squared << 240), 1 << 120)
    return fraction * root * unit / (2 * 4**snap_bits)


def moment(polygon: Polygon, axis: int, coordinate: int) -> Fraction:
    """Twice the integral of a coordinate over the polygon's projection along an axis (a fan)."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    points = [tuple(Fraction(c, p[3]) for c in p[:3]) for p in polygon]
    total = Fraction(0)
    for q, r in pairwise(points[1:]):
        p = points[0]
        cross = (q[u] - p[u]) * (r[v] - p[v]) - (q[v] - p[v]) * (r[u] - p[u])
        total += cross * (p[coordinate] + q[coordinate] + r[coordinate]) / 3
    return total


def centroids(
    triangle: Triangle, snap_bits: int, low: Vector, edge: int
) -> dict[Vector, list[Fraction]]:
    """Centroid, in voxels, of the triangle's part in each closed voxel, where it has an area."""
    normal = normal_of(triangle)
    axis = next(axis for axis in range(3) if normal[axis])
    found = {}
    for voxel, piece in pieces(polygon_of(triangle, snap_bits, "closed"), low, edge):
        area = projected_area(piece, axis)
        if area:
            found[voxel] = [moment(piece, axis, c) / area for c in range(3)]
    return found
