"""One column of one block: stored bytes -> values, every length checked first. Spec: section 7."""

from itertools import product
from typing import Any, NamedTuple

import lz4.block
import numpy as np
from numpy.typing import NDArray

from .directory import CONSTANT, RAW
from .errors import CorruptFileError, UnsupportedError
from .head import TRIANGLE, VERTEX, Column, need

Values = NDArray[Any]
NONE, BYTE_PLANES, BIT_PLANES, DELTA, XOR, GREEN_DELTA = range(6)  # filters
SPAN = 1 << 16  # voxels whose bits are in memory, a byte each, at a time
WEIGHTS = (1 << np.arange(8)).astype(np.uint8)[:, None]
DIGITS = np.array([c & 1 | (c & 2) << 7 | (c & 4) << 14 for c in range(8)], np.uint32)


class Record(NamedTuple):
    """A column record; spec, section 5.3."""

    offset: int
    stored: int
    raw: int
    crc: int
    constant: int
    codec: int
    filter: int


def items_of(column: Column, record: Record, voxels: int) -> int:
    """Items of a column: one per voxel; of source triangles and their vertices, what is stored."""
    if column.id not in (VERTEX, TRIANGLE):
        return voxels
    return 0 if record.codec == CONSTANT else record.raw // 12


def filtered_bytes(column: Column, record: Record, count: int, log2: int, where: str) -> int:
    """Length of the column before its codec; 0 for a constant. Nothing is fetched before this.

    count : what items_of gave
    errors : CorruptFileError; UnsupportedError for a kind, codec or filter that is not known
    """
    if not column.item_bytes or record.codec > CONSTANT or record.filter > GREEN_DELTA:
        raise UnsupportedError(f"{where} is of a kind, codec or filter that is not known")
    tree, constant = column.id == 1, record.codec == CONSTANT
    lawful = record.filter == NONE or not (tree or constant)
    lawful &= record.filter != GREEN_DELTA or column.components == 4
    need(lawful and not (tree and constant), "GSB-0404", "has a filter it may not have", where)
    raw = count * column.components * column.item_bytes or constant  # 1 stands for no items
    fits = log2 <= record.raw <= log2 * count if tree else record.raw == raw
    need(fits, "GSB-0402", f"states {record.raw} raw bytes of {count} items", where)
    if constant:
        values = constant_values(column, record, where)
        need(count > 0 or not any(values), "GSB-0403", "has no items and a constant", where)
        return 0
    planes = column.components * column.bits * -(-count // 8)
    length = record.raw if record.filter < BIT_PLANES else planes
    # LZ4 makes at most 255 bytes of one, and stores at most 1 in 255 more than it is given.
    least, most = -(-(length - 64) // 255), length + length // 255 + 16
    if record.codec == RAW:
        least = most = length
    need(least <= record.stored <= most, "GSB-0401", f"{length} of {record.stored} bytes", where)
    return length


def constant_values(column: Column, record: Record, where: str) -> list[int]:
    """The components of a constant."""
    bits, parts = 8 * column.item_bytes, range(column.components)
    values = [record.constant >> bits * i & (1 << bits) - 1 for i in parts]
    fits = record.constant >> bits * len(parts) == 0 and max(values) >> column.bits == 0
    need(fits and record.stored == 0, "GSB-0403", f"constant {record.constant}", where)
    return values


def decode(
    column: Column, record: Record, stored: memoryview, length: int, count: int, log2: int,
    where: str,
) -> Values:  # fmt: skip
    """Values of a column: (count,), or (count, components) when there are several.

    Of occupancy: u32 x | y << 8 | z << 16 within the block.
    stored : bytes whose CRC has been checked
    length : what filtered_bytes gave
    errors : CorruptFileError
    """
    dtype = np.dtype(f"<u{column.item_bytes}")
    if record.codec == CONSTANT:
        one: Values = np.array(constant_values(column, record, where), dtype)
        return np.tile(one, (count, 1)) if column.components > 1 else np.repeat(one, count)
    raw = np.frombuffer(_unpack(stored, length, where) if record.codec else stored, np.uint8)
    if column.id == 1:
        return _octree(raw, count, log2, where)
    values: Values = _unfilter(column, record.filter, raw, count, dtype)
    if record.filter < BIT_PLANES and column.bits < 8 * column.item_bytes:
        need(int(values.max()) >> column.bits == 0, "GSB-0405", f"> {column.bits} bits", where)
    if column.components == 1:
        return values.reshape(count)
    side_by_side = np.empty((count, column.components), dtype)
    for i, component in enumerate(values):  # a fifth of the time that a copy of values.T takes
        side_by_side[:, i] = component
    return side_by_side


def _unpack(stored: memoryview, length: int, where: str) -> bytes:
    try:
        data = lz4.block.decompress(stored, uncompressed_size=length)
    except lz4.block.LZ4BlockError:
        data = b""
    need(len(data) == length, "GSB-0401", f"does not unpack to {length} bytes", where)
    return bytes(data)


def _octree(masks: NDArray[np.uint8], count: int, log2: int, where: str) -> NDArray[np.uint32]:
    """Places of the voxels of an octree in breadth-first order; spec, section 7.3."""
    need(bool(masks.all()), "GSB-0407", "a mask of the octree has no child", where)
    most = (8**log2 - 1) // 7  # nodes of a full tree
    children = int(np.bitwise_count(masks).sum()) if len(masks) <= most else -1
    if children != len(masks) - 1 + count:
        raise CorruptFileError("GSB-0408", f"is not the octree of {count} voxels", where)
    # The set bits in order are the nodes in order, but for the root, and then the voxels.
    parents = np.flatnonzero(np.unpackbits(masks, bitorder="little").view(np.bool_))
    digits = DIGITS.take(parents & 7)
    parents >>= 3
    places = np.zeros(1 + children, np.uint32)
    nodes, end = 0, 1
    for _ in range(log2):
        nodes, end = end, 1 + int(parents.searchsorted(end))
        above = places.take(parents[nodes - 1 : end - 1])
        places[nodes:end] = above * 2 + digits[nodes - 1 : end - 1]
    need(nodes == len(masks), "GSB-0408", f"is not an octree of {log2} levels", where)
    return places[nodes:]


def _unfilter(
    column: Column, filter_: int, raw: NDArray[np.uint8], count: int, dtype: np.dtype[Any]
) -> Values:
    """(components, count) values; spec, section 7.2."""
    if filter_ == NONE:
        return raw.view(dtype).reshape(column.components, count)
    if filter_ == BYTE_PLANES:
        planes = raw.reshape(column.components, column.item_bytes, count)
        return np.ascontiguousarray(planes.swapaxes(1, 2)).view(dtype)[:, :, 0]
    values = _from_bit_planes(column, raw, count, dtype)
    if filter_ in (DELTA, GREEN_DELTA):
        values = (values >> 1) ^ -(values & 1)
        values = np.add.accumulate(values, axis=1, dtype=dtype) & ((1 << column.bits) - 1)
    if filter_ == XOR:
        values = np.bitwise_xor.accumulate(values, axis=1)
    if filter_ == GREEN_DELTA:
        green, red, blue, alpha = values
        values = np.stack([red + green, green, blue + green, alpha])
    return values


def _from_bit_planes(
    column: Column, raw: NDArray[np.uint8], count: int, dtype: np.dtype[Any]
) -> Values:
    """(components, count) values; eight planes at a time, so that most work is on single bytes."""
    planes = raw.reshape(column.components, column.bits, -1)
    values = np.zeros((column.components, count), dtype)
    for first, low in product(range(0, count, SPAN), range(0, column.bits, 8)):
        part, span = planes[:, low : low + 8, first // 8 :], min(SPAN, count - first)
        bits = np.unpackbits(part, axis=2, count=span, bitorder="little")
        bits *= WEIGHTS[: part.shape[1]]
        values[:, first : first + span] |= np.bitwise_or.reduce(bits, axis=1).astype(dtype) << low
    return values


def unit_normals(codes: NDArray[np.uint16], bits: int) -> NDArray[np.float32]:
    """Unit vectors in grid axes of octahedral codes; 0, 0, 0 where a voxel has no direction.

    codes : (n, 2) u16, of `bits` bits each
    returns : (n, 3) float32, within 1e-6 of the exact direction; spec, section 8.3
    """
    h = (1 << bits - 1) - 1
    x, y = codes.T.astype(np.float32) - np.float32(h)
    z = h - np.abs(x) - np.abs(y)
    fold = np.minimum(z, 0)
    vectors = np.stack([x - np.copysign(fold, x), y - np.copysign(fold, y), z], axis=1)
    vectors /= np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]
    vectors[(codes == 2 * h + 1).all(axis=1)] = 0
    return vectors
