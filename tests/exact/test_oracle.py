"""The oracle against analytic cases, integer separating axes, and the theorems of the modes."""

from fractions import Fraction
from itertools import product
from math import gcd
from random import Random

import pytest
from exact import oracle, scenes

BOX = ((3, -5, 7), 8)
Vector = tuple[int, int, int]


def cross(u: Vector, v: Vector) -> Vector:
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


def dot(u: Vector, v: Vector) -> int:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def first_sign(axis: Vector) -> int:
    """The sign of axis . d, d = (e1 >> e2 >> e3 > 0)."""
    first = next((c for c in axis if c), 0)
    return (first > 0) - (first < 0)


def as_ints(triangle) -> list[Vector]:
    return [(int(x), int(y), int(z)) for x, y, z in triangle]


def sat_meets_voxel(triangle, snap_bits: int, voxel: Vector, ties: str) -> bool:
    """Separating axes of a triangle (or segment, or point) and a closed voxel, in integers."""
    points = as_ints(triangle)
    edges = [tuple(q - p for p, q in zip(points[i - 1], points[i], strict=True)) for i in range(3)]
    axes = [*oracle.AXES, cross(edges[0], edges[1])]
    axes += [cross(edge, unit) for edge in edges for unit in oracle.AXES]
    corners = [
        tuple((c + bit) << snap_bits for c, bit in zip(voxel, bits, strict=True))
        for bits in product((0, 1), repeat=3)
    ]
    for axis in axes:
        sign = first_sign(axis) if ties == "one-sided" else 0
        above = min(dot(axis, p) for p in points) - max(dot(axis, c) for c in corners)
        below = max(dot(axis, p) for p in points) - min(dot(axis, c) for c in corners)
        if (above, sign) > (0, 0) or (below, sign) < (0, 0):
            return False
    return True


def sat_meets_segment(triangle, p: Vector, q: Vector) -> bool:
    """The moved triangle and the segment p q, by the signs of four determinants and their ties."""
    a, b, c = as_ints(triangle)
    direction = tuple(v - u for u, v in zip(p, q, strict=True))
    normal = oracle.normal_of(triangle)

    def side(axis: Vector, point: Vector, base: Vector) -> int:
        """The sign of axis . (point - base - d)."""
        value = dot(axis, point) - dot(axis, base)
        return (value > 0) - (value < 0) or -first_sign(axis)

    if side(normal, p, a) == side(normal, q, a):
        return False
    turns = set()
    for base, end in ((a, b), (b, c), (c, a)):
        edge = tuple(v - u for u, v in zip(base, end, strict=True))
        turns.add(side(cross(direction, edge), p, base))
    return len(turns - {0}) < 2


def cases(count: int, snap_bits: int = 4):
    for kind in scenes.KINDS:
        for triangle in scenes.soup(kind, 11, count, snap_bits, *BOX):
            yield kind, triangle


def box_voxels():
    low, edge = BOX
    return [
        tuple(c + o for c, o in zip(low, at, strict=True)) for at in product(range(edge), repeat=3)
    ]


@pytest.mark.parametrize("ties", oracle.TIES)
def test_clipping_and_separating_axes_find_the_same_voxels(ties):
    for kind, triangle in cases(3):
        met = oracle.voxels_of(triangle, 4, *BOX, ties)["conservative"]
        expected = {v for v in box_voxels() if sat_meets_voxel(triangle, 4, v, ties)}
        assert met == expected, (kind, triangle.tolist())


