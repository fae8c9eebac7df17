"""Source triangles cut at the borders of blocks: exact, inside, and without a gap between them."""

from collections import Counter, defaultdict

import numpy as np
import pytest
from exact import piece_oracle
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gstream.kernels.morton import decode_codes
from gstream.kernels.pieces import cut_at_borders, indexed
from gstream.kernels.voxelize import BoxFullError

Ints = NDArray[np.int64]


def cut(corners: Ints, log2: int, blocks: int) -> Ints:
    """(n, 3, 3) pieces in a box of so many blocks per axis, in coordinates of the box."""
    rows = cut_at_borders(corners, log2, np.full(3, blocks << log2))
    places = decode_codes(rows[:, 0].astype(np.uint32)).astype(np.int64)
    assert ((rows[:, 1:] >= 0) & (rows[:, 1:] <= 1 << log2)).all()
    return rows[:, 1:].reshape(-1, 3, 3) + (places << log2)[:, None]


def by_block(points: Ints, log2: int, blocks: int) -> dict[tuple[int, ...], list[list[int]]]:
    """The pieces of one triangle in each block, relative to it."""
    rows = cut_at_borders(points[None], log2, np.full(3, blocks << log2))
    found = defaultdict(list)
    for place, row in zip(decode_codes(rows[:, 0].astype(np.uint32)), rows.tolist(), strict=True):
        found[tuple(place.tolist())].append(row[1:])
    return found


def open_edges(triangles: Ints) -> Counter:
    """Directed edges that are not there as often as their reverses."""
    edges = Counter()
    for corners in triangles.tolist():
        for p, q in zip(corners, corners[1:] + corners[:1], strict=True):
            edges[tuple(p), tuple(q)] += 1
    return Counter({e: n for e, n in edges.items() if n != edges[e[::-1]]})


def vector_areas(triangles: Ints) -> Ints:
    """Twice the area vectors."""
    a, b, c = triangles.swapaxes(0, 1)
    return np.cross(b - a, c - a)


@st.composite
def boxes(draw, corners):
    """(points (corners, 3), log2 of the block, blocks per axis): many points on borders."""
    log2, blocks = draw(st.integers(1, 20)), draw(st.integers(1, 5))
    size, end = 1 << log2, blocks << log2
    near = st.builds(
        lambda block, off: min(max(block * size + off, 0), end - 1),
        st.integers(0, blocks), st.integers(-3, 3),
    )  # fmt: skip
    coordinate = st.one_of(st.integers(0, end - 1), near)
    points = draw(st.lists(st.tuples(*[coordinate] * 3), min_size=corners, max_size=corners))
    return np.array(points, np.int64), log2, blocks


@given(boxes(3))
def test_the_pieces_of_a_triangle_are_those_of_the_rule_in_rationals(box):
    points, log2, blocks = box
    found = Counter(
        piece_oracle.turned(*map(tuple, piece))
        for piece in cut(points[None], log2, blocks).tolist()
    )
    assert found == piece_oracle.pieces([tuple(p) for p in points.tolist()], 1 << log2)


@pytest.mark.parametrize("log2", [1, 2, 3, 5])
def test_coarsely_snapped_triangles_whose_cut_points_meet_are_cut_by_the_rule_too(log2):
    # In one of ten of these, rounding moves two points of a ring into a plane that cuts it.
    rng = np.random.default_rng(log2)
    for corners in rng.integers(0, 4 << log2, (1500, 3, 3)):
        found = Counter(
            piece_oracle.turned(*map(tuple, p)) for p in cut(corners[None], log2, 4).tolist()
        )
        assert found == piece_oracle.pieces([tuple(p) for p in corners.tolist()], 1 << log2)


@given(boxes(6))
def test_the_pieces_of_closed_meshes_close_up_across_blocks(box):
    points, log2, blocks = box
    faces = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)])
    solids = [faces, faces + 1, faces + 2, 5 - faces]  # tetrahedra that share corners and edges
    assert not open_edges(cut(points[np.concatenate(solids)], log2, blocks))


@given(boxes(3), st.permutations(range(3)))
def test_turning_the_corners_of_a_triangle_changes_no_piece(box, order):
    points, log2, blocks = box
    turn = order[0]
    whole, turned = (cut(p[None], log2, blocks) for p in (points, np.roll(points, turn, axis=0)))
    assert np.array_equal(whole, turned)


