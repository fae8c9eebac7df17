"""The columns of one block: arrays <-> stored bytes, each column filtered and compressed alone.

The filters are pluggable: plain NumPy (formats/filters.py) or compiled (kernels/filters.py). Where
the bytes lie in a file, and their CRCs, concern the file formats. Source: spec, "Columns".
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from hashlib import blake2b
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats import filters as plain
from gstream.formats.filters import Bytes, Codes, Filters, Ints
from gstream.formats.framing import (
    CODEC_CONSTANT,
    CODEC_LZ4,
    CODEC_RAW,
    Buffer,
    compress,
    crc32,
    decompress,
)

UNSIGNED: Final = {size: np.dtype(f"<u{size}") for size in (1, 2, 4)}
MIN_LOG2_EDGE: Final = 3
MAX_LOG2_EDGE: Final = 8
MIN_NORMAL_BITS: Final = 8
MAX_NORMAL_BITS: Final = 12

RULE_LENGTH: Final = "GSB-0401"  # the stored bytes unpack to exactly the filtered length
RULE_RAW_BYTES: Final = "GSB-0402"  # raw_bytes is what count, components and item size give
RULE_CONSTANT: Final = "GSB-0403"  # a constant has no stored bytes and fits its components
RULE_FILTER: Final = "GSB-0404"  # the filter is one that the column may have
RULE_RANGE: Final = "GSB-0405"  # every value is below 2^bits
RULE_PADDING: Final = "GSB-0406"  # the bits after the last voxel of a bit plane are zero
RULE_EMPTY_MASK: Final = "GSB-0407"  # every octree child mask has a child
RULE_TREE: Final = "GSB-0408"  # the octree ends with its bytes and has `count` leaves
RULE_COUNT: Final = "GSB-0409"  # a block has 1 to 8^log2_edge voxels


@dataclass(frozen=True, slots=True)
class ColumnSpec:
    """One column of the spec's table; raw form: per component, n little-endian items."""

    id: int
    name: str
    components: int
    bits: int  # significant bits of each component
    item_bytes: int  # bytes of one component in the raw column
    candidates: tuple[int, ...]  # filters that a writer tries; the first wins a tie

    @property
    def field(self) -> str:
        """Its record in a directory entry; an unknown column may have the name of any field."""
        return self.name if self.id in COLUMN_IDS else f"column {self.id}"

    @property
    def dtype(self) -> np.dtype[np.unsignedinteger]:
        """Little-endian unsigned type of one item."""
        return UNSIGNED[self.item_bytes]

    @property
    def packs(self) -> bool:
        """A constant of it fits a directory entry."""
        return self.name != "occupancy" and self.components * self.item_bytes <= 4

    def raw_bytes(self, count: int) -> int:
        """Length of the raw column of `count` voxels; not for occupancy, whose length varies."""
        return count * self.components * self.item_bytes


@cache
def column_specs(normal_bits: int) -> Mapping[str, ColumnSpec]:
    """Every column by name, in canonical order."""
    bytes_, deltas = plain.BYTE_PLANES, plain.DELTA_BIT_PLANES
    table = (
        ColumnSpec(1, "occupancy", 1, 8, 1, (plain.NONE,)),
        ColumnSpec(2, "mask", 1, 6, 1, (plain.XOR_BIT_PLANES, plain.NONE)),
        ColumnSpec(3, "normal", 2, normal_bits, 2, (deltas, bytes_)),
        ColumnSpec(4, "colour", 4, 8, 1, (plain.GREEN_DELTA_BIT_PLANES, bytes_)),
        ColumnSpec(5, "weight", 1, 32, 4, (bytes_, deltas)),
        ColumnSpec(6, "label", 1, 32, 4, (bytes_, deltas)),
        ColumnSpec(7, "spread", 1, 8, 1, (deltas, bytes_)),
    )
    return {spec.name: spec for spec in table}


COLUMN_NAMES: Final = tuple(column_specs(MAX_NORMAL_BITS))
OCCUPANCY: Final = column_specs(MAX_NORMAL_BITS)["occupancy"]
COLUMN_IDS: Final = {spec.id: spec.name for spec in column_specs(MAX_NORMAL_BITS).values()}


