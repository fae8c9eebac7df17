"""The occupancy column, compiled: octree child masks <-> local codes, of one block or of many.

The same bytes as gstream/formats/filters.py. Source: spec, "Occupancy".
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel

ZERO, ONE = np.uint64(0), np.uint64(1)

CHILD_COUNT = np.array([m.bit_count() for m in range(256)], np.uint8)
CHILDREN = np.array(
    [([c for c in range(8) if m >> c & 1] + [0] * 8)[:8] for m in range(256)], np.uint32
)


def count_leaves(masks: NDArray[np.uint8], log2_edge: int) -> int:
    """Count the voxels of an octree, 0 if the masks are none; see formats/filters.py."""
    return int(measure_octree(masks, log2_edge))


def encode_occupancy(morton: NDArray[np.uint32], log2_edge: int) -> NDArray[np.uint8]:
    """Turn ascending local codes into octree child masks; see formats/filters.py."""
    nodes = morton.astype(np.uint32)  # a copy: overwritten
    masks = np.zeros(morton.size * log2_edge, np.uint8)
    return masks[fold_octree(nodes, log2_edge, masks) :]


def decode_occupancy(masks: NDArray[np.uint8], log2_edge: int, count: int) -> NDArray[np.uint32]:
    """Turn checked octree child masks back into local codes; see formats/filters.py."""
    nodes = np.empty(masks.size + 8, np.uint32), np.empty(masks.size + 8, np.uint32)
    codes = np.empty(count + 8, np.uint32)
    unfold_octree(masks, log2_edge, nodes, codes)
    return codes[:count]


@kernel
def measure_octree(masks, log2_edge):
    """Walk the levels of octree child masks without writing anything.

    masks  : (m,) u8
    returns: int   leaves, 0 if the masks are not exactly one tree or one of them has no child
    errors : none; never reads outside masks
    source : spec, "Occupancy"
    """
    level = 1
    at = 0
    for _ in range(log2_edge):
        if at + level > masks.size:
            return 0
        children = 0
        for i in range(at, at + level):
            if masks[i] == 0:
                return 0
            children += CHILD_COUNT[masks[i]]
        at += level
        level = children
    return level if at == masks.size else 0


@kernel
def fold_octree(nodes, log2_edge, masks):
    """Write the octree's child masks, from the finest level's last node to the root, back to front.

    nodes  : (n,) u32   ascending local codes; overwritten
    masks  : (n * log2_edge,) u8   zeros; filled at its end
    returns: int   where the masks begin
    errors : none
    source : spec, "Occupancy"
    """
    n = np.uint64(nodes.size)
    begin = ZERO
    at = np.uint64(masks.size)
    for _ in range(log2_edge):
        kept, mask, last = n, ZERO, ~ZERO
        for i in range(n - begin):
            code = np.uint64(nodes[n - ONE - i])
            parent = code >> np.uint64(3)
            # A select, as no one can predict where a parent begins: 57 -> 22 us a block.
            new = parent != last
            mask = (ZERO if new else mask) | ONE << (code & np.uint64(7))
            kept -= np.uint64(new)
            at -= np.uint64(new)
            nodes[kept] = parent
            masks[at] = mask
            last = parent
        begin = kept
    return at


@kernel
def decode_octrees(masks, sizes, counts, log2_edge):
    """Expand the octrees of many blocks, which stand one behind the other, into local codes.

    masks  : (bytes,) u8   child masks
    sizes, counts : (m,) int64   masks and voxels of each block
    returns: (sum of counts,) u32, ascending in each block; (m,) bool   whether the masks are a tree
        of as many voxels; where they are not, its codes are anything
    errors : none; never reads outside a block's masks
    source : spec, "Occupancy"
    """
    total = counts.sum()
    codes = np.empty(total + 8, np.uint32)  # eight children are written where fewer count
    nodes = np.empty(sizes.max() + 8, np.uint32), np.empty(sizes.max() + 8, np.uint32)
    sound = np.empty(counts.size, np.bool_)
    at = row = 0
    for b in range(counts.size):
        tree = masks[at : at + sizes[b]]
        sound[b] = measure_octree(tree, log2_edge) == counts[b]
        if sound[b]:
            unfold_octree(tree, log2_edge, nodes, codes[row:])
        at, row = at + sizes[b], row + counts[b]
    return codes[:total], sound


@kernel
def unfold_octree(masks, log2_edge, nodes, codes):
    """Expand octree child masks into ascending local codes.

    masks  : (m,) u8   checked: a tree, no mask 0
    nodes  : 2 x (m + 8,) u32   scratch
    codes  : (voxels + 8 or more,) u32, out
    errors : none
    source : spec, "Occupancy"
    """
    nodes[0][0] = 0
    level = np.uint64(1)
    at = ZERO
    for depth in range(log2_edge):
        parents = nodes[depth & 1]
        children = codes if depth == log2_edge - 1 else nodes[1 - (depth & 1)]
        end = ZERO  # unsigned, or each index costs a test for negative ones
        for i in range(level):
            mask = masks[at + i]
            base = parents[i] << np.uint32(3)
            row = CHILDREN[mask]
            for j in range(np.uint64(8)):
                children[end + j] = base | row[j]
            end += np.uint64(CHILD_COUNT[mask])
        at += level
        level = end
