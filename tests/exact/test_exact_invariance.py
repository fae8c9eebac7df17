"""What must not change a bit: order, first corner, winding, whole voxels, boxes, subdivision."""

from random import Random

import numpy as np
import pytest
from exact import oracle, scenes

from gstream.kernels.voxelize import Voxels, voxelize_triangles

FIELDS = ("voxel", "hit", "area", "vector", "mask", "colour")
LOW, EDGE, SNAP_BITS = (16, -32, 48), 16, 5
MODES = [(sep, ties) for sep in oracle.SEPARATIONS for ties in oracle.TIES]
each_mode = pytest.mark.parametrize(("sep", "ties"), MODES)


def mixed_soup(seed: int = 2, count: int = 12):
    return np.concatenate([scenes.soup(k, seed, count, SNAP_BITS, LOW, EDGE) for k in scenes.KINDS])


def channels_of(soup):
    """Two channels per corner that are a pure function of the corner's place in the soup."""
    return np.random.default_rng(1).uniform(0, 65_535, (len(soup), 3, 2)).round(3)


def same(one: Voxels, other: Voxels, fields=FIELDS) -> None:
    for field in fields:
        assert np.array_equal(getattr(one, field), getattr(other, field)), field


@each_mode
def test_the_order_of_triangles_changes_nothing(sep, ties):
    soup = mixed_soup()
    order = np.array(Random(3).sample(range(len(soup)), len(soup)))
    values = channels_of(soup)
    base = voxelize_triangles(soup, SNAP_BITS, LOW, EDGE, sep, ties, values)
    shuffled = voxelize_triangles(soup[order], SNAP_BITS, LOW, EDGE, sep, ties, values[order])
    same(base, shuffled)
    assert np.array_equal(base.assigned[order], shuffled.assigned)
    assert base.fragments == shuffled.fragments


@each_mode
def test_the_first_corner_of_a_triangle_changes_nothing(sep, ties):
    soup = mixed_soup()
    values = channels_of(soup)
    base = voxelize_triangles(soup, SNAP_BITS, LOW, EDGE, sep, ties, values)
    for turns in (1, 2):
        turned, turned_values = np.roll(soup, turns, axis=1), np.roll(values, turns, axis=1)
        same(base, voxelize_triangles(turned, SNAP_BITS, LOW, EDGE, sep, ties, turned_values))


@each_mode
def test_the_winding_changes_only_the_sign_of_vector_and_mask(sep, ties):
    soup = mixed_soup()
    values = channels_of(soup)
    base = voxelize_triangles(soup, SNAP_BITS, LOW, EDGE, sep, ties, values)
    turned = voxelize_triangles(
        soup[:, ::-1].copy(), SNAP_BITS, LOW, EDGE, sep, ties, values[:, ::-1].copy()
    )
    same(base, turned, ("voxel", "hit", "area", "colour", "assigned"))
    assert np.array_equal(base.vector, -turned.vector)
    swapped = ((turned.mask & 0b010101) << 1) | ((turned.mask & 0b101010) >> 1)
    assert np.array_equal(base.mask, swapped)


@each_mode
def test_moving_by_whole_voxels_moves_the_voxels_alone(sep, ties):
    soup = mixed_soup()
    values = channels_of(soup)
    base = voxelize_triangles(soup, SNAP_BITS, LOW, EDGE, sep, ties, values)
    for by in ((-16, 32, -48), (1, -3, 7), (-40_001, 65_000, 2)):
        shift = np.array(by, np.int64)
        low = tuple((np.array(LOW) + shift).tolist())
        moved = voxelize_triangles(
            soup + (shift << SNAP_BITS), SNAP_BITS, low, EDGE, sep, ties, values
        )
        assert np.array_equal(moved.voxel, base.voxel + shift)
        same(base, moved, ("hit", "area", "vector", "mask", "colour", "assigned"))


@each_mode
def test_eight_boxes_hold_what_one_box_holds_in_the_same_order(sep, ties):
    soup = mixed_soup()
    values = channels_of(soup)
    whole = voxelize_triangles(soup, SNAP_BITS, LOW, EDGE, sep, ties, values)
    half = EDGE // 2
    parts = []
    for octant in range(8):
        low = tuple(LOW[axis] + half * (octant >> axis & 1) for axis in range(3))
        parts.append(voxelize_triangles(soup, SNAP_BITS, low, half, sep, ties, values))
    for field in FIELDS:
        joined = np.concatenate([getattr(part, field) for part in parts])
        assert np.array_equal(joined, getattr(whole, field)), field
    assert sum(part.fragments for part in parts) == whole.fragments
    assert np.array_equal(np.any([part.assigned for part in parts], axis=0), whole.assigned)


def test_voxels_come_in_ascending_morton_order():
    voxels = voxelize_triangles(mixed_soup(), SNAP_BITS, LOW, EDGE, "conservative", "closed")
    local = voxels.voxel - np.array(LOW)
    assert local.min() >= 0
    assert local.max() < EDGE
    codes = [
        sum((c >> bit & 1) << (3 * bit + axis) for axis, c in enumerate(v) for bit in range(4))
        for v in local.tolist()
    ]
    assert codes == sorted(set(codes))


@each_mode
def test_a_triangle_and_its_64_exact_parts_meet_the_same_voxels(sep, ties):
    for kind in scenes.KINDS:
        for triangle in scenes.soup(kind, 7, 10, SNAP_BITS, (2, -4, 6), 2) * 8:
            parts = scenes.subdivided(triangle[None], 3)
            one = voxelize_triangles(triangle[None], SNAP_BITS, LOW, EDGE, sep, ties)
            many = voxelize_triangles(parts, SNAP_BITS, LOW, EDGE, sep, ties)
            same(one, many, ("voxel", "hit", "mask"))
            assert one.assigned[0] == many.assigned.any()


@each_mode
@pytest.mark.parametrize("slopes", [(0, 0), (1, 0), (1, -1), (-1, -1), (2, 1)])
def test_a_fan_around_a_lattice_corner_is_the_plain_polygon(sep, ties, slopes):
    """H-VX-8: a square in z = a x + b y, as two triangles and as 100 around a lattice point."""
    unit, reach = 1 << SNAP_BITS, 4 << SNAP_BITS

    def lifted(points):
        return [[x, y, slopes[0] * x + slopes[1] * y + 24 * unit] for x, y in points]

    corners = [(-reach, -reach), (reach, -reach), (reach, reach), (-reach, reach)]
    square = lifted(corners)
    two = np.array([square[:3], [square[0], *square[2:]]], np.int64) + 8 * unit
    rim = []
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        cuts = sorted(Random(ax + 3 * ay).sample(range(1, 2 * reach), 24))
        dx, dy = (bx - ax) // (2 * reach), (by - ay) // (2 * reach)
        rim += [(ax, ay)] + [(ax + c * dx, ay + c * dy) for c in cuts]
    ring = zip(lifted(rim), lifted(rim[1:] + rim[:1]), strict=True)
    hub = lifted([(unit, -2 * unit)])[0]
    fan = np.array([[hub, p, q] for p, q in ring], np.int64) + 8 * unit
    assert len(fan) == 100
    plain = voxelize_triangles(two, SNAP_BITS, (0, 0, 0), 64, sep, ties)
    assert plain.hit.any()
    same(
        plain,
        voxelize_triangles(fan, SNAP_BITS, (0, 0, 0), 64, sep, ties),
        ("voxel", "hit", "mask"),
    )
