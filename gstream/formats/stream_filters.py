"""The reversible filters of the geometry stream in plain numpy: the slow twins of the fast kernels.

A filter makes values easier to pack for LZ4 and loses nothing. spec/stream.md, "Filters".
`gstream.kernels.indexing` has the same functions compiled; `Filters` is what both look like.
"""

from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from gstream.formats.stream_edges import edge_codes as edge_codes
from gstream.formats.stream_edges import undo_edge_codes as undo_edge_codes

FILTER_NONE: Final = 0
FILTER_DELTA: Final = 1  # integers: difference to the value before, zigzag, byte planes
FILTER_ORDERED_DELTA: Final = 2  # the same on the ordered integers of IEEE floats
FILTER_FIRST_USE: Final = 3  # indices: distance below the high-water mark, byte planes
FILTER_CORNER_DELTA: Final = 4  # as 1, the difference being to another corner of the triangle
FILTER_ORDERED_CORNER_DELTA: Final = 5  # as 2, likewise

FILTER_EDGES: Final = 6  # indices: an edge shared with one of the last triangles

Bits = NDArray[Any]  # unsigned integers of 1, 2, 4 or 8 bytes
Bytes = NDArray[np.uint8]
Bases = NDArray[np.int32]


class Filters(Protocol):
    """A module that has the filters: this one, or its compiled twin."""

    def corner_bases(self, triangles: Bits, bases: Bases) -> None: ...
    def delta_planes(self, values: Bits, bases: Bases, ordered: bool, planes: Bytes) -> None: ...
    def undo_delta_planes(
        self, planes: Bytes, bases: Bases, ordered: bool, values: Bits
    ) -> None: ...
    def first_use_planes(self, indices: Bits, planes: Bytes) -> None: ...
    def undo_first_use_planes(self, planes: Bytes, vertices: int, indices: Bits) -> int: ...
    def edge_codes(self, triangles: Bits, codes: Bytes, extra: Bits) -> int: ...
    def undo_edge_codes(self, codes: Bytes, extra: Bits, vertices: int, indices: Bits) -> int: ...


def rows_before(count: int) -> Bases:
    """The plain bases: each row's difference is to the row before, the first one's to zero."""
    return np.arange(-1, count - 1, dtype=np.int32)


def corner_bases(triangles: Bits, bases: Bases) -> None:
    """Choose for each vertex one that comes before it and, if possible, shares a triangle with it.

    triangles : (t, 3) uint16
    bases : (v,) int32, written: of the two other corners of the triangle that uses the vertex
    first, the highest one below the vertex; without one, the vertex before; -1 for vertex 0
    """
    corners = triangles.astype(np.int32)
    others = np.stack([np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1)])
    best = np.where(others < corners, others, -1).max(axis=0).ravel()
    bases[:] = -2
    bases[corners.ravel()[::-1]] = best[::-1]  # of several assignments the last one stays
    alone = bases < 0
    bases[alone] = rows_before(len(bases))[alone]


def delta_planes(values: Bits, bases: Bases, ordered: bool, planes: Bytes) -> None:
    """Difference to the base's value, zigzag, and one plane per byte.

    values : (n, c) unsigned, 1, 2, 4 or 8 bytes wide; ordered: they are the bits of floats
    bases : (n,) int32, an earlier row for each row; -1: the difference is to zero
    planes : (c, width, n) uint8, written; plane 0 holds the low bytes
    """
    width, top = values.itemsize, _top(values)
    codes = _ordered(values) if ordered else values
    step = codes - np.where(bases[:, None] >= 0, codes[bases], np.zeros_like(codes))
    zigzag = (step << 1) ^ (np.zeros_like(step) - (step >> top))
    for byte in range(width):
        planes[:, byte] = (zigzag >> (8 * byte)).astype(np.uint8).T


def undo_delta_planes(planes: Bytes, bases: Bases, ordered: bool, values: Bits) -> None:
    """Inverse of `delta_planes`: planes (c, width, n) uint8 -> values (n, c), written.

    source : pointer jumping, Wyllie 1979: each round halves the way of every row to its root
    """
    zigzag = np.zeros_like(values)
    for byte in range(values.itemsize):
        zigzag |= planes[:, byte].T.astype(values.dtype) << (8 * byte)
    step = (zigzag >> 1) ^ (np.zeros_like(zigzag) - (zigzag & 1))
    if (bases == rows_before(len(bases))).all():
        codes = np.cumsum(step, axis=0, dtype=values.dtype)
    else:
        codes = np.concatenate([np.zeros_like(step[:1]), step]).T.copy()
        up = np.concatenate([[0], bases + 1])
        while up.any():
            codes += np.take(codes, up, axis=1)
            up = up[up]
        codes = codes[:, 1:].T
    values[:] = _unordered(codes) if ordered else codes


def first_use_planes(indices: Bits, planes: Bytes) -> None:
    """Code each index as its distance below the high-water mark; 0 is the next new vertex.

    indices : (m,) uint16, numbered in order of first use
    planes : (2, m) uint8, written: low bytes, high bytes
    """
    new = np.empty(len(indices), np.bool_)
    highest = np.maximum.accumulate(indices.astype(np.int64))
    new[:1] = True
    new[1:] = highest[1:] > highest[:-1]
    mark: NDArray[np.int64] = np.cumsum(new) - new
    codes = ((mark - indices) & 0xFFFF).astype(np.uint16)
    planes[0] = codes & 0xFF
    planes[1] = codes >> 8


def undo_first_use_planes(planes: Bytes, vertices: int, indices: Bits) -> int:
    """Inverse of `first_use_planes`: planes (2, m) uint8 -> indices (m,) uint16, written.

    returns: the number of vertices used; any other than `vertices`, or -1, means a broken part
    """
    codes = planes[0].astype(np.int64) | planes[1].astype(np.int64) << 8
    new = codes == 0
    seen = np.cumsum(new)
    new &= seen <= vertices
    found: NDArray[np.int64] = np.minimum(seen, vertices) - new - codes
    found[found == 65_536] = 0  # 65 536 below a full mark is written as 0 too
    if len(found) and not 0 <= found.min() <= found.max() < vertices:
        return -1
    indices[:] = found
    return int(min(seen[-1], vertices)) if len(found) else 0


def _top(values: Bits) -> int:
    return 8 * values.itemsize - 1


def _ordered(bits: Bits) -> Bits:
    """Bits of IEEE floats -> unsigned integers in the order of the numbers, -0.0 below +0.0."""
    sign = np.array(1 << _top(bits), bits.dtype)
    return np.where(bits & sign != 0, ~bits, bits | sign)


def _unordered(codes: Bits) -> Bits:
    sign = np.array(1 << _top(codes), codes.dtype)
    return np.where(codes & sign != 0, codes ^ sign, ~codes)
