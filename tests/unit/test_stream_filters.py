"""The stream's filters: both twins give the same bytes, and undoing gives the same values."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gstream.formats import stream_filters as plain
from gstream.kernels import indexing as fast

TWINS = [plain, fast]
IDS = ["numpy", "numba"]
DTYPES = [np.uint8, np.uint16, np.uint32, np.uint64]


@st.composite
def values_and_bases(draw):
    """Bits of 0 to 40 rows, and for each row one that comes before it."""
    dtype = draw(st.sampled_from(DTYPES))
    rows, components = draw(st.integers(0, 40)), draw(st.integers(1, 4))
    values = draw(hnp.arrays(dtype, (rows, components)))
    bases = [draw(st.integers(-1, row - 1)) for row in range(rows)]
    return values, np.array(bases, np.int32), draw(st.booleans())


@st.composite
def first_use_triangles(draw):
    """Triangles whose vertices are numbered in order of first use."""
    corners, used = [], 0
    for _ in range(3 * draw(st.integers(0, 30))):
        corners.append(draw(st.integers(0, used)))
        used = max(used, corners[-1] + 1)
    return np.array(corners, np.uint16).reshape(-1, 3), used


def planes_of(twin, values, bases, ordered):
    planes = np.zeros((values.shape[1], values.itemsize, len(values)), np.uint8)
    twin.delta_planes(values, bases, ordered, planes)
    return planes


@given(values_and_bases())
def test_both_twins_give_the_same_planes(case):
    np.testing.assert_array_equal(planes_of(plain, *case), planes_of(fast, *case))


@pytest.mark.parametrize("twin", TWINS, ids=IDS)
@given(case=values_and_bases())
def test_undoing_the_delta_gives_the_values_back(twin, case):
    values, bases, ordered = case
    found = np.zeros_like(values)
    twin.undo_delta_planes(planes_of(twin, *case), bases, ordered, found)
    np.testing.assert_array_equal(found, values)


@pytest.mark.parametrize("twin", TWINS, ids=IDS)
def test_a_plain_delta_of_bytes_is_what_one_computes_by_hand(twin):
    values = np.array([[5], [3], [3], [255]], np.uint8)
    planes = planes_of(twin, values, plain.rows_before(4), False)
    assert planes.tolist() == [[[10, 3, 0, 7]]]  # +5, -2, 0 and -4 modulo 256, in zigzag


@pytest.mark.parametrize("twin", TWINS, ids=IDS)
def test_ordered_floats_differ_by_the_number_of_floats_between_them(twin):
    steps = np.array([0.0, -0.0, 1.0, np.nextafter(np.float32(1), np.float32(2))], np.float32)
    bits = steps.reshape(-1, 1).view(np.uint32)
    planes = planes_of(twin, bits, plain.rows_before(4), True)
    zigzag = (planes[0].astype(np.int64) * (1 << 8 * np.arange(4))[:, None]).sum(axis=0)
    assert zigzag[1] == 1  # one step down, from +0.0 to -0.0
    assert zigzag[3] == 2  # one step up


@given(first_use_triangles())
def test_both_twins_choose_the_same_bases(case):
    triangles, used = case
    found = [np.zeros(used, np.int32) for _ in TWINS]
    for twin, bases in zip(TWINS, found, strict=True):
        twin.corner_bases(triangles, bases)
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("twin", TWINS, ids=IDS)
@given(triangles=hnp.arrays(np.uint16, (7, 3), elements=st.integers(0, 11)))
def test_a_base_is_the_highest_earlier_corner_of_the_first_triangle(twin, triangles):
    bases = np.zeros(12, np.int32)
    twin.corner_bases(triangles, bases)
    for vertex in range(12):
        using = [row for row in triangles.tolist() if vertex in row]
        earlier = [other for other in (using[0] if using else []) if other < vertex]
        assert bases[vertex] == max(earlier, default=vertex - 1)


@pytest.mark.parametrize("twin", TWINS, ids=IDS)
@given(case=first_use_triangles())
def test_first_use_codes_give_the_indices_back(twin, case):
    triangles, used = case
    indices = triangles.ravel()
    planes, found = np.zeros((2, len(indices)), np.uint8), np.zeros_like(indices)
    twin.first_use_planes(indices, planes)
    assert twin.undo_first_use_planes(planes, used, found) == used
    np.testing.assert_array_equal(found, indices)


@pytest.mark.parametrize("twin", TWINS, ids=IDS)
def test_first_use_codes_reach_vertex_65535_and_65536_below_the_mark(twin):
    indices = np.concatenate([np.arange(65_536), [0, 65_535, 0]]).astype(np.uint16)
    planes, found = np.zeros((2, len(indices)), np.uint8), np.zeros_like(indices)
    twin.first_use_planes(indices, planes)
    assert planes[:, -3:].tolist() == [[0, 1, 0], [0, 0, 0]]
    assert twin.undo_first_use_planes(planes, 65_536, found) == 65_536
    np.testing.assert_array_equal(found, indices)


@given(
    planes=hnp.arrays(np.uint8, (2, 12), elements=st.integers(0, 9)),
    vertices=st.integers(0, 65_536),
)
def test_both_twins_refuse_the_same_broken_indices(planes, vertices):
    found = [np.zeros(12, np.uint16) for _ in TWINS]
    used = [
        twin.undo_first_use_planes(planes, vertices, out)
        for twin, out in zip(TWINS, found, strict=True)
    ]
    assert (used[0] == vertices) == (used[1] == vertices)
    if used[0] >= 0:
        assert used[0] == used[1]
        np.testing.assert_array_equal(*found)


@st.composite
def turned_strips(draw):
    """A strip whose triangles start anywhere, with some of any triangles among them."""
    corners = []
    for t in range(draw(st.integers(1, 40))):
        row = [t + 1, t, t + 2] if t % 2 else [t, t + 1, t + 2]
        if draw(st.integers(0, 5)) == 0:
            row = draw(st.lists(st.integers(0, t + 2), min_size=3, max_size=3))
        turn = draw(st.integers(0, 2))
        corners += row[turn:] + row[:turn]
    ids: dict[int, int] = {}
    local = [ids.setdefault(corner, len(ids)) for corner in corners]
    return np.array(local, np.uint16).reshape(-1, 3), len(ids)


def edges_of(twin, triangles):
    codes, extra = np.zeros(len(triangles), np.uint8), np.zeros(3 * len(triangles), np.uint16)
    used = twin.edge_codes(triangles, codes, extra)
    return used, codes, extra[: max(used, 0)]


@given(turned_strips())
def test_both_twins_give_the_same_edge_codes_and_the_indices_back(case):
    triangles, vertices = case
    used, codes, extra = edges_of(plain, triangles)
    again = edges_of(fast, triangles)
    assert used == again[0]
    if used < 0:
        return
    np.testing.assert_array_equal(codes, again[1])
    np.testing.assert_array_equal(extra, again[2])
    for twin in TWINS:
        found = np.zeros(triangles.size, np.uint16)
        assert twin.undo_edge_codes(codes, extra, vertices, found) == vertices
        np.testing.assert_array_equal(found, triangles.ravel())


@pytest.mark.parametrize("twin", TWINS, ids=IDS)
def test_edge_codes_of_a_fan_are_what_one_computes_by_hand(twin):
    triangles = np.array([[0, 1, 2], [0, 2, 3], [3, 4, 0], [2, 1, 0]], np.uint16)
    used, codes, extra = edges_of(twin, triangles)
    # 255: 0, 1, 2 are new. Edge (0, 2) is in slot 0, corner 0, and 3 is new: 0. Edge (0, 3) is in
    # slot 0, corner 2, and 4 is new: 2 (3 * 0 + 2). Edge (0, 2) is now in slot 4, at corner 2, and
    # vertex 1 is known, 4 below the mark of 5: 2 (3 * 4 + 2) + 1.
    assert codes.tolist() == [255, 0, 4, 29]
    assert extra.tolist() == [0, 0, 0, 4]
    assert used == 4


@pytest.mark.parametrize("twin", TWINS, ids=IDS)
def test_triangles_that_share_no_edges_are_given_up(twin):
    triangles = np.arange(9000, dtype=np.uint16).reshape(-1, 3)
    assert edges_of(twin, triangles)[0] == -1


@given(
    codes=st.lists(st.sampled_from([0, 1, 2, 3, 4, 5, 6, 95, 96, 254, 255]), max_size=8),
    extra=st.lists(st.integers(0, 9), max_size=12),
    vertices=st.integers(0, 12) | st.just(65_536),
)
def test_both_twins_refuse_the_same_broken_edge_codes(codes, extra, vertices):
    found = [np.zeros(3 * len(codes), np.uint16) for _ in TWINS]
    used = [
        twin.undo_edge_codes(np.array(codes, np.uint8), np.array(extra, np.uint16), vertices, out)
        for twin, out in zip(TWINS, found, strict=True)
    ]
    assert used[0] == used[1]
    if used[0] >= 0:
        np.testing.assert_array_equal(*found)
