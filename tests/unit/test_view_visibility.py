"""tools/view_gl/tree and visibility: the cut covers what is in sight once, as fine as it can be."""

from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_block_files import file_bytes
from view_trees import (
    GRID,
    SIZE,
    UNIT,
    ancestors,
    boxes_of,
    cover,
    names,
    opened,
    scene,
    stored,
    tree_of,
    whole_tree,
)  # fmt: skip

from gstream_tools.reader_py import CorruptFileError
from gstream_tools.view_gl.camera import Camera, View
from gstream_tools.view_gl.tree import UNREAD, Tree
from gstream_tools.view_gl.visibility import walk


def places(tree):
    return tree.level.tolist(), tree.key.tolist()


def look(seed):
    """A camera anywhere in the grid or around it, of either kind."""
    rng = np.random.default_rng(seed)
    position, target = rng.uniform(-SIZE, 2 * SIZE, 3), rng.uniform(0, SIZE, 3)
    if rng.random() < 0.3:
        position = rng.uniform(0, SIZE, 3)
    height = float(rng.choice([0, 0, 5, 100]))
    camera = Camera(tuple(position), tuple(target), fov=rng.uniform(5, 120), height=height)
    return View.of(camera, (int(rng.integers(1, 900)), int(rng.integers(1, 900))), UNIT, GRID)


def flags(tree, seed, share):
    return np.random.default_rng(seed).random(len(tree)) < share


seeds = st.integers(0, 2**32 - 1)
trees = st.integers(0, 3).map(tree_of)
errors = st.one_of(st.sampled_from([0.0, inf]), st.floats(1, 100))


@st.composite
def walks(draw):
    """A tree, and a cut of it with whatever was loaded; roots always are."""
    tree, view = draw(trees), look(draw(seeds))
    resident = flags(tree, draw(seeds), draw(st.sampled_from([0.0, 0.5, 0.9, 1.0, 1.0])))
    resident[tree.roots] = True
    behind = flags(tree, draw(seeds), draw(st.sampled_from([0.0, 0.0, 0.2, 1.0])))
    error, closed = draw(errors), draw(st.booleans())
    cut = walk(tree, view, resident, behind, boxes_of(tree), pixel_error=error, closed=closed)
    return tree, view, resident, behind, error, closed, cut


def test_children_are_those_that_keys_and_masks_name():
    tree = tree_of(0)
    rows = {name: n for n, name in enumerate(zip(*places(tree), strict=True))}
    assert set(rows) == set(scene(0).blocks)
    for (level, key), row in rows.items():
        children = [
            rows[level - 1, 8 * key + c] for c in range(8) if (level - 1, 8 * key + c) in rows
        ]
        assert tree.children_of(np.array([row])).tolist() == children
        assert tree.parent[row] == rows.get((level + 1, key >> 3), -1)
        assert tree.count[row] == scene(0).blocks[level, key].count


def test_boxes_hold_the_boxes_of_children_and_no_more_than_their_block():
    tree = tree_of(0)
    below = np.flatnonzero(tree.parent >= 0)
    assert (tree.low[tree.parent[below]] <= tree.low[below]).all()
    assert (tree.high[tree.parent[below]] >= tree.high[below]).all()
    edge = tree.edge[:, None]
    assert (tree.low >= tree.corner * edge).all()
    assert (tree.high <= (tree.corner + 8) * edge).all()


def test_a_link_says_which_pages_it_lacks_and_finds_children_when_they_came():
    tree = Tree(opened(stored(0)))
    tree.add_page(0)
    inner = np.flatnonzero(tree.level > 0)
    lacking = tree.link(inner)
    assert lacking
    assert (tree.first_child[inner] == UNREAD).any()
    tree.rows_of_pages(lacking)
    assert tree.link(inner) == set()
    assert (tree.first_child[inner] >= 0).all()


@pytest.mark.parametrize("change", [1, 2, 4, 8, 16, 32, 64, 128])
def test_a_child_mask_that_lies_is_refused(change):
    def lie(rows):
        rows = rows.copy()
        rows["children"][np.argmax(rows["level"])] ^= change
        return rows

    file = opened(file_bytes(scene(0), alter_rows=lie))
    with pytest.raises(CorruptFileError, match=r"block 0 of level 3.*\[GSB-0306\]"):
        whole_tree(file)


@given(walks())
def test_a_finest_block_in_sight_is_covered_once_in_closed_mode_and_never_twice(found):
    tree, view, _, _, _, closed, cut = found
    covered = cover(tree, np.concatenate((cut.drawn, cut.probes)))
    assert covered.max() <= 1
    if closed:
        leaves = (tree.level == 0) & view.seen(tree.low, tree.high)
        assert (covered[leaves] == 1).all()


@given(walks())
def test_what_is_drawn_is_loaded_and_in_sight(found):
    tree, view, resident, _, _, _, cut = found
    for nodes in (cut.drawn, cut.probes):
        assert resident[nodes].all()
        assert view.seen(tree.low[nodes], tree.high[nodes]).all()
        assert len(set(nodes.tolist())) == len(nodes)


