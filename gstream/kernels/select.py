"""From the sums of a box to the rows of the voxels that are kept, in Morton order."""

import numpy as np

from gstream.kernels import kernel
from gstream.kernels.accumulate import AREA, HIT, TILE_BITS, TILE_VOXELS


@kernel
def collect(tile_slots, tiles, flags, wanted):
    """Voxels of a run of Morton tiles, in Morton order.

    tile_slots, tiles, flags : (t,) i4, (s, 512) i4, (v,) u1   as `accumulate` left them
    wanted : int   bits that the flags of a voxel must have: HIT leaves the pruned ones out
    returns : rows (n,) i4 of the sums, and codes (n,) u4, relative to the first tile
    errors : none
    """
    slots = 0
    for tile in range(tile_slots.size):
        slots += tile_slots[tile] >= 0
    rows = np.empty(slots << TILE_BITS, np.int32)
    codes = np.empty(rows.size, np.uint32)
    places = np.empty(TILE_VOXELS, np.uint16)
    count, bits = np.uint64(0), np.uint8(wanted)
    for tile in range(tile_slots.size):
        if tile_slots[tile] < 0:
            continue
        row_of, first = tiles[tile_slots[tile]], np.uint32(tile << TILE_BITS)
        # Written first and kept by moving on, here and below: which voxels are set, and which of
        # them are pruned, no one can predict.
        found = np.uint64(0)
        for i in range(np.uint64(TILE_VOXELS)):
            places[found] = i
            found += np.uint64(row_of[i] >= 0)
        for i in range(found):
            place = np.uint64(places[i])
            row = row_of[place]
            rows[count], codes[count] = row, first | np.uint32(place)
            count += np.uint64(flags[np.uint64(row)] & bits == bits)
    return rows[:count], codes[:count]


@kernel
def sum_areas(sums, flags):
    """The area of all voxels of a box, and of the pruned ones.

    sums, flags : (v, 4 + c) i8, (v,) u1   as `accumulate` left them
    returns : int, int   unit 2^-26 voxel face
    errors : none
    """
    total, pruned = np.int64(0), np.int64(0)
    for i in range(flags.size):
        total += sums[i, AREA]
        pruned += sums[i, AREA] if flags[i] & HIT == 0 else 0
    return total, pruned
