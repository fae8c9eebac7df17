"""The columns of a finest block's source triangles: arrays <-> stored bytes.

They have as many items as their raw bytes say, not one per voxel; all else is as in columns.py.
Source: spec, section 7.4.
"""

from collections.abc import Mapping
from functools import cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError
from gstream.formats import filters as plain
from gstream.formats.columns import (
    RULE_CONSTANT,
    RULE_RAW_BYTES,
    ColumnRecord,
    ColumnSpec,
    EncodedColumn,
    check_record,
    decode_items,
    encode_column,
    hash64,
    raw_form,
)
from gstream.formats.filters import Filters, Ints
from gstream.formats.framing import CODEC_CONSTANT, MAX_RAW, Buffer

U32 = NDArray[np.uint32]
VERTEX: Final = "vertex"
TRIANGLE: Final = "triangle"
PIECE_IDS: Final = {32: VERTEX, 33: TRIANGLE}
ITEM_BYTES: Final = 12  # three u32
MOST_ITEMS: Final = MAX_RAW // ITEM_BYTES

RULE_NUMBER: Final = "GSB-0413"  # vertex numbers are below the number of vertices

# A raw length is never 0: one byte stands for no items.
NO_ITEMS: Final = EncodedColumn(b"", 1, 0, 0, CODEC_CONSTANT, plain.NONE, hash64())


class Pieces(NamedTuple):
    """Source triangles in a block, cut at its borders."""

    vertices: U32  # (v, 3) snap units from the block's low corner, 0 to 2^(b + k)
    triangles: U32  # (n, 3) rows of `vertices`


NO_PIECES: Final = Pieces(np.empty((0, 3), np.uint32), np.empty((0, 3), np.uint32))


@cache
def piece_specs(vertex_bits: int) -> Mapping[str, ColumnSpec]:
    """Both columns by name; vertex_bits: b + k + 1."""
    candidates = (plain.DELTA_BIT_PLANES, plain.BYTE_PLANES)
    table = (
        ColumnSpec(32, VERTEX, 3, vertex_bits, 4, candidates),
        ColumnSpec(33, TRIANGLE, 3, 32, 4, candidates),
    )
    return {spec.name: spec for spec in table}


def items_of(raw_bytes: int) -> int:
    """Vertices or triangles in a raw column of that length."""
    return raw_bytes // ITEM_BYTES


def encode_pieces(
    pieces: Pieces, vertex_bits: int, lz4: str, *, filters: Filters = plain
) -> dict[str, EncodedColumn]:
    """Encode both columns, each by the smaller of its candidate filters."""
    if not len(pieces.triangles):
        return {VERTEX: NO_ITEMS, TRIANGLE: NO_ITEMS}
    return {
        spec.name: encode_column(spec, raw_form(values), lz4, filters)
        for spec, values in zip(piece_specs(vertex_bits).values(), pieces, strict=True)
    }


def decode_piece_column(
    spec: ColumnSpec, record: ColumnRecord, data: Buffer, *, filters: Filters, path: str, at: int
) -> Ints:
    """(n, 3) u32 items of one column; parameters and errors as columns.decode_column."""
    check_record(spec, record, path, at)
    count, raw = items_of(record.raw_bytes), record.raw_bytes
    if record.codec == CODEC_CONSTANT:
        if raw != NO_ITEMS.raw_bytes:
            said = f"column {spec.name} of no items states {raw} raw bytes"
            raise CorruptFileError(RULE_RAW_BYTES, path, at, said)
        if record.constant or memoryview(data).nbytes:
            said = f"column {spec.name} has no items, and yet a constant or stored bytes"
            raise CorruptFileError(RULE_CONSTANT, path, at, said)
        return np.empty((0, spec.components), spec.dtype)
    if not count or raw != count * ITEM_BYTES:
        said = f"column {spec.name} states {raw} raw bytes, no multiple of {ITEM_BYTES}"
        raise CorruptFileError(RULE_RAW_BYTES, path, at, said)
    return decode_items(spec, record, data, count, filters=filters, path=path, at=at)


def hash_of(values: Ints) -> int:
    """hash64 of a raw column, (n, 3) values."""
    return hash64(np.ascontiguousarray(values.T).tobytes())


def check_numbers(triangles: Ints, vertices: int, path: str, at: int) -> None:
    """errors : CorruptFileError GSB-0413 where a triangle has a vertex that is not there."""
    if len(triangles) and int(triangles.max()) >= vertices:
        said = f"a triangle has vertex {triangles.max()} of {vertices}"
        raise CorruptFileError(RULE_NUMBER, path, at, said)
