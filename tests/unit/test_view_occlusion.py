"""tools/view_gl/visibility, Occlusion: pictures settle, lose nothing in sight, and do not flicker.

What passes the depth test is given: some finest blocks, the blocks above them, and some blocks that
pass although nothing below them does, since coarse voxels are larger than what they stand for.
"""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from view_trees import GRID, UNIT, ancestors, boxes_of, cover, tree_of

from gstream_tools.view_gl.camera import Camera, View
from gstream_tools.view_gl.visibility import Occlusion, walk

VIEW = View.of(Camera((200, 150, 90), (32, 32, 32), fov=60.0), (640, 480), UNIT, GRID)  # sees all
LEVELS = 4

seeds = st.integers(0, 2**32 - 1)
shares = st.sampled_from([0.0, 0.01, 0.1, 0.5, 1.0])


class Viewer:
    """Frames of a tree whose blocks pass the depth test as given."""

    def __init__(self, tree, closed=True, loaded=True):
        self.tree, self.closed, self.picture = tree, closed, 0
        self.resident = np.full(len(tree), loaded)
        self.resident[tree.roots] = True
        self.history = Occlusion()
        self.history.grow(len(tree))

    def show(self, seed, leaves, hulls):
        """Another picture: these shares of finest blocks, and of others, pass."""
        rng, tree = np.random.default_rng(seed), self.tree
        self.visible = (rng.random(len(tree)) < leaves) & (tree.level == 0)
        self.passing = rng.random(len(tree)) < hulls
        self.passing[tree.level == 0] = False
        self.passing[self.visible] = True
        self.passing[ancestors(tree, np.flatnonzero(self.visible))] = True
        self.picture += 1

    def frame(self):
        cut = walk(
            self.tree, VIEW, self.resident, self.history.hidden, boxes_of(self.tree),
            pixel_error=0.0, closed=self.closed,
        )  # fmt: skip
        fresh = cut.probes[self.history.fresh(cut.probes, self.picture)]
        passed = np.zeros(len(self.tree), bool)
        for nodes in (cut.drawn, cut.probes):
            passed[nodes] = self.passing[nodes]
        self.history.update(self.tree, cut, passed, self.picture)
        return cut, cover(self.tree, np.concatenate((cut.drawn, fresh))) > 0

    def settle(self, frames):
        for _ in range(frames):
            cut, _ = self.frame()
        return cut


def picture(cut):
    return cut.drawn.tolist(), cut.probes.tolist(), cut.inner.tolist()


@st.composite
def viewers(draw, hulls=shares):
    """A viewer that has seen some pictures, each for a while, and is shown another now."""
    viewer = Viewer(tree_of(draw(st.integers(0, 3))), draw(st.booleans()))
    for _ in range(draw(st.integers(0, 3))):
        viewer.show(draw(seeds), draw(shares), draw(shares))
        viewer.settle(draw(st.integers(1, 6)))
    viewer.show(draw(seeds), draw(shares), draw(hulls))
    return viewer


@given(viewers())
def test_a_picture_that_does_not_change_settles_and_stays(viewer):
    settled = picture(viewer.settle(2 * LEVELS))
    for _ in range(10):
        cut, _ = viewer.frame()
        assert picture(cut) == settled
        assert viewer.history.settled


@given(viewers())
def test_what_is_visible_is_drawn_within_as_many_frames_as_there_are_levels(viewer):
    cut = viewer.settle(LEVELS)
    assert set(np.flatnonzero(viewer.visible).tolist()) <= set(cut.drawn.tolist())


@given(viewers())
def test_what_is_visible_is_covered_by_something_with_colour_in_every_frame(viewer):
    for _ in range(2 * LEVELS):
        _, covered = viewer.frame()
        assert covered[viewer.visible].all()


@given(viewers())
def test_once_drawn_what_is_visible_stays_drawn(viewer):
    before = set()
    for _ in range(2 * LEVELS):
        cut, _ = viewer.frame()
        shown = set(cut.drawn[viewer.visible[cut.drawn]].tolist())
        assert before <= shown
        before = shown


@given(viewers(hulls=st.just(0.0)))
def test_a_branch_that_is_occluded_sinks_to_its_coarsest_block(viewer):
    cut = viewer.settle(2 * LEVELS)
    tree = viewer.tree
    needed = set(ancestors(tree, np.flatnonzero(viewer.visible)))
    assert set(cut.inner.tolist()) == needed
    expected = tree.children_of(np.array(sorted(needed), np.int64))
    ends = [n for n in expected.tolist() if n not in needed] if needed else tree.roots.tolist()
    assert sorted([*cut.drawn.tolist(), *cut.probes.tolist()]) == sorted(ends)


@given(st.integers(0, 3), seeds, shares, shares, st.booleans(), st.integers(20, 200))
def test_what_is_visible_is_loaded_and_drawn_however_few_blocks_come_at_a_time(
    tree, seed, leaves, hulls, closed, step
):
    viewer = Viewer(tree_of(tree), closed, loaded=False)
    viewer.show(seed, leaves, hulls)
    for _ in range(3000):
        cut, _ = viewer.frame()
        if not len(cut.wanted) and viewer.history.settled:
            break
        arrived = cut.wanted[:step]
        viewer.resident[arrived] = True
        viewer.picture += len(arrived) > 0
    cut = viewer.settle(2 * LEVELS)
    assert set(np.flatnonzero(viewer.visible).tolist()) <= set(cut.drawn.tolist())


@given(st.integers(0, 3), seeds, shares, shares, shares, st.booleans())
def test_what_is_visible_and_lacking_is_wanted_until_it_comes(
    tree, seed, leaves, hulls, share, closed
):
    viewer = Viewer(tree_of(tree), closed)
    viewer.show(seed, leaves, hulls)
    tree = viewer.tree
    viewer.resident &= (np.random.default_rng(seed).random(len(tree)) < share) | (tree.parent < 0)
    cut = viewer.settle(2 * LEVELS)
    assert cover(tree, np.concatenate((cut.wanted, cut.drawn)))[viewer.visible].all()


def test_switching_occlusion_off_shows_everything():
    viewer = Viewer(tree_of(0))
    viewer.show(0, 0.0, 0.0)
    assert viewer.settle(LEVELS).drawn.tolist() == []
    viewer.history.forget()
    cut, _ = viewer.frame()
    assert (viewer.tree.level[cut.drawn] == 0).all()
    assert len(cut.drawn) == (viewer.tree.level == 0).sum()
