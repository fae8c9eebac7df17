"""The octree of blocks as far as its directory pages were read: one row of arrays per block."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..reader_py import BlockFile, CorruptFileError

Floats = NDArray[np.float64]
Nodes = NDArray[np.int64]  # rows

UNREAD = -1  # of `first_child`: the page of the children was not read yet


class Tree:
    """Blocks as rows, in the order in which their pages came; siblings are always neighbours.

    Boxes are the tight bounds of the entries, in finest voxels, upper ends exclusive.
    """

    def __init__(self, file: BlockFile) -> None:
        self._file = file
        self._base: dict[int, int] = {}  # page -> its first row
        self.entries: list[Any] = []  # by row, as the reader gives them
        self.level = np.empty(0, np.int64)
        self.key = np.empty(0, np.int64)
        self.count = np.empty(0, np.int64)
        self.children = np.empty(0, np.int64)  # how many there are
        self.first_child = np.empty(0, np.int64)
        self.parent = np.empty(0, np.int64)  # -1 while it is not known, and of roots
        self.low = np.empty((0, 3))
        self.high = np.empty((0, 3))
        self.corner = np.empty((0, 3), np.int64)  # of the block itself, in voxels of its level

    def __len__(self) -> int:
        return len(self.level)

    @property
    def roots(self) -> Nodes:
        """The blocks of the coarsest level: the first pages have them."""
        return np.flatnonzero(self.level == self._file.levels - 1)

    @property
    def edge(self) -> Floats:
        """(n,) the edge of a voxel of each block, in finest voxels."""
        return np.ldexp(1.0, self.level.astype(np.int32))

    def add_page(self, number: int) -> None:
        """Read a page's entries, if they are not here yet."""
        if number in self._base:
            return
        page = self._file.page(number)
        self._base[number] = len(self)
        self.entries.extend(page)
        level, key = page["level"].astype(np.int64), page["key"].astype(np.int64)
        corner = np.stack([_every_third_bit(key >> axis) for axis in range(3)], axis=1)
        corner <<= self._file.block_log2
        edge = np.ldexp(1.0, level.astype(np.int32))[:, None]
        bits = np.unpackbits(page["children"][:, None], axis=1).sum(axis=1, dtype=np.int64)
        rows = {
            "level": level,
            "key": key,
            "count": page["count"].astype(np.int64),
            "children": bits,
            "first_child": np.full(len(page), UNREAD),
            "parent": np.full(len(page), -1),
            "low": (corner + page["low"]) * edge,
            "high": (corner + page["high"] + 1) * edge,
            "corner": corner,
        }
        for name, values in rows.items():
            setattr(self, name, np.concatenate((getattr(self, name), values)))

    def link(self, nodes: Nodes) -> set[int]:
        """Find the children of nodes that have some; returns the pages that this lacks.

        errors : CorruptFileError where a child mask does not name exactly the children there are
        """
        lacking = set()
        for node in nodes[(self.first_child[nodes] == UNREAD) & (self.children[nodes] > 0)]:
            level, key = int(self.level[node]) - 1, int(self.key[node]) << 3
            # The last key that a sibling may have: the first may lie before its page's first.
            page = self._file.page_of(level, key | 7)
            if page not in self._base:
                lacking.add(page)
                continue
            base = self._base[page]
            end = base + len(self._file.page(page))
            # A page may hold several levels, coarse ones first: the pair (-level, key) ascends.
            here = self.level[base:end]
            start = base + int(np.searchsorted(-here, -level, "left"))
            stop = base + int(np.searchsorted(-here, -level, "right"))
            first = start + int(np.searchsorted(self.key[start:stop], key, "left"))
            last = start + int(np.searchsorted(self.key[start:stop], key | 7, "right"))
            mask = np.atleast_1d(self.entries[node]["children"])
            named = key + np.flatnonzero(np.unpackbits(mask, bitorder="little"))
            if not np.array_equal(self.key[first:last], named):
                where = f"block {key >> 3} of level {level + 1}"
                raise CorruptFileError("GSB-0306", "its mask names other children", where)
            self.first_child[node] = first
            self.parent[first : first + int(self.children[node])] = node
        return lacking

    def children_of(self, nodes: Nodes) -> Nodes:
        """The children of linked nodes, those of one node side by side, in the order of `nodes`."""
        counts = self.children[nodes]
        starts = np.repeat(self.first_child[nodes] - (np.cumsum(counts) - counts), counts)
        return starts + np.arange(len(starts))

    def rows_of_pages(self, pages: Iterable[int]) -> None:
        """Read several pages."""
        for page in sorted(pages):
            self.add_page(page)


def _every_third_bit(codes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Bits 0, 3, 6, … of 48-bit codes, side by side: one coordinate of a Morton code."""
    codes = codes & 0x249249249249
    for shift, mask in (
        (2, 0x0C30C30C30C3),
        (4, 0x00F00F00F00F),
        (8, 0x0000FF0000FF),
        (16, 0x00000000FFFF),
    ):
        codes = (codes | codes >> shift) & mask
    return codes
