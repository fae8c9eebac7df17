"""What is drawn in a frame and what is asked for: the cut through the tree (Chajdas 2014, 4.5).

The tree is walked level by level, all of a level's blocks at once. Nothing here knows GL or files.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .camera import View
from .tree import Nodes, Tree

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Boxes:
    """Where blocks are drawn, by row of the tree, in finest voxels."""

    low: NDArray[np.float64]  # (n, 3)
    high: NDArray[np.float64]  # (n, 3)
    edge: NDArray[np.float64]  # (n,) of a voxel, at most


@dataclass(frozen=True, slots=True)
class Cut:
    """One frame: rows of the tree, each list from near to far."""

    drawn: Nodes  # with colour
    probes: Nodes  # stand for children that were occluded; they show whether they still are
    inner: Nodes  # whose children are in the cut instead of them, coarse ones first
    wanted: Nodes  # not resident, the most undersampled first
    pages: set[int]  # of the directory, to be read
    undersampled: Nodes  # finest blocks whose voxels are larger than allowed


def walk(
    tree: Tree,
    view: View,
    resident: Flags,
    hidden: Flags,
    boxes: Boxes,
    *,
    pixel_error: float,
    closed: bool,
) -> Cut:
    """The cut of a frame.

    resident : (n,) blocks whose voxels can be drawn
    hidden : (n,) blocks that stand for their children, which were all occluded
    boxes : where blocks are drawn
    pixel_error : a voxel's edge on the screen is at most that many pixels, where the file has it
    closed : a block is refined when all its visible children are there, so that there is no hole;
        otherwise when one is (thesis, 4.6)
    """
    drawn, probes, inner, wanted, undersampled = ([np.empty(0, np.int64)] for _ in range(5))
    error: list[NDArray[np.float64]] = [np.empty(0)]
    pages: set[int] = set()
    nodes = tree.roots
    nodes = nodes[view.seen(boxes.low[nodes], boxes.high[nodes])]
    missing = nodes[~resident[nodes]]
    wanted.append(missing)
    error.append(np.full(len(missing), np.inf))
    nodes = nodes[resident[nodes]]
    while len(nodes):
        pixels = view.voxel_pixels(boxes.low[nodes], boxes.high[nodes], boxes.edge[nodes])
        fine = pixels <= pixel_error
        finest = tree.children[nodes] == 0
        undersampled.append(nodes[finest & ~fine])
        stands = hidden[nodes] & ~fine & ~finest
        probes.append(nodes[stands])
        refined = ~(fine | finest | stands)
        pages |= tree.link(nodes[refined])
        linked = refined & (tree.first_child[nodes] >= 0)
        # An occluded block has no children to ask for, and a page that is to come none to draw.
        drawn.append(nodes[~linked & ~stands])
        parents = nodes[linked]
        children = tree.children_of(parents)
        of = np.repeat(np.arange(len(parents)), tree.children[parents])
        seen = view.seen(boxes.low[children], boxes.high[children])
        here = resident[children]
        lacking = seen & ~here
        wanted.append(children[lacking])
        error.append(pixels[linked][of[lacking]])
        some = np.bincount(of[seen & here], minlength=len(parents)) > 0
        none = np.bincount(of[seen], minlength=len(parents)) == 0
        lack = np.bincount(of[lacking], minlength=len(parents)) > 0
        # A parent none of whose children is in sight shows nothing itself: its box was too large.
        ready = (~lack if closed else some) | none
        drawn.append(parents[~ready])
        inner.append(parents[ready])
        nodes = children[seen & here & ready[of]]
    order = np.argsort(-np.concatenate(error), kind="stable")
    return Cut(
        _by_distance(boxes, view, np.concatenate(drawn)),
        _by_distance(boxes, view, np.concatenate(probes)),
        np.concatenate(inner),
        np.concatenate(wanted)[order],
        pages,
        np.concatenate(undersampled),
    )


def _by_distance(boxes: Boxes, view: View, nodes: Nodes) -> Nodes:
    return nodes[np.argsort(view.distance(boxes.low[nodes], boxes.high[nodes]), kind="stable")]


class Occlusion:
    """What the last frames' flags say: which blocks stand for their occluded children.

    A block is hidden when no fragment of any of its children passed the depth test, or none of its
    own while its children are still to be read: then they are not. It is then drawn as a probe,
    all faces of its voxels, so that nothing its children show can be missed: they lie within them.
    A probe that passes brings the children back. Where the picture has not changed since they
    failed, they would fail again: the probe stays, without colour (thesis, figure 29: no flicker);
    otherwise it fills what nothing else covers until they are drawn.
    """

    def __init__(self) -> None:
        self.hidden = np.empty(0, np.bool_)
        self._when = np.empty(0, np.int64)  # the picture in which the children failed
        self._back = np.empty(0, np.int64)  # the picture in which it was a probe that passed
        self.settled = True  # did the last flags change nothing

    def grow(self, count: int) -> None:
        """Make room for the blocks of newly read pages."""
        more = count - len(self.hidden)
        self.hidden = np.concatenate((self.hidden, np.zeros(more, np.bool_)))
        self._when = np.concatenate((self._when, np.full(more, -1)))
        self._back = np.concatenate((self._back, np.full(more, -1)))

    def forget(self) -> None:
        """Show everything: occlusion culling was switched off."""
        self.hidden[:] = False

    def fresh(self, probes: Nodes, picture: int) -> Flags:
        """Which probes stand for children that failed in another picture than this one."""
        fresh: Flags = self._when[probes] != picture
        return fresh

    def update(
        self, tree: Tree, cut: Cut, passed: Flags, picture: int, *, whole: bool = True
    ) -> None:
        """Take the flags of a frame.

        passed : (n,) by row: did a fragment of this block pass the depth test
        picture : changes when the camera, the resident blocks or the scene do
        whole : of a picture that still lacks blocks, False: nothing comes back for it
        """
        visible = np.zeros(len(tree), np.bool_)
        visible[cut.drawn] = passed[cut.drawn]
        visible[cut.wanted] = True  # nobody knows: their parents wait for them
        probes = cut.probes
        seen = passed[probes]
        back = probes[seen & (self._when[probes] != picture)] if whole else probes[:0]
        visible[probes] = seen
        before = self.hidden.copy()
        self.hidden[back] = False
        self._back[back] = picture
        waiting = np.unique(tree.parent[cut.wanted])
        waiting = waiting[waiting >= 0]
        failed = waiting[~passed[waiting] & (self._back[waiting] != picture)]
        failed = np.intersect1d(failed, cut.drawn)
        self.hidden[failed] = True
        self._when[failed] = -1
        # Fine levels first: a block above is visible when one below is.
        for node in cut.inner[::-1]:
            first = tree.first_child[node]
            below = visible[first : first + tree.children[node]].any()
            visible[node] = below
            if not below:
                self.hidden[node] = True
                self._when[node] = picture
        self.settled = bool((before == self.hidden).all())
