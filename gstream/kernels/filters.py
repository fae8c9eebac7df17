"""The column filters of the block file, compiled: the same bytes as gstream/formats/filters.py.

The public functions are thin: lengths were checked by formats/columns.py, so the loops stay within
their arrays. Source: spec, "Filters"; the 8 x 8 transpose is Warren, Hacker's Delight, section 7-3.
"""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from gstream.kernels import kernel, part
from gstream.kernels.octree import (
    count_leaves,
    decode_occupancy,
    decode_octrees,
    encode_occupancy,
)

__all__ = ["apply_filter", "count_leaves", "decode_occupancy", "encode_occupancy", "undo_filter"]

NONE = 0
BYTE_PLANES = 1
BIT_PLANES = 2
DELTA_BIT_PLANES = 3
XOR_BIT_PLANES = 4
GREEN_DELTA_BIT_PLANES = 5
FILTERS = range(6)
NO_FILTER = 255

PLAIN, DELTA, XOR = 0, 1, 2
STEPS = np.array([PLAIN, PLAIN, PLAIN, DELTA, XOR, DELTA])  # of each filter

ZERO, ONE, BYTE = np.uint64(0), np.uint64(1), np.uint64(255)
U0, U1, U8, U16, U24 = (np.uint32(i) for i in (0, 1, 8, 16, 24))
SHIFT_7, SHIFT_14, SHIFT_28 = np.uint64(7), np.uint64(14), np.uint64(28)
SWAP_1 = np.uint64(0x00AA00AA00AA00AA)
SWAP_2 = np.uint64(0x0000CCCC0000CCCC)
SWAP_4 = np.uint64(0x00000000F0F0F0F0)