@given(boxes(3), st.tuples(*[st.integers(-3, 3)] * 3))
def test_a_box_elsewhere_holds_the_same_pieces_of_the_blocks_that_both_have(box, step):
    points, log2, blocks = box
    here = by_block(points, log2, blocks)
    moved = by_block(points - (np.array(step) << log2), log2, blocks)
    there = {tuple(np.add(place, step).tolist()): rows for place, rows in moved.items()}
    common = {p for p in here if all(0 <= c - s < blocks for c, s in zip(p, step, strict=True))}
    assert all(here[place] == there[place] for place in common)


@given(boxes(3))
def test_the_area_vectors_of_pieces_sum_to_the_triangles_but_for_rounding_its_edges(box):
    points, log2, blocks = box
    pieces = cut(points[None], log2, blocks)
    error = np.abs(vector_areas(pieces).sum(axis=0) - vector_areas(points[None])[0]).max()
    edges = np.abs(points - np.roll(points, 1, axis=0)).sum()
    cuts = 3 * 3 * blocks  # points that the planes of three axes make on three edges
    assert error <= 4 * edges + 8 * cuts  # each of them is moved by a unit per axis at most


@given(boxes(3))
def test_corners_of_pieces_are_within_a_unit_per_axis_of_their_triangle(box):
    points, log2, blocks = box
    for corner in {tuple(p) for p in cut(points[None], log2, blocks).reshape(-1, 3).tolist()}:
        assert distance(np.array(corner, float), points.astype(float)) <= 3**0.5 + 1e-6


def distance(p, triangle):
    """From a point to a triangle: the least over its inside and its edges."""
    a, b, c = triangle
    least = min(
        np.linalg.norm(p - (s + np.clip(np.dot(p - s, d) / max(np.dot(d, d), 1e-300), 0, 1) * d))
        for s, d in ((a, b - a), (b, c - b), (c, a - c))
    )
    normal = np.cross(b - a, c - a)
    if (normal == 0).all():
        return least
    sides = [np.dot(np.cross(normal, e - s), p - s) for s, e in ((a, b), (b, c), (c, a))]
    return (
        min(least, abs(np.dot(p - a, normal)) / np.linalg.norm(normal))
        if min(sides) >= 0
        else least
    )


def test_a_triangle_in_a_border_is_in_the_block_above_alone():
    for axis in range(3):
        corners = np.array([[1, 1, 1], [7, 1, 1], [1, 7, 1]])
        corners[:, [2, axis]] = corners[:, [axis, 2]]
        corners[:, axis] = 8
        rows = cut_at_borders(corners[None], 3, np.full(3, 32))
        assert rows[:, 0].tolist() == [1 << axis]


def test_more_pieces_than_there_is_room_for_are_refused():
    corners, room = np.array([[[0, 0, 0], [4000, 3, 0], [3, 4000, 900]]]), np.full(3, 4096)
    count = len(cut_at_borders(corners, 3, room))
    assert count > 100_000
    assert len(cut_at_borders(corners, 3, room, count)) == count
    with pytest.raises(BoxFullError):
        cut_at_borders(corners, 3, room, count - 1)


@pytest.mark.parametrize("end", [5, 8, 13])
def test_nothing_is_left_beyond_the_end_of_the_grid(end):
    corners = np.array([[[0, 0, 0], [20, 3, 0], [3, 20, 9]]])
    pieces = cut_at_borders(corners, 3, np.full(3, end))
    places = decode_codes(pieces[:, 0].astype(np.uint32)).astype(np.int64)
    assert (pieces[:, 1:].reshape(-1, 3, 3) + (places << 3)[:, None]).max() == end


POINTS = st.tuples(*[st.integers(0, 3)] * 3)
TRIANGLES = st.lists(POINTS, min_size=3, max_size=3, unique=True)


@given(st.lists(TRIANGLES, min_size=1, max_size=20))
def test_numbered_triangles_are_the_same_in_any_order_and_turn(triangles):
    corners = np.array(triangles, np.int32)
    vertices, numbers = indexed(corners)
    assert len(np.unique(vertices, axis=0)) == len(vertices)
    other = np.roll(corners[::-1], 1, axis=1)
    assert all(
        np.array_equal(a, b) for a, b in zip((vertices, numbers), indexed(other), strict=True)
    )
    want = Counter(piece_oracle.turned(*t) for t in triangles)
    assert Counter(piece_oracle.turned(*map(tuple, t)) for t in vertices[numbers].tolist()) == want