@dataclass(slots=True)
class Block:
    """The voxels of one block in ascending local Morton code; a column that is absent is None."""

    morton: Codes  # (n,) u32, local code
    mask: Bytes  # (n,) u8, bits 0-5 = -x +x -y +y -z +z
    normal: NDArray[np.uint16] | None = None  # (n, 2) octahedral codes
    colour: Bytes | None = None  # (n, 4) RGBA, sRGB codes, straight alpha
    weight: Codes | None = None  # (n,) u32, 2^-20 voxel faces of the block's own level
    label: Codes | None = None  # (n,) u32
    spread: Bytes | None = None  # (n,) u8

    @property
    def count(self) -> int:
        """Number of voxels."""
        return int(self.morton.size)

    def names(self) -> tuple[str, ...]:
        """The columns that are there, in canonical order."""
        attributes = (n for n in COLUMN_NAMES[1:] if getattr(self, n) is not None)
        return ("occupancy", *attributes)


@dataclass(frozen=True, slots=True)
class EncodedColumn:
    """One column as it is stored, with what a directory entry says of it."""

    data: bytes  # empty for a constant
    raw_bytes: int  # before filter and codec
    crc: int  # CRC-32 of data, 0 for a constant
    constant: int  # packed value, 0 if not a constant
    codec: int
    filter: int
    hash64: int  # BLAKE2b-64 of the raw column, as a little-endian integer


class ColumnRecord(Protocol):
    """What decode_column must know of a stored column; EncodedColumn is one."""

    @property
    def codec(self) -> int: ...
    @property
    def filter(self) -> int: ...
    @property
    def constant(self) -> int: ...
    @property
    def raw_bytes(self) -> int: ...


class Record(NamedTuple):
    """A ColumnRecord on its own."""

    codec: int
    filter: int
    constant: int
    raw_bytes: int


def encode_block(
    block: Block,
    log2_edge: int,
    names: tuple[str, ...],
    normal_bits: int,
    lz4: str,
    *,
    filters: Filters = plain,
    stored: Collection[str] = frozenset(),
) -> dict[str, EncodedColumn]:
    """Encode the named columns of a block, each by the smaller of its candidate filters.

    names  : columns that the block has; lz4: fast | hc
    stored : names kept raw (codec 0, filter 0) unless constant, without CRC and hash: scratch
    errors : ValueError for a column that the block has not
    """
    specs = column_specs(normal_bits)
    encoded = {}
    for name in names:
        spec = specs[name]
        if name == "occupancy":
            raw = filters.encode_occupancy(block.morton, log2_edge).reshape(1, -1)
        else:
            raw = raw_form(column_values(block, spec))
        encoded[name] = encode_column(spec, raw, lz4, filters, keep_raw=name in stored)
    return encoded


def column_values(block: Block, spec: ColumnSpec) -> Ints:
    """The block's array of one attribute as (n, components) of the column's own dtype."""
    array: Ints | None = getattr(block, spec.name)
    if array is None:
        raise ValueError(f"the block has no column {spec.name}")
    return array.reshape(block.count, spec.components).astype(spec.dtype, copy=False)


def raw_form(values: Ints) -> Ints:
    """(components, n) values of (n,) or (n, components): the raw form, which hash64 covers."""
    return np.ascontiguousarray(values.reshape(values.shape[0], -1).T)


def hash64(*raw: Buffer) -> int:
    """BLAKE2b with an 8-byte digest, read as a little-endian integer; of parts, as if joined."""
    digest = blake2b(digest_size=8)
    for part in raw:
        digest.update(part)
    return int.from_bytes(digest.digest(), "little")