@given(walks())
def test_voxels_are_too_large_only_of_finest_blocks_and_where_children_are_wanted(found):
    tree, view, _, _, error, closed, cut = found
    pixels = view.voxel_pixels(tree.low, tree.high, tree.edge)
    coarse = cut.drawn[pixels[cut.drawn] > error]
    finest = tree.level[coarse] == 0
    assert set(coarse[finest].tolist()) == set(cut.undersampled.tolist())
    assert set(coarse[~finest].tolist()) <= set(tree.parent[cut.wanted].tolist())
    assert closed or not set(coarse[~finest].tolist()) & set(cut.inner.tolist())


@given(walks())
def test_probes_are_hidden_blocks_whose_voxels_are_too_large(found):
    tree, view, _, hidden, error, _, cut = found
    assert not hidden[cut.inner].any()
    assert hidden[cut.probes].all()
    probes = cut.probes
    pixels = view.voxel_pixels(tree.low[probes], tree.high[probes], tree.edge[probes])
    assert (pixels > error).all()
    assert (tree.level[probes] > 0).all()


@given(walks())
def test_what_is_wanted_is_in_sight_not_loaded_and_needed(found):
    tree, view, resident, hidden, error, _, cut = found
    wanted = cut.wanted
    assert len(set(wanted.tolist())) == len(wanted)
    assert not resident[wanted].any()
    assert view.seen(tree.low[wanted], tree.high[wanted]).all()
    parents = tree.parent[wanted]
    pixels = view.voxel_pixels(tree.low[parents], tree.high[parents], tree.edge[parents])
    assert (pixels > error).all()
    assert (np.diff(pixels[np.isfinite(pixels)]) <= 0).all()
    assert not hidden[parents].any()


@given(walks())
def test_blocks_are_drawn_from_near_to_far(found):
    tree, view, *_, cut = found
    for nodes in (cut.drawn, cut.probes):
        away = view.distance(tree.low[nodes], tree.high[nodes])
        assert (np.diff(away) >= 0).all()


@given(walks())
def test_inner_blocks_come_before_those_below_them_and_are_not_drawn(found):
    tree, *_, cut = found
    assert (np.diff(tree.level[cut.inner]) <= 0).all()
    assert not set(cut.inner.tolist()) & {*cut.drawn.tolist(), *cut.probes.tolist()}
    assert set(cut.inner.tolist()) >= set(ancestors(tree, cut.drawn))


@given(trees, seeds, seeds)
def test_a_camera_inside_a_block_sees_it_at_its_finest(tree, seed, direction):
    rng = np.random.default_rng(seed)
    leaf = int(rng.choice(np.flatnonzero(tree.level == 0)))
    position = rng.uniform(tree.low[leaf], tree.high[leaf])
    ahead = np.random.default_rng(direction).normal(size=3)
    camera = Camera(tuple(position), tuple(position + ahead), fov=float(rng.uniform(20, 120)))
    view = View.of(camera, (640, 480), UNIT, GRID)
    here, none = np.ones(len(tree), bool), np.zeros(len(tree), bool)
    cut = walk(tree, view, here, none, boxes_of(tree), pixel_error=1.0, closed=True)
    reach = np.abs(ahead) / np.linalg.norm(ahead) @ (tree.high[leaf] - tree.low[leaf])
    if reach > 0.1:  # it reaches beyond the near plane
        assert leaf in cut.drawn


def test_any_error_allowed_draws_the_roots_and_none_allowed_all_that_is_in_sight():
    tree = tree_of(0)
    here, none = np.ones(len(tree), bool), np.zeros(len(tree), bool)
    view = View.of(Camera((200, 150, 90), (32, 32, 32), fov=60.0), (640, 480), UNIT, GRID)
    for error, level in ((inf, 3), (0.0, 0)):
        cut = walk(tree, view, here, none, boxes_of(tree), pixel_error=error, closed=True)
        assert set(cut.drawn.tolist()) == set(np.flatnonzero(tree.level == level).tolist())


@given(st.integers(0, 3), seeds, errors, st.booleans(), st.integers(5, 200))
def test_streaming_has_no_holes_and_ends_with_the_cut_of_a_file_that_is_wholly_there(
    seed, where, error, closed, step
):
    view, ideal = look(where), tree_of(seed)
    here, none = np.ones(len(ideal), bool), np.zeros(len(ideal), bool)
    end = walk(ideal, view, here, none, boxes_of(ideal), pixel_error=error, closed=closed)
    row = {name: n for n, name in enumerate(zip(*places(ideal), strict=True))}
    leaves = (ideal.level == 0) & view.seen(ideal.low, ideal.high)
    tree = Tree(opened(stored(seed)))
    tree.add_page(0)
    loaded = set()
    for _ in range(500):
        resident = np.array([name in loaded for name in zip(*places(tree), strict=True)])
        none = np.zeros(len(tree), bool)
        cut = walk(tree, view, resident, none, boxes_of(tree), pixel_error=error, closed=closed)
        covered = cover(ideal, [row[name] for name in names(tree, cut.drawn)])
        assert covered.max() <= 1
        if closed and loaded:  # also while pages are to come
            assert (covered[leaves] == 1).all()
        if not (len(cut.wanted) or cut.pages):
            break
        loaded |= names(tree, cut.wanted[:step])
        tree.rows_of_pages(cut.pages)
    assert names(tree, cut.drawn) == names(ideal, end.drawn)
    assert loaded <= names(ideal, np.concatenate((end.drawn, end.inner)))
