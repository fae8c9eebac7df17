"""Hard cases of colours, normals and weights; the judge is exact: Fractions and plain sums."""

from fractions import Fraction

import numpy as np
import pytest
from exact import oracle, scenes
from hypothesis import given, settings
from hypothesis import strategies as st

from gstream.formats.lodrule import (
    COLOUR_TABLES,
    LINEAR_OF_CODE,
    decode_normals,
    encode_normals,
    finish_voxels,
)
from gstream.kernels.lod import reduce_runs
from gstream.kernels.voxelize import voxelize_triangles

NO_NORMAL, NO_COLOUR = np.empty((0, 2), np.uint16), np.empty((0, 4), np.uint8)


@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize("sep", oracle.SEPARATIONS)
def test_colours_of_triangles_without_area_are_averaged_as_equals(sep, ties):
    """H-AT-2, H-VX-4. Segments and points weigh one unit a fragment, and nothing divides by 0."""
    soup = scenes.soup("degenerate", 3, 60, 6, (0, 0, 0), 8)
    values = np.random.default_rng(2).uniform(0, 65_535, (60, 3, 2)).round()
    found = voxelize_triangles(soup, 6, (0, 0, 0), 8, sep, ties, values)
    sums: dict[tuple[int, ...], list[float]] = {}
    for triangle, corners in zip(soup, values, strict=True):
        for voxel in oracle.voxels_of(triangle, 6, (0, 0, 0), 8, ties)["conservative"]:
            total = sums.setdefault(voxel, [0.0] * 4)
            total[0] += 1
            total[1] += corners[:, 0].min()
            total[2] += corners[:, 0].max()
            total[3] += 1  # a sum of a fragment is rounded to an integer
    assert not found.vector.any()
    assert not found.mask.any()
    for voxel, area, colour in zip(
        found.voxel.tolist(), found.area.tolist(), found.colour.tolist(), strict=True
    ):
        count, low, high, slack = sums[tuple(voxel)]
        assert area == count
        assert low - slack <= colour[0] <= high + slack


@given(st.lists(st.tuples(*[st.integers(0, 65_535)] * 4), min_size=2, max_size=40))
def test_points_in_one_voxel_take_the_plain_mean_of_their_colours(colours):
    """H-AT-2. What level 0 stores is the code next to the mean, and no direction."""
    point = np.full((len(colours), 3, 3), 100, np.int64)
    values = np.repeat(np.array(colours, float)[:, None], 3, axis=1)
    found = voxelize_triangles(point, 4, (0, 0, 0), 8, "conservative", "one-sided", values)
    assert found.voxel.tolist() == [[6, 6, 6]]
    assert found.colour[0].tolist() == np.sum(colours, axis=0).tolist()
    sums = np.minimum(found.colour, [[1 << 40] * 3 + [255 * len(colours)]])
    mask, normal, colour, weight = finish_voxels(found.area, found.vector, sums, found.mask, 11)
    assert (mask.tolist(), normal.tolist(), weight.tolist()) == ([63], [[2047, 2047]], [1])
    for code, total in zip(colour[0, :3].tolist(), found.colour[0].tolist(), strict=False):
        mean = Fraction(total, len(colours))
        distance = [abs(mean - int(v)) for v in LINEAR_OF_CODE]
        assert distance[code] <= min(distance) + 1


def climbed(codes, normal, colour, weight, levels, use_weight=True):
    """The voxels `levels` levels up."""
    mask = np.ones(len(codes), np.uint8)
    for _ in range(levels):
        morton, mask, normal, colour, weight = reduce_runs(
            codes, mask, normal, colour, weight, 11, use_weight, COLOUR_TABLES
        )
        codes = morton.astype(np.uint64)
    return codes, normal, colour, weight


@settings(max_examples=60)
@given(st.integers(0, 2**32), st.integers(1, 14), st.integers(1, 300))
def test_the_drift_of_a_colour_over_14_levels_is_half_a_code_a_level(seed, levels, count):
    """H-AT-4. Weights that stay divisible by 4, so that the mean of all is known exactly."""
    rng = np.random.default_rng(seed)
    codes = np.unique(rng.integers(0, 8**levels, count).astype(np.uint64))
    n = len(codes)
    colour = rng.integers(0, 256, (n, 4)).astype(np.uint8)
    weight = (rng.integers(1, 16, n) * 4**levels).astype(np.uint32)
    *_, top, total = climbed(codes, NO_NORMAL, colour, weight, levels)
    assert len(top) == 1
    assert total[0] == weight.sum(dtype=np.int64) // 4**levels
    step = int(np.diff(LINEAR_OF_CODE.astype(int)).max())
    for c in range(3):
        light = [int(v) for v in LINEAR_OF_CODE[colour[:, c]]]
        exact = Fraction(sum(int(w) * v for w, v in zip(weight, light, strict=True)),
                         int(weight.sum(dtype=np.int64)))  # fmt: skip
        assert abs(int(LINEAR_OF_CODE[top[0, c]]) - exact) <= levels * (step / 2 + 1)
    alpha = Fraction(int(weight.astype(np.int64) @ colour[:, 3].astype(np.int64)),
                     int(weight.sum(dtype=np.int64)))  # fmt: skip
    assert abs(int(top[0, 3]) - alpha) <= Fraction(levels, 2)