def encode_column(
    spec: ColumnSpec, planar: Ints, lz4: str, filters: Filters, *, keep_raw: bool = False
) -> EncodedColumn:
    """Encode (components, n) values; keep_raw : as `stored` of encode_block."""
    raw = planar.nbytes
    digest = 0 if keep_raw else hash64(planar.reshape(-1).data)
    if spec.packs and _all_equal(planar):
        packed = pack_constant(spec, planar[:, 0])
        return EncodedColumn(b"", raw, 0, packed, CODEC_CONSTANT, plain.NONE, digest)
    if keep_raw:
        return EncodedColumn(planar.tobytes(), raw, 0, 0, CODEC_RAW, plain.NONE, digest)
    best: tuple[bytes, int, int] | None = None
    for filter_id in spec.candidates:
        whole = filters.apply_filter(filter_id, planar.T, spec.bits)
        data, codec = compress(whole.data, lz4), CODEC_LZ4
        if len(data) >= len(whole):
            data, codec = whole.tobytes(), CODEC_RAW
        if best is None or len(data) < len(best[0]):
            best = (data, codec, filter_id)
        # Normals that deltas leave as noise: on two scans and two CAD models byte planes win in 4 %
        # of such blocks, 0.15 % of their bytes, and trying them is 6 % of all CPU.
        if spec.name == "normal" and 2 * len(data) > len(whole):
            break
    if best is None:
        raise ValueError(f"column {spec.name} has no filter to try")
    data, codec, filter_id = best
    return EncodedColumn(data, raw, crc32(data), 0, codec, filter_id, digest)


def _all_equal(planar: Ints) -> bool:
    # Most columns differ at their ends: the whole comparison costs 5 ns a value.
    same_ends = planar[:, 0].tobytes() == planar[:, -1].tobytes()
    return same_ends and bool((planar == planar[:, :1]).all())


def pack_constant(spec: ColumnSpec, value: Ints) -> int:
    """One voxel's components as a u32: component i at bit 16 i (normal) or 8 i."""
    shift = 8 * spec.item_bytes
    return sum(int(v) << (shift * i) for i, v in enumerate(value))


def decode_column(
    spec: ColumnSpec,
    record: ColumnRecord,
    data: Buffer,
    count: int,
    log2_edge: int,
    *,
    filters: Filters = plain,
    path: str,
    at: int,
) -> Ints:
    """Turn stored bytes, whose CRC the caller has checked, back into an array.

    data   : exactly the stored bytes of the column; count: voxels of the block
    at     : byte offset of the data in its file, for the error
    returns: (n,) or (n, components), C order; for occupancy the (n,) u32 local codes
    errors : CorruptFileError GSB-0401 to 0409, UnsupportedError for an unknown codec or filter
    """
    if spec.name == "occupancy":
        masks = octree_masks(record, data, count, log2_edge, filters=filters, path=path, at=at)
        return filters.decode_occupancy(masks, log2_edge, count)
    _check_count(count, log2_edge, path, at)
    check_record(spec, record, path, at)
    if record.raw_bytes != spec.raw_bytes(count):
        raise _raw_bytes_error(spec.name, record, count, path, at)
    if record.codec == CODEC_CONSTANT:
        return squeezed(_constant_column(spec, record, data, count, path, at))
    return squeezed(decode_items(spec, record, data, count, filters=filters, path=path, at=at))


def decode_items(
    spec: ColumnSpec,
    record: ColumnRecord,
    data: Buffer,
    count: int,
    *,
    filters: Filters,
    path: str,
    at: int,
) -> Ints:
    """(count, components) values of a record whose codec, filter and raw length are checked."""
    length = plain.filtered_bytes(record.filter, count, spec.components, spec.item_bytes, spec.bits)
    unpacked = _unpack(record, data, length, path, at)
    if record.filter >= plain.BIT_PLANES:
        _check_padding(unpacked, count, path, at)
    whole = np.frombuffer(unpacked, np.uint8)
    values = filters.undo_filter(
        record.filter, whole, (count, spec.components), spec.dtype, spec.bits
    )
    if record.filter < plain.BIT_PLANES and spec.bits < 8 * spec.item_bytes:
        _check_range(spec, int(values.max()), path, at)
    return values


def octree_masks(
    record: ColumnRecord,
    data: Buffer,
    count: int,
    log2_edge: int,
    *,
    filters: Filters = plain,
    path: str,
    at: int,
) -> Bytes:
    """The raw occupancy column, checked: the octree's child masks.

    parameters and errors : as decode_column
    returns: (nodes,) u8
    """
    _check_count(count, log2_edge, path, at)
    check_record(OCCUPANCY, record, path, at)
    # A node of the octree has a voxel below it, on each of log2_edge levels.
    if not log2_edge <= record.raw_bytes <= log2_edge * count:
        raise _raw_bytes_error(OCCUPANCY.name, record, count, path, at)
    masks = np.frombuffer(_unpack(record, data, record.raw_bytes, path, at), np.uint8)
    if filters.count_leaves(masks, log2_edge) == count:
        return masks
    if not masks.all():
        raise CorruptFileError(RULE_EMPTY_MASK, path, at, "an octree mask has no child")
    said = f"{masks.size} octree masks are not the tree of {count} voxels"
    raise CorruptFileError(RULE_TREE, path, at, said)


