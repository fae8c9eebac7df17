"""The head (at most 64 KiB) and the tail (64 bytes) of a block file: fields <-> bytes.

Here: packing, parsing, and every check that needs the head alone. Not here: the directory's pages,
payloads, files. Layout: spec/blockfile.md, sections 3, 4 and 9.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from struct import Struct
from typing import Any, Final, NoReturn

import numpy as np

from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats.blockmeta import meta_bytes, parse_metadata
from gstream.formats.columns import ColumnSpec, column_specs
from gstream.formats.directory import (
    COLUMN_DTYPE,
    LEVEL_DTYPE,
    MAX_COLUMNS,
    MAX_HEAD_BYTES,
    PAGE_DTYPE,
    RECORD_BYTES,
    TAIL_BYTES,
    Rows,
    check_page_table,
    pack_columns,
    unpack_columns,
)
from gstream.formats.framing import BLOCK_MAGIC, crc32
from gstream.formats.pieces import piece_specs
from gstream.grid import MAX_RESOLUTION

TAIL_MAGIC: Final = b"\x89GSBTAIL\r\n\x1a\n"
VERSION: Final = 1
MAX_LEVELS: Final = 17
MAX_BLOCKS: Final = 1 << 24
MAX_SECTIONS: Final = 16
PAGE_CAPACITY: Final = 1400  # page records in the head; above, the head lists table pages
FIRST_SECTION: Final = 256  # the section table
CRC_BYTES: Final = 4
SETTINGS: Final = slice(56, 216)  # what the content id covers of the fixed fields
HEAD_SECTIONS: Final = (b"LEVL", b"COLM", b"PAGE", b"META")
CRITICAL: Final = 1

SEPARABILITY: Final = {"conservative": 1, "6": 6, "26": 26}
TIES: Final = {"one-sided": 0, "closed": 1}
FACES: Final = {"front": 0, "both": 1}
NORMALS: Final = {"geometric": 0, "input": 1}
WEIGHTING: Final = {"count": 0, "area": 1}

_IDENTITY: Final = Struct("<12sHHIIIIQ16s")  # bytes 0 to 55
_SETTINGS: Final = Struct("<I9B3x12d6d")  # bytes 56 to 215
_COUNTS: Final = Struct("<QQIBBBx16x")  # bytes 216 to 255
_SECTION: Final = Struct("<4sIQQI4x")
_TAIL: Final = Struct("<12sQ16sI20xI")


@dataclass(frozen=True, slots=True)
class BlockFileHeader:
    """The settings of a block file; equal settings and equal content give an equal content id."""

    resolution: int  # N, voxels per axis at level 0
    snap_bits: int  # vertices were snapped to voxel / 2^k
    levels: int
    block_log2: int  # block edge in voxels is 2^b
    matrix: tuple[float, ...]  # index -> world, 3 x 4 row-major
    box: tuple[float, ...]  # source's bounding box in the world: low x y z, high x y z
    sep: str = "6"  # 6 | 26 | conservative
    ties: str = "one-sided"  # one-sided | closed
    faces: str = "front"  # front | both
    normals: str = "geometric"  # geometric | input
    lod_weighting: str = "area"  # area | count
    normal_bits: int = 11

    @property
    def vertex_bits(self) -> int:
        """Bits of a coordinate of a source triangle in a block, borders included."""
        return self.block_log2 + self.snap_bits + 1

    def pack(self) -> bytes:
        """The 160 bytes that the content id begins with."""
        return _SETTINGS.pack(
            self.resolution,
            self.snap_bits,
            self.levels,
            self.block_log2,
            SEPARABILITY[self.sep],
            TIES[self.ties],
            FACES[self.faces],
            NORMALS[self.normals],
            WEIGHTING[self.lod_weighting],
            self.normal_bits,
            *self.matrix,
            *self.box,
        )


@dataclass(frozen=True, slots=True)
class Section:
    """A row of the section table; crc is 0 inside the head, which has a CRC of its own."""

    type: bytes  # 4 ASCII letters or digits
    critical: bool
    offset: int
    length: int
    crc: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Head:
    """Everything that stands at the beginning of the file."""

    settings: BlockFileHeader
    columns: tuple[ColumnSpec, ...]
    levels: Rows  # LEVEL_DTYPE, one row per level, level 0 first
    page_table: Rows  # PAGE_DTYPE: page records at depth 1, table page records at depth 2
    metadata: Mapping[str, Any]
    blocks: int
    pages: int
    opening_bytes: int
    depth: int = 1
    head_bytes: int = 0
    file_bytes: int = 0
    content_id: bytes = bytes(16)
    sections: tuple[Section, ...] = ()  # those outside the head
    read_only_features: int = 0
    crc: int = 0

    @property
    def body(self) -> tuple[int, int]:
        """Where pages and payloads may lie: from the first byte, up to the second."""
        behind = sum(section.length for section in self.sections)
        return self.head_bytes, self.file_bytes - TAIL_BYTES - behind


def head_length(levels: int, columns: int, records: int, meta: bytes, sections: int) -> int:
    """Bytes of a head with so many rows in its tables; sections : those outside the head."""
    rows = len(HEAD_SECTIONS) + sections + levels + columns + records
    return FIRST_SECTION + rows * RECORD_BYTES + len(meta) + CRC_BYTES


def pack_head(head: Head) -> bytes:
    """The bytes of the head; the caller has checked the limits."""
    identity = (BLOCK_MAGIC, VERSION, VERSION, 0, head.read_only_features, 0, head.head_bytes)
    bodies = (
        head.levels.tobytes(),
        pack_columns(head.columns),
        head.page_table.tobytes(),
        meta_bytes(head.metadata),
    )
    rows = len(HEAD_SECTIONS) + len(head.sections)
    fixed = _IDENTITY.pack(*identity, head.file_bytes, head.content_id) + head.settings.pack()
    counts = (head.blocks, head.opening_bytes, head.pages, head.depth, len(head.columns), rows)
    fixed += _COUNTS.pack(*counts)
    at = FIRST_SECTION + rows * RECORD_BYTES
    for kind, body in zip(HEAD_SECTIONS, bodies, strict=True):
        fixed += _SECTION.pack(kind, CRITICAL, at, len(body), 0)
        at += len(body)
    for section in head.sections:
        place = (section.offset, section.length, section.crc)
        fixed += _SECTION.pack(section.type, int(section.critical), *place)
    data = fixed + b"".join(bodies)
    return data + crc32(data).to_bytes(4, "little")


def pack_tail(head: Head, head_crc: int) -> bytes:
    """The 64 bytes at the end of the file."""
    data = _TAIL.pack(TAIL_MAGIC, head.file_bytes, head.content_id, head_crc, 0)[:-4]
    return data + crc32(data).to_bytes(4, "little")


def check_tail(data: bytes, head: Head, path: str) -> None:
    """Compare the last 64 bytes with the head; anything else than equality is a cut file."""
    if data != pack_tail(head, head.crc):
        at = head.file_bytes - TAIL_BYTES
        raise CorruptFileError("GSB-0102", path, at, "the tail does not match the head: truncated")


def parse_head(data: bytes, path: str) -> Head:
    """Parse and check the head.

    data : the first 64 KiB of the file, or all of a smaller one
    errors : CorruptFileError GSB-01.. and GSB-02..; UnsupportedError for a newer version, or for
    an incompatible feature or a critical section that is unknown
    """
    data = _identified(data, path)
    *_, read_only, _, _, file_bytes, content_id = _IDENTITY.unpack_from(data)
    body = len(data), file_bytes - TAIL_BYTES
    blocks, opening_bytes, pages, depth, columns, sections = _COUNTS.unpack_from(
        data, SETTINGS.stop
    )
    settings = _parse_settings(data, path)
    if blocks > MAX_BLOCKS or pages > blocks or depth not in (1, 2):
        said = f"{blocks} blocks in {pages} pages of depth {depth} are beyond the limits"
        raise CorruptFileError("GSB-0105", path, SETTINGS.stop, said)
    inside, outside = _parse_sections(data, sections, file_bytes, path)
    specs = _parse_columns(inside[b"COLM"], columns, settings, path)
    levels = _parse_levels(inside[b"LEVL"], settings, blocks, path)
    table = _parse_page_table(inside[b"PAGE"], (blocks, pages, depth), body, path)
    metadata = parse_metadata(inside[b"META"][1], inside[b"META"][0], path)
    if opening_bytes > body[1] - body[0]:
        raise CorruptFileError("GSB-0310", path, 224, "the opening run reaches beyond the body")
    crc = int.from_bytes(data[-4:], "little")
    return Head(
        settings, specs, levels, table, metadata, blocks, pages, opening_bytes, depth,
        len(data), file_bytes, content_id, outside, read_only, crc,
    )  # fmt: skip


def _identified(data: bytes, path: str) -> bytes:
    """The head's bytes out of the file's first 64 KiB, once magic, CRC and version are checked."""
    if data[:12] != BLOCK_MAGIC:
        raise CorruptFileError("GSB-0101", path, 0, "this is no block file: the magic is missing")
    length = int.from_bytes(data[28:32], "little")
    if not FIRST_SECTION <= length <= MAX_HEAD_BYTES:
        said = f"a head of {length} bytes is outside {FIRST_SECTION} to {MAX_HEAD_BYTES}"
        raise CorruptFileError("GSB-0103", path, 28, said)
    if len(data) < length:
        said = "the file ends inside its head: truncated"
        raise CorruptFileError("GSB-0102", path, len(data), said)
    data = data[:length]
    if crc32(data[:-CRC_BYTES]) != int.from_bytes(data[-CRC_BYTES:], "little"):
        said = "the head does not match its CRC"
        raise CorruptFileError("GSB-0103", path, length - CRC_BYTES, said)
    _, needs, _, incompatible, _, _, _, file_bytes, _ = _IDENTITY.unpack_from(data)
    if needs > VERSION or incompatible:
        said = f"needs a reader of version {needs} with features {incompatible:#x}"
        raise UnsupportedError(path, said, f"this release reads version {VERSION}; upgrade gstream")
    if any(data[69:72]) or any(data[239:256]):
        raise CorruptFileError("GSB-0104", path, 69, "reserved bytes of the head are not zero")
    if file_bytes < length + TAIL_BYTES:
        said = f"a length of {file_bytes} bytes cannot be: truncated"
        raise CorruptFileError("GSB-0102", path, 32, said)
    return data


def _name(names: Mapping[str, int], code: int, what: str, at: int, path: str) -> str:
    for name, value in names.items():
        if value == code:
            return name
    raise CorruptFileError("GSB-0105", path, at, f"{what} has the unknown code {code}")


def _parse_settings(data: bytes, path: str) -> BlockFileHeader:
    resolution, snap_bits, levels, block_log2, *codes = _SETTINGS.unpack_from(data, SETTINGS.start)
    sep, ties, faces, normals, weighting, normal_bits, *reals = codes
    limits = (
        ("resolution", resolution, 1, MAX_RESOLUTION, 56),
        ("snap bits", snap_bits, 0, 16, 60),
        ("levels", levels, 1, MAX_LEVELS, 61),
        ("block edge", block_log2, 3, 8, 62),
        ("normal bits", normal_bits, 8, 12, 68),
    )
    for what, value, least, most, at in limits:
        if not least <= value <= most:
            said = f"{what} {value} is outside {least} to {most}"
            raise CorruptFileError("GSB-0105", path, at, said)
    matrix, box = tuple(reals[:12]), tuple(reals[12:])
    _check_matrix(matrix, box, path)
    return BlockFileHeader(
        resolution, snap_bits, levels, block_log2, matrix, box,
        _name(SEPARABILITY, sep, "separability", 63, path),
        _name(TIES, ties, "the tie rule", 64, path),
        _name(FACES, faces, "faces", 65, path),
        _name(NORMALS, normals, "the normals' source", 66, path),
        _name(WEIGHTING, weighting, "the LOD weighting", 67, path),
        normal_bits,
    )  # fmt: skip


def _check_matrix(matrix: Sequence[float], box: Sequence[float], path: str) -> None:
    a, b, c = (np.array(matrix[i : i + 3]) for i in (0, 4, 8))
    scale = max(float(np.abs([a, b, c]).max()), 5e-324)
    volume = float(np.dot(a / scale, np.cross(b / scale, c / scale))) if isfinite(scale) else 0.0
    if not all(map(isfinite, matrix)) or volume == 0:
        raise CorruptFileError(
            "GSB-0106", path, 72, "the grid matrix is not finite or has no inverse"
        )
    if not all(map(isfinite, box)) or any(box[i] > box[i + 3] for i in range(3)):
        raise CorruptFileError(
            "GSB-0106", path, 168, "the source box is not finite or is inside out"
        )


def _parse_sections(
    data: bytes, count: int, file_bytes: int, path: str
) -> tuple[dict[bytes, tuple[int, bytes]], tuple[Section, ...]]:
    """({type: (offset, body)} of the head's sections, the sections outside the head)."""

    def refuse(at: int, said: str) -> NoReturn:
        raise CorruptFileError("GSB-0201", path, at, said)

    first, end = FIRST_SECTION + count * RECORD_BYTES, len(data) - CRC_BYTES
    if not len(HEAD_SECTIONS) <= count <= MAX_SECTIONS or first > end:
        refuse(238, f"{count} sections are outside {len(HEAD_SECTIONS)} to {MAX_SECTIONS}")
    rows = [_parse_section(data, i, path) for i in range(count)]
    inside: dict[bytes, tuple[int, bytes]] = {}
    for kind, row in zip(HEAD_SECTIONS, rows, strict=False):
        if row != Section(kind, True, first, row.length) or row.length > end - first:
            refuse(first, f"section {kind.decode()} must stand at byte {first} of the head")
        inside[kind] = (first, data[first : first + row.length])
        first += row.length
    if first != end:
        refuse(first, f"the head's last section ends here, not at byte {end}")
    outside = tuple(rows[len(HEAD_SECTIONS) :])
    first = file_bytes - TAIL_BYTES - sum(row.length for row in outside)
    if first < len(data):
        refuse(FIRST_SECTION, "the sections behind the body are longer than the file")
    for row in outside:
        if row.critical:
            said = f"section {row.type.decode('ascii', 'replace')!r} is critical and unknown"
            raise UnsupportedError(path, said, "upgrade gstream")
        if row.offset != first:
            refuse(FIRST_SECTION, "the sections behind the body do not end where the tail begins")
        first += row.length
    return inside, outside


def _parse_section(data: bytes, number: int, path: str) -> Section:
    at = FIRST_SECTION + number * RECORD_BYTES
    kind, flags, offset, length, crc = _SECTION.unpack_from(data, at)
    if any(data[at + 28 : at + 32]) or flags & ~CRITICAL:
        raise CorruptFileError("GSB-0104", path, at, "reserved bits of a section are not zero")
    return Section(kind, bool(flags & CRITICAL), offset, length, crc)


def _parse_columns(
    section: tuple[int, bytes], count: int, settings: BlockFileHeader, path: str
) -> tuple[ColumnSpec, ...]:
    at, table = section
    rows = np.frombuffer(table, COLUMN_DTYPE) if len(table) == count * RECORD_BYTES else None
    if rows is None or not 1 <= count <= MAX_COLUMNS:
        said = f"{len(table)} bytes are no table of 1 to {MAX_COLUMNS} columns"
        raise CorruptFileError("GSB-0204", path, at, said)
    try:
        columns = unpack_columns(table)
    except UnicodeDecodeError as error:
        raise CorruptFileError("GSB-0204", path, at, "a column's name is not UTF-8") from error
    ids = [column.id for column in columns]
    names = {column.name for column in columns} - {""}
    if ids[0] != 1 or ids != sorted(set(ids)) or len(names) != count or rows["zero"].any():
        said = "columns must have ascending ids from 1, distinct names and zero reserved bytes"
        raise CorruptFileError("GSB-0204", path, at, said)
    shapes = [*column_specs(settings.normal_bits).values()]
    shapes += piece_specs(settings.vertex_bits).values()
    known = {c.id: c for c in shapes}
    if pack_columns(columns) != table or any(known.get(c.id, c) != c for c in columns):
        raise CorruptFileError("GSB-0204", path, at, "a known column has another name or shape")
    return columns


def _parse_levels(
    section: tuple[int, bytes], settings: BlockFileHeader, blocks: int, path: str
) -> Rows:
    at, table = section
    if len(table) != settings.levels * RECORD_BYTES:
        said = f"{len(table)} bytes are no table of {settings.levels} levels"
        raise CorruptFileError("GSB-0203", path, at, said)
    levels = np.frombuffer(table, LEVEL_DTYPE)
    counts = [int(n) for n in levels["blocks"]]
    first = [sum(counts[level + 1 :]) for level in range(len(counts))]
    if sum(counts) != blocks or first != [int(n) for n in levels["first"]]:
        raise CorruptFileError(
            "GSB-0203", path, at, "the levels' blocks do not add up to the directory"
        )
    if (levels["block_log2"] != settings.block_log2).any() or levels["zero"].any():
        raise CorruptFileError(
            "GSB-0203", path, at, "a level has another block edge than the header"
        )
    return levels


def _parse_page_table(
    section: tuple[int, bytes], counts: tuple[int, int, int], body: tuple[int, int], path: str
) -> Rows:
    """counts : blocks, pages, depth; body : where pages may lie."""
    at, table = section
    blocks, pages, depth = counts
    records = pages if depth == 1 else len(table) // RECORD_BYTES
    if len(table) != records * RECORD_BYTES or records > PAGE_CAPACITY:
        said = f"{len(table)} bytes are no table of {pages} pages"
        raise CorruptFileError("GSB-0206", path, at, said)
    rows = np.frombuffer(table, PAGE_DTYPE)
    check_page_table(rows, blocks if depth == 1 else pages, body, path, at)
    return rows
