"""Each hard triangle alone in a box: voxels, targets, areas and masks are the oracle's."""

from functools import cache

import numpy as np
import pytest
from exact import oracle, scenes

from gstream.kernels.voxelize import Voxels, voxelize_triangles

# snap bits, box (low corner, edge), triangles of each kind
VECTOR_UNITS = 4096  # of the area vector in a unit of area

SETTINGS = (
    (2, ((0, 0, 0), 8), 20),
    (7, ((-13, 5, 1000), 8), 20),
    (12, ((100, -3, 40), 16), 8),
)
Setting = tuple[int, tuple[tuple[int, int, int], int], int]


@cache
def triangles_of(kind: str, setting: Setting):
    snap_bits, box, count = setting
    return scenes.soup(kind, 1, count, snap_bits, *box)


@cache
def truth_of(kind: str, setting: Setting, ties: str):
    snap_bits, box, _ = setting
    return [oracle.voxels_of(t, snap_bits, *box, ties) for t in triangles_of(kind, setting)]


@cache
def fractions_of(kind: str, setting: Setting):
    snap_bits, box, _ = setting
    return [oracle.area_fractions(t, snap_bits, *box) for t in triangles_of(kind, setting)]


def run(triangle, setting: Setting, sep: str, ties: str) -> Voxels:
    snap_bits, (low, edge), _ = setting
    return voxelize_triangles(triangle.reshape(-1, 3, 3), snap_bits, low, edge, sep, ties)


def as_set(rows) -> set[tuple[int, int, int]]:
    return {(x, y, z) for x, y, z in rows.tolist()}


def everything(kind: str, ties: str):
    for setting in SETTINGS:
        triangles, truths = triangles_of(kind, setting), truth_of(kind, setting, ties)
        for triangle, truth in zip(triangles, truths, strict=True):
            yield setting, triangle, truth


@pytest.mark.parametrize("sep", oracle.SEPARATIONS)
@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize("kind", scenes.KINDS)
def test_the_voxels_of_a_triangle_are_the_exact_ones(kind, ties, sep):
    for setting, triangle, truth in everything(kind, ties):
        voxels = run(triangle, setting, sep, ties)
        where = (setting, triangle.tolist())
        assert as_set(voxels.voxel) == truth["conservative"], where
        assert as_set(voxels.voxel[voxels.hit]) == truth[sep], where
        assert len(voxels.voxel) == voxels.fragments == len(truth["conservative"]), where
        assert voxels.assigned.tolist() == [bool(truth[sep])], where


@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize("kind", scenes.KINDS)
def test_the_area_of_a_fragment_is_the_exact_one(kind, ties):
    for setting in SETTINGS:
        snap_bits = setting[0]
        fractions = fractions_of(kind, setting)
        for triangle, shares in zip(triangles_of(kind, setting), fractions, strict=True):
            voxels = run(triangle, setting, "conservative", ties)
            for voxel, area in zip(voxels.voxel.tolist(), voxels.area.tolist(), strict=True):
                share = shares.get(tuple(voxel), 0)  # a degenerate triangle has none
                exact = float(oracle.area_in_units(triangle, snap_bits, share))
                where = (setting, triangle.tolist(), voxel)
                assert area >= 1, where  # so that every voxel has a weight
                assert abs(area - max(exact, 1)) <= 1 + 1e-9 * exact, where


@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize("kind", scenes.KINDS)
def test_mask_and_area_vector_follow_the_exact_normal(kind, ties):
    for setting, triangle, _ in everything(kind, ties):
        voxels = run(triangle, setting, "conservative", ties)
        assert set(voxels.mask.tolist()) <= {oracle.face_mask(triangle)}, triangle.tolist()
        normal = np.array([float(c) for c in oracle.normal_of(triangle)])
        unit = normal / (np.linalg.norm(normal) or 1.0)
        expected = voxels.area[:, None] * unit
        error = np.abs(voxels.vector / VECTOR_UNITS - expected)
        assert np.all(error <= 0.5 / VECTOR_UNITS + 1e-9 * np.abs(expected)), triangle.tolist()


@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize("kind", scenes.KINDS)
def test_all_modes_return_the_same_voxels_with_the_same_attributes(kind, ties):
    for setting in SETTINGS:
        triangles = triangles_of(kind, setting)
        base = run(triangles, setting, "conservative", ties)
        assert base.hit.all()
        for sep in ("6", "26"):
            other = run(triangles, setting, sep, ties)
            for field in ("voxel", "area", "vector", "mask"):
                assert np.array_equal(getattr(other, field), getattr(base, field)), (sep, field)


