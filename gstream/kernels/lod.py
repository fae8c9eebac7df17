"""Levels of detail: the voxelizer's sums -> level 0, and children -> parents, by the spec's rule.

The plain twin is gstream/formats/lodrule.py, equal to the bit. `tables` is its COLOUR_TABLES:
linear of code (256,) u16 and code of linear (65536,) u8.
"""

import numpy as np

from gstream.kernels import kernel, part
from gstream.kernels.accumulate import AREA, CHANNELS, VECTOR
from gstream.kernels.octahedral import BATCH, decode_normals, encode_batch, encode_normals

FACE_BITS = np.uint8(63)
MAX_WEIGHT = (1 << 32) - 1
# A quotient total / weight is an integer or, relative to it, at least 1 / total below the next:
# up to here binary64 cannot round it up, and its division is 4 times faster than the integers'.
EXACT_TOTAL = 1 << 51


@part
def rounded_mean(total, weight):
    """total / weight rounded half up; total int64 >= 0, weight int64 >= 1; nothing overflows."""
    quick = total < EXACT_TOTAL
    quotient = np.int64(float(total) / float(weight)) if quick else total // weight
    rest = total - quotient * weight
    return quotient + 1 if rest >= weight - rest else quotient


@part
def colour_code(linear, tables):
    """The sRGB code of a linear value; clamped to 0...65535, so the look-up stays in bounds."""
    return tables[1][min(max(linear, 0), 65_535)]


@kernel
def number_runs(codes, parents):
    """Number the different codes >> 3.

    codes   : (n,) u32 or u64, ascending
    parents : (n,) u32, out   0 for the first run, 1 for the second...
    returns : int   how many there are
    errors  : none
    source  : spec, "Levels of detail"
    """
    if codes.size == 0:
        return 0
    run = parents[0] = 0
    for i in range(1, codes.size):
        run += (codes[i] ^ codes[i - 1]) >= 8
        parents[i] = run
    return run + 1


@kernel
def reduce_runs(codes, mask, normal, colour, weight, normal_bits, use_weight, tables):
    """Merge the voxels of up to eight sibling blocks two by two by two.

    Column by column, without branches on where a run ends: 25 ns a voxel of normals and weights,
    35 run by run, whose lengths no processor predicts.

    codes  : (n,) u32 or u64, ascending; octant of the block << 3 log2_edge | local code
    mask, normal, colour, weight : (n,), (n, 2), (n, 4), (n,); length 0 where absent
    normal_bits, use_weight : int, bool   average by weight (area), or count every child once
    returns: morton (m,), mask (m,), normal (m, 2), colour (m, 4), weight (m,), as the input's
    errors : none; the caller made sure of equal lengths
    source : spec, "Levels of detail"
    """
    parents = np.empty(codes.size, np.uint32)
    runs = number_runs(codes, parents)
    shares = weight if use_weight and weight.size else np.ones(codes.size, np.uint32)
    out_morton = np.empty(runs, codes.dtype)
    out_mask = np.zeros(runs, np.uint8)
    for i in range(codes.size):
        out_morton[parents[i]] = codes[i] >> 3
        out_mask[parents[i]] |= mask[i]
    for m in range(runs):
        out_mask[m] = out_mask[m] if out_mask[m] != 0 else 63
    sums = np.zeros((runs if normal.shape[0] else 0, 3), np.int64)
    sum_directions(decode_normals(normal, normal_bits), shares, parents, sums)
    out_colour = np.empty((runs if colour.shape[0] else 0, 4), np.uint8)
    colour_sums = np.zeros((out_colour.shape[0], 5), np.int64)
    merge_colours(colour, shares, parents, tables, colour_sums, out_colour)
    weight_sums = np.zeros(runs if weight.size else 0, np.int64)
    out_weight = np.empty(weight_sums.size, np.uint32)
    merge_weights(weight, parents, weight_sums, out_weight)
    return out_morton, out_mask, encode_normals(sums, normal_bits), out_colour, out_weight


@part
def sum_directions(directions, shares, parents, sums):
    """Add every direction, times its share, to its parent's sum.

    directions, shares, parents : (n, 3) int32 or none, (n,) u32, (n,) u32
    sums   : (runs, 3) int64, in and out
    errors : none; sums stay below 2^50 for eight children
    source : spec, "Levels of detail"
    """
    for i in range(directions.shape[0]):
        m, share = parents[i], np.int64(shares[i])
        sums[m, 0] += share * directions[i, 0]
        sums[m, 1] += share * directions[i, 1]
        sums[m, 2] += share * directions[i, 2]