@pytest.mark.parametrize("use_weight", [True, False])
def test_what_is_equal_everywhere_is_the_same_14_levels_up(use_weight):
    """H-AT-4, H-AT-3. No drift: all codes of a colour, and normals on and off the axes."""
    rng = np.random.default_rng(9)
    vectors = [*np.eye(3), *-np.eye(3), *rng.normal(size=(30, 3))]
    normals = encode_normals((np.array(vectors) * 1e6).astype(np.int64), 11)
    codes = np.unique(rng.integers(0, 8**14, 200).astype(np.uint64))
    weight = rng.integers(1, 1 << 32, len(codes)).astype(np.uint32)
    for at in range(256):
        normal, colour = normals[at % len(normals)], np.full((1, 4), at, np.uint8)
        up = climbed(
            codes, np.tile(normal, (len(codes), 1)), np.tile(colour, (len(codes), 1)), weight, 14,
            use_weight,
        )  # fmt: skip
        assert up[0].tolist() == [0]
        assert up[2].tolist() == colour.tolist()
        assert up[1].tolist() == [normal.tolist()]


@given(st.integers(0, 2**32))
def test_a_normal_14_levels_up_is_near_the_unrounded_mean(seed):
    """H-AT-4. Directions within 30 degrees of one; a level rounds by 0.1 degrees at most."""
    rng = np.random.default_rng(seed)
    axis, spread = rng.normal(size=3), rng.normal(size=(40, 3))
    vectors = axis / np.linalg.norm(axis) + 0.5 * spread / np.linalg.norm(spread, axis=1)[:, None]
    codes = np.unique(rng.integers(0, 8**6, 40).astype(np.uint64))
    normals = encode_normals((vectors[: len(codes)] * 1e6).astype(np.int64), 11)
    even = np.full(len(codes), 4**14, np.uint32)
    top = decode_normals(climbed(codes, normals, NO_COLOUR, even, 14)[1], 11)[0]
    wanted = mean_direction(codes, decode_normals(normals, 11))
    cosine = top @ wanted / np.linalg.norm(top) / np.linalg.norm(wanted)
    assert np.degrees(np.arccos(min(cosine, 1.0))) <= 1.4


def mean_direction(codes, vectors):
    """The rule of the levels in float64: each mean made a unit vector, and never a code."""
    rows = {int(c): (np.array(v, float), 1.0) for c, v in zip(codes, vectors, strict=True)}
    for _ in range(14):
        parents: dict[int, tuple[np.ndarray, float]] = {}
        for code, (vector, weight) in rows.items():
            total, held = parents.get(code >> 3, (np.zeros(3), 0.0))
            share = weight * vector / np.linalg.norm(vector)
            parents[code >> 3] = total + share, held + weight
        rows = parents
    return rows[0][0]


@pytest.mark.parametrize("ties", oracle.TIES)
def test_a_sheet_of_both_faces_has_no_direction_and_keeps_its_colour(ties):
    """H-AT-1, H-VX-7. Kept through all levels: nothing is renormalised."""
    sheet = scenes.soup("coplanar", 2, 20, 6, (0, 0, 0), 8)
    both = np.concatenate([sheet, sheet[:, ::-1]])
    found = voxelize_triangles(both, 6, (0, 0, 0), 8, "6", ties, np.full((40, 3, 4), 200.0))
    assert len(found.voxel)
    assert not found.vector.any()
    shows = [mask in (0b11, 0b1100, 0b110000, 0b1111, 0b111100, 0b110011, 0b111111)
             for mask in found.mask.tolist()]  # fmt: skip
    assert all(shows)
    mask, normal, colour, weight = finish_voxels(
        found.area, found.vector, found.colour, found.mask, 11
    )
    assert (normal == 2047).all()
    codes = np.arange(len(mask), dtype=np.uint64)
    _, top, shade, _ = climbed(codes, normal, colour, weight, 4)
    assert (top == 2047).all()
    assert np.unique(shade, axis=0).tolist() == np.unique(colour, axis=0).tolist()


@pytest.mark.parametrize("slope", [(1, 1), (1, -1), (2, 3), (-3, 5), (7, 1)])
def test_a_voxel_that_only_a_sliver_meets_has_the_triangle_s_normal(slope):
    """The plane x + p y + q z passes lattice corners one snap unit off: its slivers have areas of a
    few units, 2^-26 of a face, and the area vector is rounded 4096 times finer."""
    p, q = slope
    start, along = np.array([8 * 4096 + 1, 8 * 4096, 8 * 4096]), 11 * 4096
    triangle = start + along * np.array([[-p - q, 1, 1], [2 * p - q, -2, 1], [2 * q - p, 1, -2]])
    normal = np.array([1, p, q]) / np.linalg.norm([1, p, q])
    found = voxelize_triangles(triangle[None], 12, (0, 0, 0), 16, "conservative", "one-sided")
    direction = found.vector / np.linalg.norm(found.vector, axis=1, keepdims=True)
    sine = np.linalg.norm(np.cross(direction, normal), axis=1)
    assert np.degrees(sine.max()) <= 0.013
    assert (found.area < 8).sum() > 20
