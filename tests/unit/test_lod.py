"""Levels of detail: the frozen colour table, and fast = plain = naive at both ends."""

from hashlib import sha256

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

import naive
from gstream.formats import lodrule as plain
from gstream.kernels import lod as fast
from gstream.kernels.accumulate import HIT
from strategies import NORMAL_BITS, directions, sibling_voxels

TABLE_SHA256 = "fdb7af3c01815a2118db8e50aac3c2304205ccc3f381f8976c588642c1aa60b6"

NO_COLOUR = np.empty((0, 4), np.uint8)
NO_NORMAL = np.empty((0, 2), np.uint16)
NO_WEIGHT = np.empty(0, np.uint32)


@njit
def rounded_mean(total, weight):
    """A part has no wrapper for Python: this is one."""
    return fast.rounded_mean(total, weight)


def as_arrays(voxels):
    codes, mask, normal, colour, weight = zip(*voxels, strict=True)
    return (
        np.array(codes, np.uint32),
        np.array(mask, np.uint8),
        np.array(normal, np.uint16),
        np.array(colour, np.uint8),
        np.array(weight, np.uint32),
    )


def reduced_by(rule, arrays, bits, use_weight):
    if rule is fast:
        return fast.reduce_runs(*arrays, bits, use_weight, plain.COLOUR_TABLES)
    out = plain.reduce_runs(*arrays, bits, use_weight)
    return out.morton, out.mask, out.normal, out.colour, out.weight