def test_clipping_and_determinants_find_the_same_targets():
    unit, checked = 16, 0
    for kind, triangle in cases(6):
        if not any(oracle.normal_of(triangle)):
            continue
        met = oracle.voxels_of(triangle, 4, *BOX, "one-sided")
        for voxel in met["conservative"]:
            centre = tuple(c * unit + unit // 2 for c in voxel)
            for mode, directions in (("6", oracle.AXES), ("26", oracle.DIAGONALS)):
                reach = [tuple(c * unit // 2 for c in d) for d in directions]
                ends = [
                    [tuple(c + s * r for c, r in zip(centre, half, strict=True)) for s in (-1, 1)]
                    for half in reach
                ]
                expected = any(sat_meets_segment(triangle, p, q) for p, q in ends)
                assert (voxel in met[mode]) == expected, (kind, mode, voxel, triangle.tolist())
                checked += 1
    assert checked > 2500


def test_half_open_is_within_one_sided_is_within_closed_and_targets_within_voxels():
    for kind, triangle in cases(6):
        closed = oracle.voxels_of(triangle, 4, *BOX, "closed")
        moved = oracle.voxels_of(triangle, 4, *BOX, "one-sided")
        half_open = oracle.half_open_voxels(triangle, 4, *BOX)
        assert half_open <= moved["conservative"] <= closed["conservative"], kind
        for met in (closed, moved):
            assert met["6"] <= met["conservative"], kind
            assert met["26"] <= met["conservative"], kind
        assert moved["6"] <= closed["6"], kind
        assert moved["26"] <= closed["26"], kind


@pytest.mark.parametrize("ties", oracle.TIES)
def test_a_plane_meets_the_targets_within_its_known_distances(ties):
    """6: |dist| <= |n|_max / 2; 26 and conservative: |dist| <= |n|_1 / 2, in voxels (Laine)."""
    random = Random(5)
    for normal in [(1, 0, 0), (1, 1, 0), (1, -1, 0), (1, 1, 1), (-1, 1, 1), (2, 3, -5), (7, 1, 1)]:
        divisor = gcd(*normal)
        n = tuple(c // divisor for c in normal)
        u, v = _lattice_basis(n)
        start = tuple(4 * 16 + random.choice([0, 8, 3]) for _ in range(3))
        triangle = [[s + 1600 * (a * i + b * j) for s, i, j in zip(start, u, v, strict=True)]
                    for a, b in ((-1, -1), (4, -1), (-1, 4))]  # fmt: skip
        met = oracle.voxels_of(triangle, 4, (0, 0, 0), 8, ties)
        tie = -first_sign(n) if ties == "one-sided" else 0
        for voxel in product(range(8), repeat=3):
            distance = sum(
                c * (32 * i + 16 - 2 * s) for c, i, s in zip(n, voxel, start, strict=True)
            )
            for mode, reach in (("6", max(map(abs, n))), ("26", sum(map(abs, n)))):
                bound = 16 * reach
                within = (distance, tie) <= (bound, 0) and (distance, tie) >= (-bound, 0)
                assert (voxel in met[mode]) == within, (normal, mode, voxel)
        assert met["26"] == met["conservative"]


def _lattice_basis(n: Vector) -> tuple[Vector, Vector]:
    """Two integer vectors that span the plane n . p = 0."""
    u = (n[1], -n[0], 0) if n[0] or n[1] else (1, 0, 0)
    return u, cross(n, u)


def test_a_face_between_two_voxels_goes_to_the_higher_one_and_closed_ties_take_both():
    triangle = [[16, 4, 4], [16, 12, 4], [16, 4, 12]]
    assert oracle.voxels_of(triangle, 4, (0, 0, 0), 4, "one-sided")["conservative"] == {(1, 0, 0)}
    assert oracle.voxels_of(triangle, 4, (0, 0, 0), 4, "closed")["conservative"] == {
        (0, 0, 0),
        (1, 0, 0),
    }


def test_a_point_on_a_lattice_corner_is_in_one_voxel_and_touches_eight():
    point = [[32, 32, 32]] * 3
    moved = oracle.voxels_of(point, 4, (0, 0, 0), 4, "one-sided")
    assert moved == {"conservative": {(2, 2, 2)}, "26": set(), "6": set()}
    closed = oracle.voxels_of(point, 4, (0, 0, 0), 4, "closed")
    assert closed["conservative"] == closed["26"] == set(product((1, 2), repeat=3))
    assert closed["6"] == set()


def test_a_point_in_a_voxel_centre_touches_the_targets_of_that_voxel_alone():
    closed = oracle.voxels_of([[24, 24, 24]] * 3, 4, (0, 0, 0), 4, "closed")
    assert closed == {"conservative": {(1, 1, 1)}, "26": {(1, 1, 1)}, "6": {(1, 1, 1)}}


def test_mode_6_needs_the_crossing_inside_the_voxel_itself():
    """H-VX-12: the centre's column is covered, but the plane passes it two voxels higher."""
    triangle = [[0, 0, 0], [64, 0, 128], [0, 64, 0]]  # z = 2 x
    met = oracle.voxels_of(triangle, 4, (0, 0, 0), 8, "one-sided")
    assert (1, 1, 2) in met["conservative"]
    assert met["6"] & {(1, 1, z) for z in range(8)} == {(1, 1, 2), (1, 1, 3)}


def test_fractions_of_a_triangle_within_the_box_sum_to_one():
    for kind in ("generic", "small", "edge on a diagonal"):
        for triangle in scenes.soup(kind, 3, 8, 4, (12, 12, 12), 8):
            fractions = oracle.area_fractions(triangle, 4, (0, 0, 0), 32)
            assert sum(fractions.values()) == 1, kind
            assert all(0 <= f <= 1 for f in fractions.values())


def test_a_unit_square_half_has_the_area_printed_here():
    triangle = [[0, 0, 8], [16, 0, 8], [0, 16, 8]]
    fractions = oracle.area_fractions(triangle, 4, (0, 0, 0), 2)
    assert fractions[(0, 0, 0)] == 1
    assert oracle.area_in_units(triangle, 4, Fraction(1)) == 2**25
    assert oracle.area_fractions([[0, 0, 8], [32, 0, 8], [0, 32, 8]], 4, (0, 0, 0), 2) == {
        (0, 0, 0): Fraction(1, 2),
        (1, 0, 0): Fraction(1, 4),
        (0, 1, 0): Fraction(1, 4),
        (1, 1, 0): Fraction(0),
    }


def test_masks_hold_the_sign_of_each_component():
    assert oracle.face_mask([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) == 0b100000
    assert oracle.face_mask([[0, 0, 0], [0, 1, 0], [1, 0, 0]]) == 0b010000
    assert oracle.face_mask([[1, 0, 0], [0, 1, 0], [0, 0, 1]]) == 0b101010
    assert oracle.face_mask([[0, 0, 0], [1, 1, 1], [2, 2, 2]]) == 0


def test_each_kind_of_soup_is_what_its_name_says():
    for triangle in scenes.soup("degenerate", 1, 40, 6, (0, 0, 0), 8):
        assert not any(oracle.normal_of(triangle))
    for triangle in scenes.soup("needle", 1, 20, 12, (0, 0, 0), 16):
        points = as_ints(triangle)
        longest = max(dot(e, e) for e in (tuple(a - b for a, b in zip(p, q, strict=True))
                      for p in points for q in points))  # fmt: skip
        normal = oracle.normal_of(triangle)
        assert longest**2 >= 10**12 * dot(normal, normal), "longest edge / height is below 1e6"
    for triangle in scenes.soup("tie plane", 1, 20, 6, (0, 0, 0), 8):
        assert {abs(c) for c in _primitive(oracle.normal_of(triangle))} <= {0, 1}


def _primitive(normal: Vector) -> Vector:
    divisor = gcd(*normal) or 1
    return normal[0] // divisor, normal[1] // divisor, normal[2] // divisor