def squeezed(values: Ints) -> Ints:
    """(n, 1) values as (n,); others as they are."""
    return values.reshape(-1) if values.shape[1] == 1 else values


def _check_count(count: int, log2_edge: int, path: str, at: int) -> None:
    if not 1 <= count <= 8**log2_edge:
        said = f"{count} voxels do not fit a block of edge {1 << log2_edge}"
        raise CorruptFileError(RULE_COUNT, path, at, said)


def check_record(spec: ColumnSpec, record: ColumnRecord, path: str, at: int) -> None:
    """Refuse a codec or filter that is unknown, or that the column may not have."""
    if record.codec not in (CODEC_RAW, CODEC_LZ4, CODEC_CONSTANT):
        said = f"column {spec.name} has codec {record.codec}, which this release does not know"
        raise UnsupportedError(path, said, "update gstream, or read the other columns")
    if record.filter not in plain.FILTERS:
        said = f"column {spec.name} has filter {record.filter}, which this release does not know"
        raise UnsupportedError(path, said, "update gstream, or read the other columns")
    lawful = record.filter != plain.GREEN_DELTA_BIT_PLANES or spec.components == 4
    if spec.name == "occupancy" or record.codec == CODEC_CONSTANT:
        lawful = record.filter == plain.NONE
    if spec.name == "occupancy" and record.codec == CODEC_CONSTANT:
        lawful = False
    if not lawful:
        said = f"column {spec.name} may not have filter {record.filter} with codec {record.codec}"
        raise CorruptFileError(RULE_FILTER, path, at, said)


def _raw_bytes_error(
    name: str, record: ColumnRecord, count: int, path: str, at: int
) -> CorruptFileError:
    said = f"column {name} of {count} voxels states {record.raw_bytes} raw bytes"
    return CorruptFileError(RULE_RAW_BYTES, path, at, said)


def _unpack(record: ColumnRecord, data: Buffer, length: int, path: str, at: int) -> Buffer:
    if record.codec == CODEC_LZ4:
        return decompress(data, length, RULE_LENGTH, path, at)
    stored = memoryview(data).nbytes
    if stored != length:
        said = f"an uncompressed column has {stored} bytes, not {length}"
        raise CorruptFileError(RULE_LENGTH, path, at, said)
    return data


def _constant_column(
    spec: ColumnSpec, record: ColumnRecord, data: Buffer, count: int, path: str, at: int
) -> Ints:
    if memoryview(data).nbytes:
        said = f"column {spec.name} is constant and yet has stored bytes"
        raise CorruptFileError(RULE_CONSTANT, path, at, said)
    shift = 8 * spec.item_bytes
    fields = [(record.constant >> (shift * i)) & ((1 << shift) - 1) for i in range(spec.components)]
    if max(fields) >> spec.bits or record.constant >> (shift * spec.components):
        said = f"column {spec.name} has the constant {record.constant:#x}, which is out of range"
        raise CorruptFileError(RULE_CONSTANT, path, at, said)
    return np.tile(np.array(fields, spec.dtype), (count, 1))


def _check_padding(whole: Buffer, count: int, path: str, at: int) -> None:
    used = count & 7
    if used and max(memoryview(whole)[count >> 3 :: (count + 7) >> 3]) >> used:
        said = f"the bits after voxel {count - 1} of a bit plane are not zero"
        raise CorruptFileError(RULE_PADDING, path, at, said)


def _check_range(spec: ColumnSpec, largest: int, path: str, at: int) -> None:
    if largest >> spec.bits:
        said = f"column {spec.name} has the value {largest}, above its {spec.bits} bits"
        raise CorruptFileError(RULE_RANGE, path, at, said)
