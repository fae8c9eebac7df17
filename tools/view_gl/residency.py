"""Which blocks have their voxels on the GPU, which are on their way, which may leave (thesis, 4.6).

Blocks are rows of the tree. What a frame has no use for stays until its place is needed.
"""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from .buffers import WORD, PoolBuffer, Words
from .tree import Tree
from .visibility import Cut, Flags

RELIEF = 1.25  # by which the pixel error grows while the pool is too small, and shrinks again
ROOMY = 0.6  # of the pool: below it the pixel error may shrink


class ResidentVoxels:
    """The voxels of a tree's blocks in a pool of so many of them, of `stride` words each."""

    def __init__(self, context: moderngl.Context, tree: Tree, capacity: int, stride: int) -> None:
        self._tree = tree
        self.store = PoolBuffer(context, capacity, stride)
        self.here: Flags = np.empty(0, np.bool_)  # by row: can be drawn
        self.relief = 1.0  # times the pixel error, so that what is asked for has room
        self._waiting: list[tuple[int, Words]] = []  # read, not yet uploaded

    def grow(self) -> None:
        """Make room for the blocks of newly read pages."""
        more = len(self._tree) - len(self.here)
        self.here = np.concatenate((self.here, np.zeros(more, np.bool_)))

    def take(self, blocks: Sequence[tuple[int, Words]]) -> None:
        """Have blocks uploaded that were read."""
        self._waiting += [block for block in blocks if not self.here[block[0]]]

    @property
    def on_way(self) -> set[int]:
        """What was read and waits."""
        return {node for node, _ in self._waiting}

    def upload(self, limit: int | None) -> list[int]:
        """Upload what waits, up to so many bytes but one block at least; returns those blocks.

        Where they have no room, what waits is dropped, and the pixel error grows.
        """
        pool, size = self.store.pool, self.store.stride * WORD
        ready: list[tuple[int, Words]] = []
        total = 0
        while self._waiting:
            node, words = self._waiting[0]
            bytes_ = len(words) * size
            if ready and limit is not None and total + bytes_ > limit:
                break
            self._waiting.pop(0)
            if self.here[node] or node in pool:  # asked for again while it came
                continue
            if not self.store.make_room(node, len(words)):
                self.relief *= RELIEF
                self._waiting.clear()
                break
            ready.append((node, words))
            total += bytes_
        self.here[pool.evicted] = False
        pool.evicted.clear()
        self.store.upload(ready)
        uploaded = [node for node, _ in ready]
        self.here[uploaded] = True
        return uploaded

    def keep(self, cuts: Sequence[Cut]) -> None:
        """Release what the cuts have no use for; what they have, is in use again."""
        pool, tree = self.store.pool, self._tree
        keep = np.zeros(len(tree), np.bool_)
        keep[tree.roots] = True
        for cut in cuts:
            parents = np.unique(tree.parent[cut.wanted])
            siblings = tree.children_of(parents[parents >= 0])
            for needed in (cut.drawn, cut.probes, cut.inner, siblings):
                keep[needed] = True
        for node in np.flatnonzero(self.here).tolist():
            if keep[node] and node not in pool:
                pool.resurrect(node)
            elif not keep[node] and node in pool:
                pool.release(node)
        lacking = any(len(cut.wanted) for cut in cuts)
        if self.relief > 1.0 and not lacking and pool.used < ROOMY * pool.capacity:
            self.relief = max(1.0, self.relief / RELIEF)