@part
def merge_colours(colours, shares, parents, tables, sums, out):
    """Weighted means of colours, in linear light.

    colours, shares, parents : (n, 4) u8 or none, (n,) u32, (n,) u32; tables : see above
    sums   : (runs, 5) int64, zeros   R, G, B, A, shares
    out    : (runs, 4) u8
    errors : none; sums stay below 2^51 for eight children
    source : spec, "Levels of detail"
    """
    for i in range(colours.shape[0]):
        m, share = parents[i], np.int64(shares[i])
        for c in range(3):
            sums[m, c] += share * tables[0][colours[i, c]]
        sums[m, 3] += share * colours[i, 3]
        sums[m, 4] += share
    for m in range(out.shape[0]):
        total = max(sums[m, 4], 1)
        for c in range(3):
            out[m, c] = colour_code(rounded_mean(sums[m, c], total), tables)
        out[m, 3] = rounded_mean(sums[m, 3], total)


@part
def merge_weights(weights, parents, sums, out):
    """(sum + 2) // 4 of each run's u32 weights, from 1 to 2^32 - 1: faces of the parent's level.

    weights, parents : (n,) u32 or none, (n,) u32
    sums, out : (runs,) int64, zeros; (runs,) u32
    errors : none
    source : spec, "Levels of detail"
    """
    for i in range(weights.size):
        sums[parents[i]] += np.int64(weights[i])
    for m in range(out.size):
        out[m] = min(max((sums[m] + 2) // 4, 1), MAX_WEIGHT)


@kernel
def finish_voxels(rows, sums, flags, colours, normals, normal_bits, tables):
    """Columns of level 0 from the voxelizer's sums.

    Batch by batch, so that what is gathered stays in the L1 cache.

    rows : (m,) i4   the voxels' rows of the sums
    sums, flags : (v, 4 + c) i8, (v,) u1   as `accumulate` left them
    colours, normals : bool   channels 0 to 3 are sums of area * linear u16 (R, G, B) and
        area * alpha; the last 3 are input normal sums
    normal_bits, tables : int, 0 without normals; see above
    returns: mask (m,) u8, 0 becomes 63; normal (m, 2) or (0, 2) u16; colour (m, 4) or (0, 4) u8;
        weight (m,) u32
    errors : none
    source : spec, "Levels of detail": one weight unit is 2^-20 voxel faces
    """
    out_mask = np.empty(rows.size, np.uint8)
    out_normal = np.empty(rows.size if normal_bits else 0, np.uint32)
    out_colour = np.empty((rows.size if colours else 0, 4), np.uint8)
    out_weight = np.empty(rows.size, np.uint32)
    first = np.uint64(sums.shape[1] - 3 if normals else VECTOR)
    directions = np.empty((BATCH, 3), np.int64)
    vectors, found = np.empty((3, BATCH)), np.empty((2, BATCH))
    for begin in range(0, rows.size, BATCH):
        batch = rows[begin : begin + BATCH]
        mask, weight = out_mask[begin : begin + BATCH], out_weight[begin : begin + BATCH]
        for i in range(np.uint64(batch.size)):
            row = np.uint64(batch[i])
            for c in range(np.uint64(3)):
                directions[i, c] = sums[row, first + c]
            faces = flags[row] & FACE_BITS
            mask[i] = faces if faces != 0 else FACE_BITS
            weight[i] = min(max((sums[row, AREA] + 32) >> 6, 1), MAX_WEIGHT)
        if normal_bits:
            target = out_normal[begin : begin + BATCH]
            encode_batch(directions[: batch.size], normal_bits, vectors, found, target)
    for i in range(out_colour.shape[0]):
        colour = sums[rows[i], CHANNELS : CHANNELS + 4]
        total = max(sums[rows[i], AREA], 1)
        for c in range(3):
            out_colour[i, c] = colour_code(rounded_mean(colour[c], total), tables)
        out_colour[i, 3] = min(max(rounded_mean(colour[3], total), 0), 255)
    return out_mask, out_normal.view(np.uint16).reshape(-1, 2), out_colour, out_weight