def apply_filter(filter_id: int, values: NDArray[Any], bits: int) -> NDArray[np.uint8]:
    """Filter one column; see formats/filters.py."""
    if filter_id not in FILTERS:
        raise ValueError(f"there is no filter {filter_id}")
    planar = np.ascontiguousarray(values.T)
    components, count = planar.shape
    if filter_id == NONE or (filter_id == BYTE_PLANES and planar.itemsize == 1):
        return planar.reshape(-1).view(np.uint8)
    if filter_id == BYTE_PLANES:
        parts = np.empty((components, planar.itemsize, count), np.uint8)
        split_bytes(planar, parts)
        return parts.reshape(-1)
    if filter_id == GREEN_DELTA_BIT_PLANES:
        planar = subtract_green(planar)
    planes = np.empty((components, bits, (count + 7) // 8), np.uint8)
    split_planes(planar, STEPS[filter_id], planes)
    return planes.reshape(-1)


def undo_filter(
    filter_id: int, data: NDArray[np.uint8], shape: tuple[int, int], dtype: DTypeLike, bits: int
) -> NDArray[Any]:
    """Undo apply_filter; see formats/filters.py."""
    if filter_id not in FILTERS:
        raise ValueError(f"there is no filter {filter_id}")
    count, components = shape
    values = np.empty(shape, dtype)
    if filter_id == NONE:
        for c, component in enumerate(data.view(dtype).reshape(components, count)):
            values[:, c] = component
    else:
        undo_filters(np.array([filter_id], np.uint8), data, np.array([count]), bits, values)
    return values


def warm() -> None:
    """Compile every kernel of this file for the types that columns have."""
    for dtype, components, bits in ((np.uint8, 4, 8), (np.uint16, 2, 11), (np.uint32, 1, 32)):
        values = np.ones((3, components), dtype)
        for filter_id in FILTERS[: 6 if components == 4 else 5]:
            data = np.frombuffer(apply_filter(filter_id, values, bits).tobytes(), np.uint8)
            undo_filter(filter_id, data, values.shape, dtype, bits)
    masks = encode_occupancy(np.zeros(1, np.uint32), 3)
    masks = np.frombuffer(masks.tobytes(), np.uint8)
    decode_occupancy(masks, 3, count_leaves(masks, 3))
    decode_octrees(masks, np.array([masks.size]), np.array([1]), 3)


@part
def transpose_8x8(word):
    """Transpose a matrix of 8 x 8 bits: bit c of byte r goes to bit r of byte c.

    word   : uint64
    returns: uint64
    errors : none
    source : Warren, Hacker's Delight, section 7-3
    """
    swapped = (word ^ (word >> SHIFT_7)) & SWAP_1
    word ^= swapped ^ (swapped << SHIFT_7)
    swapped = (word ^ (word >> SHIFT_14)) & SWAP_2
    word ^= swapped ^ (swapped << SHIFT_14)
    swapped = (word ^ (word >> SHIFT_28)) & SWAP_4
    return word ^ (swapped ^ (swapped << SHIFT_28))


@kernel
def undo_filters(filters, data, counts, bits, values):
    """Undo the filters of one column of many blocks, which stand one behind the other.

    filters, counts : (m,) u8, (m,) int64   of each block; filter 0 only where items are bytes
    data   : (bytes,) u8   exactly filtered_bytes of each block, none where the filter is NO_FILTER
    bits   : int
    values : (sum of counts, components) u8, u16 or u32, out
    returns: (m,) bool   whether a block's padding is zero and its values are below 2^bits; where
        not, or left out, they are anything
    errors : none; the lengths were checked
    source : spec, "Filters"
    """
    components, item = values.shape[1], values.itemsize
    widest, parts = (counts.max() + 7) >> 3, (bits + 7) >> 3
    words, coded = np.empty(parts * widest, np.uint64), np.empty(8 * widest, values.dtype)
    sound = np.empty(filters.size, np.bool_)
    at = row = 0
    for b in range(filters.size):
        count, m = counts[b], (counts[b] + 7) >> 3
        here = values[row : row + count]
        end = at
        sound[b] = False
        if filters[b] <= BYTE_PLANES:
            end = at + count * components * item
            join_bytes(data[at:end].reshape(components, item, count), here)
            sound[b] = are_below(here, bits)
        elif filters[b] != NO_FILTER:
            end = at + components * bits * m
            planes = data[at:end].reshape(components, bits, m)
            room = words[: parts * m].reshape(parts, m)
            join_planes(planes, STEPS[filters[b]], room, coded[: 8 * m], here)
            sound[b] = is_padded(planes, count)
            if filters[b] == GREEN_DELTA_BIT_PLANES:
                add_green(here)
        at, row = end, row + count
    return sound


@part
def are_below(values, bits):
    """Whether all values, (n, components) u8, u16 or u32, are below 2^bits."""
    every = ZERO
    for i in range(values.shape[0]):
        for c in range(values.shape[1]):
            every |= np.uint64(values[i, c])
    return every >> np.uint64(bits) == ZERO


@part
def is_padded(planes, count):
    """Whether the bits behind the last of `count` values are zero; planes as join_planes has."""
    every = U0
    if count & 7:
        for c in range(planes.shape[0]):
            for p in range(planes.shape[1]):
                every |= np.uint32(planes[c, p, planes.shape[2] - 1])
    return every >> np.uint32(count & 7) == U0


@part
def join_planes(planes, step, words, coded, values):
    """Turn bit planes back into values, one component after the other.

    planes : (components, bits, m = ceil(n / 8)) u8; step : int   PLAIN | DELTA | XOR
    words, coded : (ceil(bits / 8), m) u64, (8 m,) of the type of values   scratch
    values : (n, components) u8, u16 or u32, out
    errors : none; the length of the planes was checked
    source : spec, "Filters"
    """
    components, bits, m = planes.shape
    parts = words.view(np.uint8)  # little-endian: byte j of a word is voxel j
    for c in range(components):
        words[:] = ZERO
        # One plane after the other, so that the loops over m vectorise: 0.3 ns a value, against
        # 1.5 for gathering a word from eight planes at once.
        for p in range(bits):
            shift = np.uint64(8 * (p & 7))
            plane, row = planes[c, p], words[p >> 3]
            for g in range(m):
                row[g] |= np.uint64(plane[g]) << shift
        for q in range(words.shape[0]):
            row = words[q]
            for g in range(m):
                row[g] = transpose_8x8(row[g])
        join_parts(parts, coded)
        undo_steps(coded, step, bits, values[:, c])


@kernel
def split_planes(values, step, planes):
    """Undo join_planes.

    values : (components, n >= 1) u8, u16 or u32; step : int   PLAIN | DELTA | XOR
    planes : (components, bits, ceil(n / 8)) u8, out
    errors : none
    source : spec, "Filters"
    """
    components, bits, m = planes.shape
    coded = np.zeros(8 * m, values.dtype)
    words = np.empty(m, np.uint64)
    for c in range(components):
        code_steps(values[c], step, bits, coded)
        for q in range((bits + 7) >> 3):
            copy_bytes(coded, q, words.view(np.uint8))
            for g in range(m):
                words[g] = transpose_8x8(words[g])
            for p in range(8 * q, min(8 * q + 8, bits)):
                shift = np.uint64(8 * (p & 7))
                plane = planes[c, p]
                for g in range(m):
                    plane[g] = (words[g] >> shift) & BYTE


@part
def code_steps(values, step, bits, coded):
    """Code each value of one component against the one before.

    values, step, bits : (n,) unsigned, int   PLAIN | DELTA | XOR, int
    coded  : (m >= n,) of the same type, out; left alone from n on
    errors : none
    source : spec, "Filters": zigzag of the difference modulo 2^bits, or exclusive or
    """
    n = np.uint64(values.size)
    coded[ZERO] = values[ZERO]
    # Loops that carry nothing from value to value and branch outside vectorise.
    if step == XOR:
        for i in range(ONE, n):
            coded[i] = values[i] ^ values[i - ONE]
    elif step == DELTA:
        low = np.uint32((ONE << np.uint64(bits)) - ONE)
        sign = np.uint32(ONE << np.uint64(bits - 1))
        for i in range(ONE, n):
            coded[i] = values[i] - values[i - ONE]
        for i in range(n):
            delta = np.uint32(coded[i]) & low
            coded[i] = ((delta << U1) ^ (low if delta & sign else U0)) & low
    else:
        for i in range(n):
            coded[i] = values[i]


@part
def copy_bytes(values, q, part):
    """Byte q, 0 to 3, of each value; values (n,) u8, u16 or u32, part (n,) u8 out."""
    n = np.uint64(values.size)
    # A shift known to the compiler keeps the values narrow, and the loop vectorises.
    if q == 0:
        for i in range(n):
            part[i] = values[i] & BYTE
    elif q == 1:
        for i in range(n):
            part[i] = (values[i] >> U8) & BYTE
    elif q == 2:
        for i in range(n):
            part[i] = (values[i] >> U16) & BYTE
    else:
        for i in range(n):
            part[i] = (values[i] >> U24) & BYTE


@part
def undo_steps(coded, step, bits, values):
    """Undo code_steps; coded (m >= n,) overwritten, values (n,) out."""
    n = np.uint64(values.size)
    if step == DELTA:
        low = np.uint32((ONE << np.uint64(bits)) - ONE)
        # The loop that carries something has nothing else to do: the first one vectorises.
        for i in range(n):
            code = np.uint32(coded[i])
            coded[i] = (code >> U1) ^ (U0 - (code & U1))
        last = U0
        for i in range(n):
            last += np.uint32(coded[i])
            values[i] = last & low
    elif step == XOR:
        last = U0
        for i in range(n):
            last ^= np.uint32(coded[i])
            values[i] = last
    else:
        for i in range(n):
            values[i] = coded[i]


@part
def join_parts(parts, values):
    """Join the bytes of values; parts (1, 2 or 4, m >= n) u8, low bytes first, values (n,) out."""
    n = np.uint64(values.size)
    # Branches outside, so that each loop vectorises.
    if parts.shape[0] == 1:
        for i in range(n):
            values[i] = parts[0, i]
    elif parts.shape[0] == 2:
        for i in range(n):
            values[i] = np.uint32(parts[0, i]) | np.uint32(parts[1, i]) << U8
    else:
        for i in range(n):
            low = np.uint32(parts[0, i]) | np.uint32(parts[1, i]) << U8
            values[i] = low | np.uint32(parts[2, i]) << U16 | np.uint32(parts[3, i]) << U24


@part
def join_bytes(parts, values):
    """Turn byte planes, low bytes first, into values.

    parts  : (components, 1, 2 or 4, n) u8
    values : (n, components) u8, u16 or u32, out
    errors : none
    source : spec, "Byte planes"
    """
    for c in range(values.shape[1]):
        join_parts(parts[c], values[:, c])


@kernel
def split_bytes(values, parts):
    """Undo join_bytes.

    values : (components, n) u8, u16 or u32
    parts  : (components, 1, 2 or 4, n) u8, out
    errors : none
    source : spec, "Byte planes"
    """
    for c in range(parts.shape[0]):
        for q in range(parts.shape[1]):
            copy_bytes(values[c], q, parts[c, q])


@kernel
def subtract_green(values):
    """Turn R, G, B, A into G, R - G, B - G, A modulo 256.

    values : (4, n) u8
    returns: (4, n) u8
    errors : none
    source : spec, "Green delta bit planes"
    """
    coded = np.empty_like(values)
    for i in range(values.shape[1]):
        green = values[1, i]
        coded[0, i] = green
        coded[1, i] = values[0, i] - green
        coded[2, i] = values[2, i] - green
        coded[3, i] = values[3, i]
    return coded


@part
def add_green(values):
    """Undo subtract_green.

    values : (n, 4) u8, in place
    errors : none
    source : spec, "Green delta bit planes"
    """
    for i in range(values.shape[0]):
        green = values[i, 0]
        values[i, 0] = values[i, 1] + green
        values[i, 1] = green
        values[i, 2] += green
