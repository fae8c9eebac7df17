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
    n = rows.size  # room for all: counting the kept ones first would gather every flag twice
    out_codes = np.empty(n, np.uint32)
    area = np.empty(n, np.int64)
    vector = np.empty((n, 3), np.int64)
    colour = np.empty((n if colours else 0, 4), np.int64)
    mask = np.empty(n, np.uint8)
    first = np.uint64(sums.shape[1] - 3 if normals else VECTOR)
    total, kept_area, kept = np.int64(0), np.int64(0), np.uint64(0)
    for i in range(np.uint64(n)):
        row = np.uint64(rows[i])
        out_codes[kept] = codes[i]
        area[kept] = sums[row, AREA]
        mask[kept] = flags[row] & FACE_BITS
        for c in range(np.uint64(3)):
            vector[kept, c] = sums[row, first + c]
        if colours:
            for c in range(np.uint64(4)):
                colour[kept, c] = sums[row, np.uint64(CHANNELS) + c]
        # Written first and kept by moving on: which voxels are pruned, no one can predict.
        hit = (flags[row] & HIT) != 0
        total += sums[row, AREA]
        kept_area += sums[row, AREA] if hit else 0
        kept += np.uint64(hit)
    return (
        out_codes[:kept], area[:kept], vector[:kept], colour[:kept], mask[:kept],
        total, total - kept_area,
    )  # fmt: skip
