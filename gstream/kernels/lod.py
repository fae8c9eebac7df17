"""Levels of detail: the voxelizer's sums -> level 0, and children -> parents, by the spec's rule.

The plain twin is gstream/formats/lodrule.py, equal to the bit. `tables` is its COLOUR_TABLES:
linear of code (256,) u16 and code of linear (65536,) u8.
"""

import numpy as np

from gstream.kernels import kernel, part
from gstream.kernels.octahedral import decode_normal, encode_normals

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
def count_runs(codes):
    """Count the different codes >> 3.

    codes  : (n,) u32 or u64, ascending
    returns: int
    errors : none
    source : spec, "Levels of detail"
    """
    if codes.size == 0:
        return 0
    runs = 1
    for i in range(1, codes.size):
        runs += (codes[i] ^ codes[i - 1]) >= 8
    return runs


@kernel
def reduce_runs(codes, mask, normal, colour, weight, normal_bits, use_weight, tables):
    """Merge the voxels of up to eight sibling blocks two by two by two.

    codes  : (n,) u32 or u64, ascending; octant of the block << 3 log2_edge | local code
    mask, normal, colour, weight : (n,), (n, 2), (n, 4), (n,); length 0 where absent
    normal_bits, use_weight : int, bool   average by weight (area), or count every child once
    returns: morton (m,) u32, mask (m,), normal (m, 2), colour (m, 4), weight (m,), as the input's
    errors : none; the caller made sure of equal lengths
    source : spec, "Levels of detail"
    """
    use_weight = use_weight and weight.size > 0
    runs = count_runs(codes)
    out_morton = np.empty(runs, np.uint32)
    out_mask = np.empty(runs, np.uint8)
    directions = np.empty((runs if normal.shape[0] else 0, 3), np.int64)
    out_colour = np.empty((runs if colour.shape[0] else 0, 4), np.uint8)
    out_weight = np.empty(runs if weight.size else 0, np.uint32)
    begin = 0
    for m in range(runs):
        end = begin + 1
        while end < codes.size and (codes[end] ^ codes[begin]) < 8:
            end += 1
        out_morton[m] = codes[begin] >> 3
        merged = np.uint8(0)
        for i in range(begin, end):
            merged |= mask[i]
        out_mask[m] = merged if merged != 0 else 63
        # Ranges, not slices: a slice costs two atomic reference counts.
        run = (begin, end)
        if normal.shape[0]:
            sum_normals(normal, weight, run, use_weight, normal_bits, directions, m)
        if colour.shape[0]:
            merge_colours(colour, weight, run, use_weight, tables, out_colour, m)
        if weight.size:
            out_weight[m] = merge_weights(weight, run)
        begin = end
    out_normal = encode_normals(directions, normal_bits)
    return out_morton, out_mask, out_normal, out_colour, out_weight


@part
def sum_normals(codes, weights, run, use_weight, bits, out, m):
    """Weighted sum of a few directions.

    codes  : (n, 2) u16; weights : (n,) u32, or (0,) where use_weight is False; bits : int
    run    : first and one past the last voxel
    out    : (runs, 3) int64, row m is written
    errors : none; sums stay below 2^50 for eight children
    source : spec, "Levels of detail"
    """
    x = y = z = np.int64(0)
    for i in range(run[0], run[1]):
        share = np.int64(weights[i]) if use_weight else np.int64(1)
        a, b, c = decode_normal(np.int64(codes[i, 0]), np.int64(codes[i, 1]), bits)
        x += share * a
        y += share * b
        z += share * c
    out[m, 0], out[m, 1], out[m, 2] = x, y, z


@part
def merge_colours(colours, weights, run, use_weight, tables, out, m):
    """Weighted mean of a few colours, in linear light.

    colours : (n, 4) u8; weights, run, use_weight : as above; tables : see above
    out    : (runs, 4) u8, row m is written
    errors : none; sums stay below 2^51 for eight children
    source : spec, "Levels of detail"
    """
    total = red = green = blue = alpha = np.int64(0)
    for i in range(run[0], run[1]):
        share = np.int64(weights[i]) if use_weight else np.int64(1)
        total += share
        red += share * tables[0][colours[i, 0]]
        green += share * tables[0][colours[i, 1]]
        blue += share * tables[0][colours[i, 2]]
        alpha += share * colours[i, 3]
    total = max(total, 1)
    out[m, 0] = colour_code(rounded_mean(red, total), tables)
    out[m, 1] = colour_code(rounded_mean(green, total), tables)
    out[m, 2] = colour_code(rounded_mean(blue, total), tables)
    out[m, 3] = rounded_mean(alpha, total)


@part
def merge_weights(weights, run):
    """(sum + 2) // 4 of the run's u32 weights, from 1 to 2^32 - 1: faces of the parent's level."""
    total = np.int64(0)
    for i in range(run[0], run[1]):
        total += np.int64(weights[i])
    return min(max((total + 2) // 4, 1), MAX_WEIGHT)


@kernel
def finish_voxels(area, area_vector, colour_sum, mask, normal_bits, tables):
    """Columns of level 0 from the voxelizer's sums.

    area, area_vector : (m,) int64 in 2^-26 voxel faces, (m, 3) int64
    colour_sum : (m, 4) int64   sums of area * linear u16 (R, G, B) and area * alpha; or (0, 4)
    mask, normal_bits, tables : (m,) u8, int, see above
    returns: mask (m,) u8, 0 becomes 63; normal (m, 2) u16; colour (m, 4) or (0, 4) u8; weight u32
    errors : none
    source : spec, "Levels of detail": one weight unit is 2^-20 voxel faces
    """
    m = area.size
    out_mask = np.empty(m, np.uint8)
    out_normal = encode_normals(area_vector, normal_bits)
    out_colour = np.empty((colour_sum.shape[0], 4), np.uint8)
    out_weight = np.empty(m, np.uint32)
    for i in range(m):
        out_mask[i] = mask[i] if mask[i] != 0 else 63
        out_weight[i] = min(max((area[i] + 32) >> 6, 1), MAX_WEIGHT)
    for i in range(colour_sum.shape[0]):
        total = max(area[i], 1)
        for c in range(3):
            out_colour[i, c] = colour_code(rounded_mean(colour_sum[i, c], total), tables)
        out_colour[i, 3] = min(max(rounded_mean(colour_sum[i, 3], total), 0), 255)
    return out_mask, out_normal, out_colour, out_weight
