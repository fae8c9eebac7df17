"""The order of a chunk's triangles: nothing is lost, and neighbours follow each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gstream.kernels.neighbours import follow_edges


def walk(triangles):
    used = len(np.unique(triangles))
    order, ids = np.empty(len(triangles), np.int64), np.empty(used, np.int64)
    renamed = np.empty_like(triangles)
    follow_edges(triangles, order, ids, renamed)
    return order, ids, renamed


def numbered(triangles):
    """The same triangles with vertices 0, 1, 2, ... and none unused."""
    return np.unique(triangles, return_inverse=True)[1].reshape(-1, 3).astype(np.uint16)


@st.composite
def pieces_of_a_sheet(draw):
    """Some triangles of a sheet of squares, shuffled, each from a corner by chance."""
    wide, high = draw(st.integers(1, 7)), draw(st.integers(1, 7))
    first = ((wide + 1) * np.arange(high)[:, None] + np.arange(wide)).ravel()
    quads = np.stack([first, first + 1, first + wide + 1, first + 1, first + wide + 2], axis=1)
    sheet = np.concatenate([quads[:, :3], quads[:, [3, 4, 2]]])
    kept = draw(st.permutations(range(len(sheet))))[: draw(st.integers(1, len(sheet)))]
    turns = draw(st.lists(st.integers(0, 2), min_size=len(kept), max_size=len(kept)))
    return numbered(np.array([np.roll(sheet[t], k) for t, k in zip(kept, turns, strict=True)]))


ANY = hnp.arrays(np.uint16, st.tuples(st.integers(1, 40), st.just(3)), elements=st.integers(0, 9))


@given(pieces_of_a_sheet() | ANY.map(numbered))
def test_every_triangle_is_there_once_from_its_first_corner(triangles):
    order, ids, renamed = walk(triangles)
    assert sorted(order.tolist()) == list(range(len(triangles)))
    np.testing.assert_array_equal(ids[renamed], triangles[order])


@given(pieces_of_a_sheet() | ANY.map(numbered))
def test_vertices_are_numbered_in_order_of_first_use(triangles):
    renamed = walk(triangles)[2].ravel()
    _, first = np.unique(renamed, return_index=True)
    assert (np.diff(first) > 0).all()
    assert renamed.max() + 1 == len(first)


def edges(triangle):
    a, b, c = triangle.tolist()
    return {(a, b), (b, c), (c, a)}


def count_pieces(triangles):
    """How many sets of triangles that hang together by edges; repeated joining, no search."""
    pieces = [edges(triangle) for triangle in triangles]
    for triangle in triangles:
        back = {(b, a) for a, b in edges(triangle)}
        touching = [p for p in pieces if p & back or p & edges(triangle)]
        pieces = [p for p in pieces if p not in touching] + [set().union(*touching)]
    return len(pieces)


@given(pieces_of_a_sheet())
def test_a_piece_of_a_surface_is_left_only_when_it_is_done(triangles):
    order = walk(triangles)[0]
    seen, starts = set(), 0
    for triangle in triangles[order]:
        starts += not {(b, a) for a, b in edges(triangle)} & seen
        seen |= edges(triangle)
    assert starts == count_pieces(triangles)


def test_the_walk_turns_to_the_youngest_edge_first():
    # A fan of four around vertex 0, from its second triangle; then one that touches nothing.
    fan = np.array([[0, 2, 3], [0, 3, 4], [0, 1, 2], [0, 4, 5], [6, 7, 8]], np.uint16)
    order, ids, renamed = walk(fan)
    # Across edge (3, 0) of the first lies [0, 3, 4], beyond it [0, 4, 5]; then back to edge (0, 2).
    assert order.tolist() == [0, 1, 3, 2, 4]
    assert ids.tolist() == [0, 2, 3, 4, 5, 1, 6, 7, 8]
    assert renamed.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 5, 1], [6, 7, 8]]


def test_a_full_chunk_of_65536_vertices_and_triangles_is_walked():
    corners = np.arange(65_536)
    triangles = np.stack([corners, (corners + 1) % 65_536, (corners + 2) % 65_536], axis=1)
    triangles[1::2] = triangles[1::2, [1, 0, 2]]
    shuffled = np.random.default_rng(3).permutation(triangles).astype(np.uint16)
    order, ids, renamed = walk(shuffled)
    np.testing.assert_array_equal(ids[renamed], shuffled[order])
    steps = np.abs(np.diff(shuffled[order].min(axis=1).astype(np.int64)))
    assert np.median(steps) == 1  # a strip is walked along


@pytest.mark.parametrize("count", [0, 1])
def test_a_chunk_of_none_or_one_is_its_own_order(count):
    triangles = np.arange(3 * count, dtype=np.uint16).reshape(-1, 3)
    np.testing.assert_array_equal(walk(triangles)[2], triangles)


def test_a_fan_about_one_hub_is_put_in_order_whole():
    rim = np.arange(1, 1000)
    fan = np.stack([np.zeros(999), rim, rim + 1], axis=1).astype(np.uint16)[::-1]
    order, ids, renamed = walk(fan)
    assert sorted(order.tolist()) == list(range(999))
    np.testing.assert_array_equal(ids[renamed], fan[order])
