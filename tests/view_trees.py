"""Trees of small block files, as a viewer has them."""

from functools import cache

import numpy as np
from small_block_files import Paging, file_bytes, random_scene

from gstream_tools.reader_py import BlockFile
from gstream_tools.view_gl.tree import Tree
from gstream_tools.view_gl.visibility import Boxes

SIZE = 64
UNIT = np.eye(3, 4)
GRID = np.array([[0.0] * 3, [float(SIZE)] * 3])


class Memory:
    name = "memory"

    def __init__(self, data):
        self.data, self.size = data, len(data)

    def read(self, offset, length):
        return self.data[offset : offset + length]

    def close(self):
        pass


def opened(data):
    return BlockFile(Memory(data))


@cache
def scene(seed, voxels=700):
    """Four levels of blocks of 8³ voxels."""
    return random_scene(SIZE, 3, voxels, seed, names=("occupancy", "mask"))


@cache
def stored(seed, voxels=700, rows=40):
    return file_bytes(scene(seed, voxels), paging=Paging(rows))


def whole_tree(file):
    """All pages, in an order other than the file's, and all links."""
    tree = Tree(file)
    tree.rows_of_pages(range(file.pages - 1, -1, -2))
    for page in np.random.default_rng(0).permutation(file.pages):
        tree.add_page(int(page))
    assert tree.link(np.arange(len(tree))) == set()
    return tree


@cache
def tree_of(seed, voxels=700):
    return whole_tree(opened(stored(seed, voxels)))


def ancestors(tree, nodes):
    """All blocks above nodes, each once."""
    found = set()
    for node in nodes:
        while (node := int(tree.parent[node])) >= 0:
            found.add(node)
    return sorted(found)


def boxes_of(tree):
    return Boxes(tree.low, tree.high, tree.edge)


def names(tree, nodes):
    """(level, key) of rows."""
    return {(int(tree.level[n]), int(tree.key[n])) for n in nodes}


def cover(tree, nodes):
    """(n,) by row: how many of the nodes are the block itself or above it."""
    found = np.zeros(len(tree), np.int64)
    found[np.asarray(nodes, np.int64)] += 1
    for level in range(int(tree.level.max()) - 1, -1, -1):
        here = np.flatnonzero(tree.level == level)
        found[here] += found[tree.parent[here]]
    return found