@pytest.mark.parametrize("sep", oracle.SEPARATIONS)
@pytest.mark.parametrize("ties", oracle.TIES)
def test_a_soup_is_the_sum_of_its_triangles(ties, sep):
    for setting in SETTINGS:
        triangles = np.concatenate([triangles_of(kind, setting) for kind in scenes.KINDS])
        whole = run(triangles, setting, sep, ties)
        sums: dict[tuple[int, int, int], list[int]] = {}
        assigned, fragments = [], 0
        for triangle in triangles:
            one = run(triangle, setting, sep, ties)
            assigned += one.assigned.tolist()
            fragments += one.fragments
            rows = zip(one.voxel.tolist(), one.hit, one.area, one.vector, one.mask, strict=True)
            for voxel, hit, area, vector, mask in rows:
                total = sums.setdefault(tuple(voxel), [0] * 6)
                total[:4] = [a + int(b) for a, b in zip(total, (area, *vector), strict=False)]
                total[4] |= int(mask)
                total[5] |= int(hit)
        assert as_set(whole.voxel) == set(sums)
        table = np.array([sums[tuple(v)] for v in whole.voxel.tolist()])
        assert np.array_equal(whole.area, table[:, 0])
        assert np.array_equal(whole.vector, table[:, 1:4])
        assert np.array_equal(whole.mask, table[:, 4])
        assert np.array_equal(whole.hit, table[:, 5].astype(bool))
        assert whole.assigned.tolist() == assigned
        assert whole.fragments == fragments


@pytest.mark.parametrize(
    "kind", ["generic", "small", "half-lattice", "edge on a line", "tie plane"]
)
def test_a_linear_channel_takes_its_mean_over_each_fragment(kind):
    for setting in SETTINGS:
        snap_bits, (low, edge), _ = setting
        for triangle in triangles_of(kind, setting):
            if not any(oracle.normal_of(triangle)):
                continue
            slopes = np.array([[300.0, -20.0, 7.0], [0.0, 0.0, 0.0]])
            corners = (triangle / (1 << snap_bits) - np.array(low)) @ slopes.T + [
                40_000.0,
                65_535.0,
            ]
            voxels = voxelize_triangles(
                triangle[None], snap_bits, low, edge, "conservative", "one-sided", corners[None]
            )
            assert np.array_equal(voxels.colour[:, 1], voxels.area * 65_535)
            centroids = oracle.centroids(triangle, snap_bits, low, edge)
            largest = np.abs(corners).max()
            for voxel, area, colour in zip(
                voxels.voxel.tolist(), voxels.area.tolist(), voxels.colour.tolist(), strict=True
            ):
                mean = corners[:, 0].mean()
                if tuple(voxel) in centroids:
                    at = [float(c) - l for c, l in zip(centroids[tuple(voxel)], low, strict=True)]
                    mean = float(slopes[0] @ at) + 40_000.0
                    assert abs(colour[0] - area * mean) <= 2 * largest + 1e-9 * area * largest
                assert corners[:, 0].min() * area - 1 <= colour[0] <= corners[:, 0].max() * area + 1


@pytest.mark.parametrize("sep", oracle.SEPARATIONS)
def test_nothing_gives_nothing(sep):
    empty = voxelize_triangles(np.empty((0, 3, 3), np.int64), 12, (0, 0, 0), 8, sep, "closed")
    assert len(empty.voxel) == empty.fragments == len(empty.assigned) == 0
    away = np.array([[[-9, 0, 0], [-1, 5, 0], [-3, 0, 7]]], np.int64)
    missed = voxelize_triangles(away, 12, (0, 0, 0), 8, sep, "closed")
    assert len(missed.voxel) == missed.fragments == 0
    assert missed.assigned.tolist() == [False]


def test_opposite_coincident_triangles_cancel_in_the_vector_and_show_both_faces():
    triangle = np.array([[4, 4, 40], [100, 9, 61], [30, 80, 7]], np.int64)
    both = np.stack([triangle, triangle[::-1]])
    single = voxelize_triangles(triangle[None], 4, (0, 0, 0), 8, "6", "one-sided")
    pair = voxelize_triangles(both, 4, (0, 0, 0), 8, "6", "one-sided")
    assert np.array_equal(pair.voxel, single.voxel)
    assert np.array_equal(pair.area, 2 * single.area)
    assert not pair.vector.any()
    assert set(pair.mask.tolist()) == {63}
