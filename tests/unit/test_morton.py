"""Morton codes: bit 0 is x; the compiled forms agree with the bit-by-bit ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import naive
from gstream.formats import morton as plain
from gstream.kernels import morton

COORDINATE = st.integers(0, (1 << 21) - 1)


def test_x_is_the_lowest_bit():
    points = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [255, 0, 255]], np.int64)
    assert morton.encode_points(points).tolist() == [1, 2, 4, 0xB6DB6D]


@given(st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), min_size=1, max_size=30))
def test_codes_of_points_agree_with_the_naive_codes_and_are_undone(points):
    codes = morton.encode_points(np.array(points, np.int64))
    assert codes.dtype == np.uint64
    assert codes.tolist() == [naive.morton(*point) for point in points]
    assert [naive.coordinates(code) for code in codes.tolist()] == points
    np.testing.assert_array_equal(morton.decode_codes(codes), points)


def test_local_codes_of_32_bits_decode_to_coordinates_up_to_255():
    codes = np.array([0, 8**8 - 1, 0xB6DB6D], np.uint32)
    assert morton.decode_codes(codes).tolist() == [[0, 0, 0], [255, 255, 255], [255, 0, 255]]


@given(st.lists(st.integers(0, (1 << 30) - 1), min_size=1, max_size=30))
def test_bounds_are_the_smallest_and_largest_coordinates(codes):
    points = np.array([naive.coordinates(code) for code in codes])
    bounds = tuple(points.min(axis=0).tolist()), tuple(points.max(axis=0).tolist())
    for rule in (morton, plain):
        assert rule.tight_bounds(np.array(codes, np.uint32)) == bounds


@given(st.integers(0, (1 << 63) - 1))
def test_one_code_decodes_like_an_array_of_one(code):
    assert plain.decode_one(code) == naive.coordinates(code)


@pytest.mark.parametrize("log2_edge", [1, 3, 5])
def test_scan_order_visits_a_dense_cube_by_ascending_code(log2_edge):
    edge = 1 << log2_edge
    z, y, x = np.mgrid[:edge, :edge, :edge].reshape(3, -1)
    codes = morton.encode_points(np.stack((x, y, z), axis=1))
    np.testing.assert_array_equal(morton.scan_order(log2_edge), np.argsort(codes))


def test_three_look_ups_in_the_spread_table_make_a_code():
    table = morton.spread_table(8).astype(np.uint64)
    rng = np.random.default_rng(2)
    points = rng.integers(0, 256, (500, 3))
    codes = table[points[:, 0]] | table[points[:, 1]] << 1 | table[points[:, 2]] << 2
    np.testing.assert_array_equal(codes, morton.encode_points(points))
