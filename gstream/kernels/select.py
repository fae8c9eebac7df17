"""From the sums of a box to the kept voxels of one block, in one pass over the rows."""

import numpy as np

from gstream.kernels import kernel
from gstream.kernels.accumulate import AREA, CHANNELS, HIT, VECTOR

FACE_BITS = 63


@kernel
def select_kept(rows, codes, sums, flags, colours, normals):
    """Gather the voxels whose target was met; the others are pruned.

    rows, codes : (n,) i4, u4   rows of the sums in Morton order, and their Morton codes
    sums, flags : (v, 4 + c) i8, (v,) u1   as `accumulate` left them
    colours, normals : bool   channels 0 to 3 are colour sums; the last 3 are input normal sums
    returns : codes (m,) u4, area (m,) i8, vector (m, 3) i8, colour (m or 0, 4) i8, mask (m,) u1,
        and the area of all voxels and of the pruned ones
    errors : none
    """
    kept = 0
    for i in range(rows.size):
        kept += (flags[rows[i]] & HIT) != 0
    out_codes = np.empty(kept, np.uint32)
    area = np.empty(kept, np.int64)
    vector = np.empty((kept, 3), np.int64)
    colour = np.empty((kept if colours else 0, 4), np.int64)
    mask = np.empty(kept, np.uint8)
    first = sums.shape[1] - 3 if normals else VECTOR
    total, pruned, at = np.int64(0), np.int64(0), 0
    for i in range(rows.size):
        row = rows[i]
        total += sums[row, AREA]
        if (flags[row] & HIT) == 0:
            pruned += sums[row, AREA]
            continue
        out_codes[at] = codes[i]
        area[at] = sums[row, AREA]
        mask[at] = flags[row] & FACE_BITS
        for c in range(3):
            vector[at, c] = sums[row, first + c]
        if colours:
            for c in range(4):
                colour[at, c] = sums[row, CHANNELS + c]
        at += 1
    return out_codes, area, vector, colour, mask, total, pruned
