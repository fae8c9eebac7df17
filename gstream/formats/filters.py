"""The reversible filters of the block file in plain NumPy: one call, one column of one block.

kernels/filters.py has the same four functions compiled; both give the same bytes. Nothing here
compresses, and lengths were checked before (formats/columns.py). Source: spec, "Filters".
"""

from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

Ints = NDArray[np.unsignedinteger]
Bytes = NDArray[np.uint8]
Codes = NDArray[np.uint32]

NONE: Final = 0
BYTE_PLANES: Final = 1
BIT_PLANES: Final = 2
DELTA_BIT_PLANES: Final = 3
XOR_BIT_PLANES: Final = 4
GREEN_DELTA_BIT_PLANES: Final = 5
FILTERS: Final = range(6)
NO_FILTER: Final = 255  # of a column that is left out where many are undone

PIECE: Final = 1 << 18  # octree nodes that are expanded at once: 16 MB of indices at most

_TRANSPOSE: Final = (
    (np.uint64(7), np.uint64(0x00AA00AA00AA00AA)),
    (np.uint64(14), np.uint64(0x0000CCCC0000CCCC)),
    (np.uint64(28), np.uint64(0x00000000F0F0F0F0)),
)


class Filters(Protocol):
    """What formats/columns.py asks of a set of filters: this module, or kernels/filters.py."""

    def apply_filter(self, filter_id: int, values: Ints, bits: int) -> Bytes:
        """Filter (n, components) values below 2^bits into bytes."""

    def undo_filter(
        self, filter_id: int, data: Bytes, shape: tuple[int, int], dtype: DTypeLike, bits: int
    ) -> Ints:
        """Turn exactly filtered_bytes(...) bytes back into (n, components) values."""

    def encode_occupancy(self, morton: Codes, log2_edge: int) -> Bytes:
        """Turn ascending local codes into octree child masks."""

    def count_leaves(self, masks: Bytes, log2_edge: int) -> int:
        """Count the voxels that octree child masks stand for; 0 if they are no octree."""

    def decode_occupancy(self, masks: Bytes, log2_edge: int, count: int) -> Codes:
        """Turn checked octree child masks back into ascending local codes."""


