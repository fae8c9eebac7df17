"""Adding fragments up per voxel, in a sparse map of 8^3 tiles in Morton order.

All sums are int64 fixed point, so no order of addition can change a bit. Morton order of the voxels
falls out of scanning the tiles: nothing is sorted.
"""

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import kernel, part

I64 = NDArray[np.int64]
F64 = NDArray[np.float64]

TILE_BITS = 9  # a tile holds 8^3 voxels
TILE_VOXELS = 1 << TILE_BITS
CHUNK = 1024  # fragments looked up at once
AREA, VECTOR, CHANNELS = 0, 1, 4  # columns of the sums: area, area vector (3), channels
HIT_BIT = 6  # of the flags, beside the six face bits
HIT = 1 << HIT_BIT


@part
def fixed(value: float) -> int:
    """In whole units; the accuracy report has a form that leaves fractions as they are."""
    return np.int64(np.rint(value))


@kernel
def accumulate(
    fragments: int,
    keys: NDArray[np.uint32],
    owners: NDArray[np.int32],
    hits: NDArray[np.bool_],
    areas: F64,
    channels: F64,
    normals: F64,
    masks: NDArray[np.uint8],
    tile_slots: NDArray[np.int32],
    tiles: NDArray[np.int32],
    used: I64,
    sums: I64,
    flags: NDArray[np.uint8],
) -> int:
    """Add buffered fragments to the voxels of a box, until done or out of room.

    fragments : int   fragments in the buffer
    keys, owners, hits, areas, channels, normals, masks : as `fragments.emit` wrote them
    tile_slots : (box voxels / 512,) i4   Morton tile -> row of tiles, -1 = none yet
    tiles : (t, 512) i4   Morton voxel in tile -> row of sums, -1 = none yet
    used : (2,) i8   tiles and voxels in use, updated
    sums : (v, 4 + c) i8   area, area vector, channels times area; unit 2^-26 voxel face, of the
        vector 2^-38; zero from row used[1] on
    flags : (v,) u1   face mask bits, and HIT where a target was met; zero from used[1] on
    returns : int   fragments added; fewer than `fragments` where `tiles` is full, or `sums` has not
        CHUNK rows left
    """
    tile_count, voxel_count = used[0], used[1]
    rows = np.empty(CHUNK, np.int32)
    start, full = 0, False
    # In two loops: the first waits for what it looks up; the second has no branch, waits for
    # nothing, and the two together take 0.78 of the time of one.
    while start < fragments and voxel_count + CHUNK <= sums.shape[0] and not full:
        size = min(CHUNK, fragments - start)
        for f in range(size):
            key = np.uint64(keys[np.uint64(start + f)])
            tile, place = key >> np.uint64(TILE_BITS), key & np.uint64(TILE_VOXELS - 1)
            slot = np.int64(tile_slots[tile])
            if slot < 0:
                if tile_count == tiles.shape[0]:
                    size, full = f, True
                    break
                slot = tile_count
                tile_slots[tile] = slot
                for i in range(TILE_VOXELS):
                    tiles[slot, i] = -1
                tile_count += 1
            row = np.int64(tiles[np.uint64(slot), place])
            # Written always: a voxel is new at every third fragment, which no one can predict.
            is_new = row < 0
            row = voxel_count if is_new else row
            tiles[np.uint64(slot), place] = row
            rows[f] = row
            voxel_count += np.int64(is_new)
        for f in range(size):
            # Unsigned: a signed index costs a test for negative ones at each access.
            at, here = np.uint64(rows[f]), np.uint64(start + f)
            t = np.uint64(owners[here])
            # An integer before all else: small triangles have areas from `cover.py` or `clip.py`,
            # which differ by 2^-40 of a face, too little to change it but for bad luck.
            area = np.float64(fixed(max(areas[here], 1.0)))
            # All loads before all stores: so the four become one vector.
            share, x, y, z = normals[t, 0], normals[t, 1], normals[t, 2], normals[t, 3]
            s0, s1, s2, s3 = sums[at, 0], sums[at, 1], sums[at, 2], sums[at, 3]
            s0 += fixed(area * share)
            s1 += fixed(area * x)
            s2 += fixed(area * y)
            s3 += fixed(area * z)
            sums[at, 0], sums[at, 1], sums[at, 2], sums[at, 3] = s0, s1, s2, s3
            for c in range(channels.shape[1]):
                sums[at, CHANNELS + c] += fixed(area * channels[here, c])
            flags[at] |= masks[t] | (np.uint8(hits[here]) << HIT_BIT)
        start += size
    used[0], used[1] = tile_count, voxel_count
    return start
