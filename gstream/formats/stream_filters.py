"""The reversible filters of the geometry stream in plain numpy: the slow twins of the fast kernels.

A filter makes values easier to pack for LZ4 and loses nothing. spec/stream.md, "Filters".
`gstream.kernels.indexing` has the same functions compiled; `Filters` is what both look like.
"""

from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

FILTER_NONE: Final = 0
FILTER_DELTA: Final = 1  # integers: difference, zigzag, byte planes
FILTER_ORDERED_DELTA: Final = 2  # the same on the ordered integers of IEEE floats
FILTER_FIRST_USE: Final = 3  # indices: distance below the high-water mark, byte planes

Bits = NDArray[Any]  # unsigned integers of 1, 2, 4 or 8 bytes
Bytes = NDArray[np.uint8]


class Filters(Protocol):
    """A module that has the filters: this one, or its compiled twin."""

    def delta_planes(self, values: Bits, ordered: bool, planes: Bytes) -> None: ...
    def undo_delta_planes(self, planes: Bytes, ordered: bool, values: Bits) -> None: ...
    def first_use_planes(self, indices: Bits, planes: Bytes) -> None: ...
    def undo_first_use_planes(self, planes: Bytes, vertices: int, indices: Bits) -> int: ...


def delta_planes(values: Bits, ordered: bool, planes: Bytes) -> None:
    """Difference to the row before, zigzag, and one plane per byte.

    values : (n, c) unsigned, 1, 2, 4 or 8 bytes wide; ordered: they are the bits of floats
    planes : (c, width, n) uint8, written; plane 0 holds the low bytes
    """
    width, top = values.itemsize, _top(values)
    codes = _ordered(values) if ordered else values
    step = codes.copy()
    step[1:] -= codes[:-1]
    zigzag = (step << 1) ^ (np.zeros_like(step) - (step >> top))
    for byte in range(width):
        planes[:, byte] = (zigzag >> (8 * byte)).astype(np.uint8).T


def undo_delta_planes(planes: Bytes, ordered: bool, values: Bits) -> None:
    """Inverse of `delta_planes`: planes (c, width, n) uint8 -> values (n, c), written."""
    zigzag = np.zeros_like(values)
    for byte in range(values.itemsize):
        zigzag |= planes[:, byte].T.astype(values.dtype) << (8 * byte)
    step = (zigzag >> 1) ^ (np.zeros_like(zigzag) - (zigzag & 1))
    codes = np.cumsum(step, axis=0, dtype=values.dtype)
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
