"""One column of many blocks at once: what of it is sound, decoded by compiled code in one call.

What is not sound is left to formats/columns.py, which decodes a block alone and says what is wrong.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError, GstreamError
from gstream.formats import filters
from gstream.formats.columns import (
    RULE_LENGTH,
    ColumnSpec,
    Record,
    decode_column,
    hash64,
    raw_form,
    squeezed,
)
from gstream.formats.directory import Rows
from gstream.formats.filters import Bytes, Codes, Ints
from gstream.formats.framing import (
    CODEC_CONSTANT,
    CODEC_LZ4,
    CODEC_RAW,
    Buffer,
    crc32,
    decompress,
)

# Voxels that are decoded at once: half as many cost reading a sixth of its speed, twice as many
# gain nothing.
BATCH: Final = 1 << 18
# Voxels of a block, on average, up to which reading gains: 1.5 times as fast at 2,700, but 0.8 at
# 11,000, since a cache holds one block and not a batch.
SMALL: Final = 1 << 13
Flags = NDArray[np.bool_]
Sizes = NDArray[np.int64]


class UndoFilters(Protocol):
    """Undo the filters of many blocks of one column; which are sound. See kernels/filters.py."""

    def __call__(
        self, filters: Bytes, data: Bytes, counts: Sizes, bits: int, values: Ints
    ) -> Flags: ...


class DecodeOctrees(Protocol):
    """Local codes of many blocks; which are sound. See kernels/octree.py."""

    def __call__(
        self, masks: Bytes, sizes: Sizes, counts: Sizes, log2_edge: int
    ) -> tuple[Codes, Flags]: ...


class BatchKernels(NamedTuple):
    """What must be compiled for this; gstream/compiled.py has it."""

    undo_filters: UndoFilters
    decode_octrees: DecodeOctrees


@dataclass(frozen=True, slots=True)
class Batch:
    """One column of some blocks."""

    values: Ints  # (n,) or (n, components), one block after the other; of occupancy, codes
    ends: list[int]  # of each block in `values`
    sound: Flags  # of each block; the values of the others are anything
    filtered: list[Buffer]  # of each block, b"" where it is not sound or a constant
    is_octrees: bool  # occupancy, whose raw column is `filtered`

    def blocks(self) -> Iterator[Ints | None]:
        """The values of each block, None where they are not sound."""
        begin = 0
        for end, sound in zip(self.ends, self.sound.tolist(), strict=True):
            yield self.values[begin:end] if sound else None
            begin = end

    def hashes(self) -> Iterator[int]:
        """hash64 of each block's raw column; all are sound."""
        if self.is_octrees:
            yield from map(hash64, self.filtered)
            return
        components = raw_form(self.values)
        for begin, end in pairwise([0, *self.ends]):
            yield hash64(*(values[begin:end] for values in components))


def decode_batch(
    spec: ColumnSpec, rows: Rows, run: memoryview, begin: int, log2_edge: int, kernels: BatchKernels
) -> Batch:
    """Decode one column of directory entries that have voxels.

    run, begin : bytes of the file in which the payloads lie, and where they begin
    """
    counts, records = rows["count"].astype(np.int64), rows[spec.field]
    lengths = _filtered_bytes(spec, counts, records, log2_edge)
    filtered = [
        _unpacked(run[at : at + stored], crc, codec, length) if length else b""
        for at, stored, crc, codec, length in zip(
            (records["offset"].astype(np.int64) - begin).tolist(),
            records["stored"].tolist(),
            records["crc"].tolist(),
            records["codec"].tolist(),
            lengths.tolist(),
            strict=True,
        )
    ]
    sizes = np.array([len(part) for part in filtered])
    data = np.frombuffer(b"".join(filtered), np.uint8)
    ends = np.cumsum(counts).tolist()
    if spec.name == "occupancy":
        values, sound = kernels.decode_octrees(data, sizes, counts, log2_edge)
        return Batch(values, ends, sound, filtered, True)
    values = np.empty((ends[-1], spec.components), spec.dtype)
    undone = np.where(sizes > 0, records["filter"], filters.NO_FILTER)
    sound = kernels.undo_filters(undone, data, counts, spec.bits, values)
    for row in np.flatnonzero(records["codec"] == CODEC_CONSTANT).tolist():
        _, _, raw, _, constant, codec, filter_id, _ = records[row].item()
        record, count = Record(codec, filter_id, constant, raw), int(counts[row])
        with suppress(GstreamError):
            column = decode_column(spec, record, b"", count, log2_edge, path="", at=0)
            values[ends[row] - count : ends[row]] = column.reshape(count, -1)
            sound[row] = True
    return Batch(squeezed(values), ends, sound, filtered, False)


def _filtered_bytes(spec: ColumnSpec, counts: Sizes, records: Rows, log2_edge: int) -> Sizes:
    """Lengths after the codec; 0 where a record breaks a rule, is unheard of or a constant's."""
    raw, filter_id = records["raw"].astype(np.int64), records["filter"]
    lawful = (records["codec"] == CODEC_RAW) | (records["codec"] == CODEC_LZ4)
    if spec.name == "occupancy":
        lawful &= (filter_id == filters.NONE) & (raw >= log2_edge) & (raw <= log2_edge * counts)
        return np.where(lawful, raw, 0)
    lawful &= raw == counts * spec.components * spec.item_bytes
    # Whole items as they are: no writer of ours has them, and formats/columns.py can.
    lawful &= filter_id >= (filters.NONE if spec.item_bytes == 1 else filters.BYTE_PLANES)
    green = filters.GREEN_DELTA_BIT_PLANES
    lawful &= filter_id <= (green if spec.components == 4 else green - 1)
    planes = spec.components * spec.bits * ((counts + 7) // 8)
    return np.where(lawful, np.where(filter_id < filters.BIT_PLANES, raw, planes), 0)


def _unpacked(stored: memoryview, crc: int, codec: int, length: int) -> Buffer:
    """The filtered column, b"" where it is not `length` bytes or the CRC is wrong."""
    if crc32(stored) != crc:
        return b""
    if codec == CODEC_RAW:
        return stored if len(stored) == length else b""
    try:
        return decompress(stored, length, RULE_LENGTH, "", 0)
    except CorruptFileError:
        return b""


def cut(sizes: NDArray[Any]) -> list[int]:
    """Where runs of up to BATCH voxels begin, of one item at least; last the number of items.

    sizes : (m,) voxels of each item
    """
    ends = np.cumsum(sizes, dtype=np.int64)
    begins = [0]
    while begins[-1] < len(ends):
        before = ends[begins[-1] - 1] if begins[-1] else 0
        end = int(np.searchsorted(ends, before + BATCH, side="right"))
        begins.append(max(end, begins[-1] + 1))
    return begins