def assert_same(got, wanted):
    for a, b in zip(got, wanted, strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def test_the_colour_table_is_frozen_and_the_formula_of_srgb():
    table = plain.LINEAR_OF_CODE
    assert table[[0, 1, 10, 11, 127, 128, 254, 255]].tolist() == [
        0,
        20,
        199,
        219,
        13_909,
        14_146,
        64_952,
        65_535,
    ]
    assert table.tolist() == naive.LINEAR
    assert sha256(table.astype("<u2").tobytes()).hexdigest() == TABLE_SHA256


def test_every_code_survives_linear_light():
    assert plain.CODE_OF_LINEAR[plain.LINEAR_OF_CODE].tolist() == list(range(256))


def test_the_inverse_table_is_the_rule_of_half_way_points():
    values = [*range(0, 700), *range(700, 65_536, 97), 65_535]
    assert [int(plain.CODE_OF_LINEAR[v]) for v in values] == [
        naive.code_of_linear(v) for v in values
    ]


@given(st.integers(0, 1 << 62), st.integers(1, 1 << 62))
def test_a_mean_is_rounded_half_up_without_overflow(total, weight):
    wanted = (2 * total + weight) // (2 * weight)
    assert rounded_mean(total, weight) == wanted
    assert plain.rounded_mean(np.array([total]), np.array([weight]))[0] == wanted


@given(st.integers(0, 65_535), st.integers(1, 1 << 35), st.integers(-2, 2))
def test_means_next_to_an_integer_or_a_half_are_exact(mean, weight, nudge):
    for total in (mean * weight + nudge, mean * weight + weight // 2 + nudge):
        if total >= 0:
            assert rounded_mean(total, weight) == (2 * total + weight) // (2 * weight)


@given(st.sampled_from(NORMAL_BITS), st.booleans(), st.data())
def test_parents_agree_with_the_naive_rule(bits, use_weight, data):
    voxels = data.draw(sibling_voxels(bits))
    wanted = as_arrays(naive.reduce_runs(voxels, bits, use_weight))
    for rule in (plain, fast):
        assert_same(reduced_by(rule, as_arrays(voxels), bits, use_weight), wanted)


@given(st.data())
def test_an_absent_column_stays_absent_and_changes_no_other(data):
    codes, mask, normal, colour, weight = as_arrays(data.draw(sibling_voxels(11)))
    whole = reduced_by(fast, (codes, mask, normal, colour, weight), 11, True)
    bare = (codes, mask, normal, NO_COLOUR, weight)
    for rule in (plain, fast):
        got = reduced_by(rule, bare, 11, True)
        assert_same(got, (*whole[:3], NO_COLOUR, whole[4]))
    counted = reduced_by(fast, (codes, mask, normal, colour, weight), 11, False)
    for rule in (plain, fast):
        got = reduced_by(rule, (codes, mask, NO_NORMAL, colour, NO_WEIGHT), 11, False)
        assert_same(got, (*counted[:2], NO_NORMAL, counted[3], NO_WEIGHT))


def test_an_only_child_hands_its_normal_and_colour_up_unchanged():
    rng = np.random.default_rng(4)
    n = 5_000
    codes = (np.arange(n, dtype=np.uint32) << np.uint32(3)) | rng.integers(0, 8, n).astype("u4")
    normal = plain.encode_normals(rng.integers(-(1 << 40), 1 << 40, (n, 3)), 11)
    colour = rng.integers(0, 256, (n, 4)).astype(np.uint8)
    weight = rng.integers(1, 1 << 32, n).astype(np.uint32)
    mask = rng.integers(1, 64, n).astype(np.uint8)
    got = reduced_by(fast, (codes, mask, normal, colour, weight), 11, True)
    quarter = np.maximum((weight.astype(np.int64) + 2) // 4, 1).astype(np.uint32)
    assert_same(got, (np.arange(n, dtype=np.uint32), mask, normal, colour, quarter))


def test_opposite_children_cancel_to_no_direction():
    up, down = plain.encode_normals(np.array([[0, 0, 1], [0, 0, -1]]), 11)
    arrays = (
        np.array([8, 9], np.uint32),
        np.array([16, 32], np.uint8),
        np.stack((up, down)),
        NO_COLOUR,
        np.array([7, 7], np.uint32),
    )
    for rule in (plain, fast):
        morton, mask, normal, _, weight = reduced_by(rule, arrays, 11, True)
        assert (morton.tolist(), mask.tolist(), weight.tolist()) == ([1], [48], [4])
        assert normal.tolist() == [[2047, 2047]]


def test_weights_saturate_and_stay_at_least_one():
    codes = np.array([0, 8, 9, 10, 11, 12], np.uint32)
    weight = np.array([1, *[(1 << 32) - 1] * 5], np.uint32)
    mask = np.ones(6, np.uint8)
    for rule in (plain, fast):
        arrays = (codes, mask, NO_NORMAL, NO_COLOUR, weight)
        assert reduced_by(rule, arrays, 11, True)[4].tolist() == [1, (1 << 32) - 1]


def test_codes_of_eight_blocks_of_edge_256_and_64_bit_codes_reduce_alike():
    rng = np.random.default_rng(8)
    codes = np.unique(rng.integers(0, 1 << 27, 3_000).astype(np.uint32))
    codes = np.unique(np.concatenate((codes, codes ^ np.uint32(5))))
    mask = rng.integers(1, 64, codes.size).astype(np.uint8)
    arrays = (mask, NO_NORMAL, NO_COLOUR, NO_WEIGHT)
    narrow = reduced_by(fast, (codes, *arrays), 11, False)
    for form in (plain, fast):
        wide = reduced_by(form, (codes + np.uint64(1 << 47), *arrays), 11, False)
        assert_same(wide, (narrow[0] + np.uint64(1 << 44), *narrow[1:]))
    assert_same(reduced_by(plain, (codes, *arrays), 11, False), narrow)


def finished_by_kernel(area, vectors, colours, masks, bits):
    """By the kernel, which takes rows of a box' sums: here they lie there in descending order."""
    sums = np.zeros((len(area), 8), np.int64)
    sums[:, 0], sums[:, 1:4], sums[: len(colours), 4:] = area, vectors, colours
    rows = np.arange(len(area), dtype=np.int32)[::-1].copy()
    return fast.finish_voxels(
        rows, sums[::-1].copy(), masks[::-1] | HIT, len(colours) > 0, False, bits,
        plain.COLOUR_TABLES,
    )  # fmt: skip


@given(st.sampled_from(NORMAL_BITS), st.data())
def test_finished_voxels_agree_with_the_naive_rule(bits, data):
    count = data.draw(st.integers(1, 12))
    area = data.draw(st.lists(st.integers(1, 1 << 40), min_size=count, max_size=count))
    vectors = [data.draw(directions()) for _ in area]
    masks = data.draw(st.lists(st.integers(0, 63), min_size=count, max_size=count))
    sums = [
        (
            *(data.draw(st.integers(0, a * 65_535)) for _ in range(3)),
            a * data.draw(st.integers(0, 255)),
        )
        for a in area
    ]
    rows = zip(area, vectors, sums, masks, strict=True)
    wanted = as_arrays([(0, *naive.finish_voxel(*row, bits)) for row in rows])[1:]
    arrays = (np.array(area), np.array(vectors), np.array(sums), np.array(masks, np.uint8))
    assert_same(plain.finish_voxels(*arrays, bits), wanted)
    assert_same(finished_by_kernel(*arrays, bits), wanted)


def test_without_normals_the_other_columns_of_a_voxel_are_what_they_were_with_them():
    rng = np.random.default_rng(5)
    area, masks = rng.integers(1, 1 << 30, 300), rng.integers(0, 64, 300).astype(np.uint8)
    vectors, sums = rng.integers(-1000, 1000, (300, 3)), rng.integers(0, 1 << 40, (300, 4))
    with_them = finished_by_kernel(area, vectors, sums, masks, 11)
    without = finished_by_kernel(area, vectors, sums, masks, 0)
    assert without[1].shape == (0, 2)
    assert_same(without[:1] + without[2:], with_them[:1] + with_them[2:])


@pytest.mark.parametrize("colours", [0, 2])
def test_an_empty_voxel_gets_all_faces_no_direction_and_the_least_weight(colours):
    area, vectors = np.zeros(2, np.int64), np.zeros((2, 3), np.int64)
    sums, masks = np.zeros((colours, 4), np.int64), np.zeros(2, np.uint8)
    wanted = (
        np.full(2, 63, np.uint8),
        np.full((2, 2), 2047, np.uint16),
        np.zeros((colours, 4), np.uint8),
        np.ones(2, np.uint32),
    )
    assert_same(plain.finish_voxels(area, vectors, sums, masks, 11), wanted)
    assert_same(finished_by_kernel(area, vectors, sums, masks, 11), wanted)