def filtered_bytes(filter_id: int, count: int, components: int, item_bytes: int, bits: int) -> int:
    """Length of a column of `count` voxels after the filter, before the codec."""
    if filter_id in (NONE, BYTE_PLANES):
        return count * components * item_bytes
    return components * bits * ((count + 7) // 8)


def apply_filter(filter_id: int, values: Ints, bits: int) -> Bytes:
    """Filter one column.

    values : (n, components) u8, u16 or u32, each below 2^bits, n >= 1
    returns: (filtered_bytes,) u8
    errors : ValueError for a filter id that does not exist
    """
    planar = np.ascontiguousarray(values.T)
    if filter_id == NONE:
        return planar.reshape(-1).view(np.uint8)
    if filter_id == BYTE_PLANES:
        count = planar.shape[1]
        return planar.view(np.uint8).reshape(-1, count, planar.itemsize).transpose(0, 2, 1).ravel()
    if filter_id == GREEN_DELTA_BIT_PLANES:
        red, green, blue, alpha = planar
        planar = np.stack((green, red - green, blue - green, alpha))
    elif filter_id not in (BIT_PLANES, DELTA_BIT_PLANES, XOR_BIT_PLANES):
        raise ValueError(f"there is no filter {filter_id}")
    if filter_id in (DELTA_BIT_PLANES, GREEN_DELTA_BIT_PLANES):
        planar = _zigzag_deltas(planar, bits)
    elif filter_id == XOR_BIT_PLANES:
        planar = np.concatenate((planar[:, :1], planar[:, 1:] ^ planar[:, :-1]), axis=1)
    return _to_bit_planes(planar, bits)


def undo_filter(
    filter_id: int, data: Bytes, shape: tuple[int, int], dtype: DTypeLike, bits: int
) -> Ints:
    """Undo apply_filter.

    data   : (filtered_bytes,) u8; bits beyond the last voxel of a plane are not looked at
    shape  : (n, components) of the result; dtype: u8, u16 or u32
    returns: shape, C order
    errors : ValueError for a filter id that does not exist
    """
    count, components = shape
    kind: np.dtype[Any] = np.dtype(dtype)
    if filter_id == NONE:
        return _interleaved(data.view(kind).reshape(components, count))
    if filter_id == BYTE_PLANES:
        return _interleaved(_joined(data.reshape(components, kind.itemsize, count), kind))
    if filter_id not in FILTERS:
        raise ValueError(f"there is no filter {filter_id}")
    planar = _from_bit_planes(data, count, components, kind, bits)
    if filter_id in (DELTA_BIT_PLANES, GREEN_DELTA_BIT_PLANES):
        planar = _sum_zigzag(planar, bits)
    elif filter_id == XOR_BIT_PLANES:
        planar = np.bitwise_xor.accumulate(planar, axis=1)
    if filter_id == GREEN_DELTA_BIT_PLANES:
        green, red, blue, alpha = planar
        planar = np.stack((red + green, green, blue + green, alpha))
    return _interleaved(planar)


def _interleaved(planar: Ints) -> Ints:
    """A fresh (n, components) array; one copy per component is 5 times faster than planar.T."""
    values = np.empty(planar.shape[::-1], planar.dtype)
    for c, component in enumerate(planar):
        values[:, c] = component
    return values


def encode_occupancy(morton: Codes, log2_edge: int) -> Bytes:
    """Child masks of the octree over a block, breadth-first from the root.

    morton : (n,) u32, ascending, below 8^log2_edge, n >= 1
    returns: (nodes,) u8, level by level from coarse to fine, each in Morton order
    """
    levels: list[Bytes] = []
    nodes = morton
    for _ in range(log2_edge):
        bits = np.left_shift(1, nodes & 7).astype(np.uint8)
        parents = nodes >> np.uint32(3)
        first = np.flatnonzero(np.concatenate(([True], parents[1:] != parents[:-1])))
        levels.append(np.bitwise_or.reduceat(bits, first))
        nodes = parents[first]
    return np.concatenate(levels[::-1])


def count_leaves(masks: Bytes, log2_edge: int) -> int:
    """Voxels of the octree; 0 if the masks are not exactly one tree or one of them has no child."""
    children = np.cumsum(np.bitwise_count(masks), dtype=np.int64)
    end = 1
    for _ in range(log2_edge - 1):
        if end > masks.size:
            return 0
        end = 1 + int(children[end - 1])
    if end != masks.size or not masks.all():
        return 0
    return int(children[-1]) + 1 - end


def decode_occupancy(masks: Bytes, log2_edge: int, count: int) -> Codes:
    """Undo encode_occupancy; masks: count_leaves gave count. Returns (count,) u32."""
    codes = np.zeros(1, np.uint32)
    for _ in range(log2_edge):
        level, masks = masks[: codes.size], masks[codes.size :]
        cuts = range(0, codes.size, PIECE)
        pieces = [_children(codes[at : at + PIECE], level[at : at + PIECE]) for at in cuts]
        codes = np.concatenate(pieces) if len(pieces) > 1 else pieces[0]
    return codes


def _children(nodes: Codes, masks: Bytes) -> Codes:
    """Codes of the children that masks name, one mask a node."""
    bits = np.flatnonzero(np.unpackbits(masks, bitorder="little").view(np.bool_)).astype(np.uint32)
    children: Codes = nodes[bits >> 3] << np.uint32(3) | bits & 7
    return children


def _to_bit_planes(planar: Ints, bits: int) -> Bytes:
    components, count = planar.shape
    spread = np.unpackbits(
        planar.view(np.uint8).reshape(components, count, planar.itemsize), axis=2, bitorder="little"
    )
    planes = np.ascontiguousarray(spread[:, :, :bits].transpose(0, 2, 1))
    return np.packbits(planes, axis=2, bitorder="little").reshape(-1)


def _from_bit_planes(
    data: Bytes, count: int, components: int, kind: np.dtype[Any], bits: int
) -> Ints:
    """Transpose 8 x 8 bits in 64-bit words (Warren, Hacker's Delight, section 7-3)."""
    stored = data.reshape(components, bits, -1)
    parts = np.zeros((components, (bits + 7) // 8, stored.shape[2], 8), np.uint8)
    for q in range(parts.shape[1]):
        planes = stored[:, 8 * q : 8 * q + 8]
        parts[:, q, :, : planes.shape[1]] = planes.transpose(0, 2, 1)
    words = parts.view("<u8")
    for shift, swap in _TRANSPOSE:
        swapped = (words ^ (words >> shift)) & swap
        words ^= swapped ^ (swapped << shift)
    return _joined(parts.reshape(components, parts.shape[1], -1)[:, :, :count], kind)


def _joined(parts: Bytes, kind: np.dtype[Any]) -> Ints:
    """(components, n) values of (components, 1 to 4, n) bytes, low bytes first."""
    planar: Ints = parts[:, 0].astype(kind)
    for q in range(1, parts.shape[1]):
        planar |= parts[:, q].astype(kind) << kind.type(8 * q)
    return planar


def _zigzag_deltas(planar: Ints, bits: int) -> Ints:
    """Per component d = v - previous mod 2^bits, then zigzag of d as signed `bits` bits."""
    kind = planar.dtype.type
    low = kind((1 << bits) - 1)
    deltas = planar.copy()
    deltas[:, 1:] -= planar[:, :-1]
    deltas &= low
    negative = deltas >> kind(bits - 1)
    return ((deltas << kind(1)) ^ (kind(0) - negative)) & low


def _sum_zigzag(coded: Ints, bits: int) -> Ints:
    kind = coded.dtype.type
    deltas = (coded >> kind(1)) ^ (~(coded & kind(1)) + kind(1))
    values: Ints = np.cumsum(deltas, axis=1, dtype=coded.dtype)
    values &= kind((1 << bits) - 1)
    return values
