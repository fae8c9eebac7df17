"""The head of a block file: fixed fields, sections, columns, levels, metadata; and the tail.

Spec: sections 3, 4 and 9. The rows of the page table are checked in directory.py.
"""

import json
import math
from dataclasses import dataclass
from itertools import pairwise
from struct import Struct
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from .errors import CorruptFileError, UnsupportedError

MAX_HEAD_BYTES = 65_536
TAIL_BYTES = 64
MAGIC = b"\x89GSB 1.0\r\n\x1a\n"
TAIL_MAGIC = b"\x89GSBTAIL\r\n\x1a\n"
VERSION = 1
MAX_BLOCKS = 1 << 24
MAX_META_BYTES = 12_288
MAX_DEPTH = 64  # of objects and arrays in each other
FIXED = Struct("<12sHHIIIIQ16sI9B3x18dQQI3B17x")
SECTION = Struct("<4sIQQI4x")
LEVEL = Struct("<QQQB7x")
COLUMN = Struct("<HBB4x24s")
INSIDE = (b"LEVL", b"COLM", b"PAGE", b"META")
VERTEX, TRIANGLE = 32, 33  # columns of source triangles
SHAPES = {  # name, components, bits (0: as the head has it), bytes of an item
    1: ("occupancy", 1, 8, 1),
    2: ("mask", 1, 6, 1),
    3: ("normal", 2, 0, 2),
    4: ("colour", 4, 8, 1),
    5: ("weight", 1, 32, 4),
    6: ("label", 1, 32, 4),
    7: ("spread", 1, 8, 1),
    VERTEX: ("vertex", 3, 0, 4),
    TRIANGLE: ("triangle", 3, 32, 4),
}


@dataclass(frozen=True, slots=True)
class Column:
    """A row of the column table."""

    id: int
    name: str
    components: int
    bits: int  # of each component
    item_bytes: int  # of each component in the raw column; 0 for a column of an unknown kind

    @property
    def field(self) -> str:
        """Its record's name in an entry: no name that a file gives can be that of another field."""
        return self.name if self.item_bytes else str(self.id)


@dataclass(frozen=True, slots=True)
class Head:
    """What the head says; the names are the spec's."""

    head_bytes: int
    file_bytes: int
    content_id: bytes
    resolution: int
    snap_bits: int  # vertices were snapped to 2^-k of a finest voxel
    levels: int
    block_log2: int
    separability: int
    faces: int
    normal_bits: int
    matrix: NDArray[np.float64]  # (3, 4): index -> world
    box: NDArray[np.float64]  # (2, 3): low and high, in the world
    blocks: int
    opening_bytes: int
    pages: int
    depth: int
    columns: tuple[Column, ...]
    level_blocks: tuple[int, ...]
    level_voxels: tuple[int, ...]
    page_table: bytes  # the section PAGE
    metadata: dict[str, Any]
    body_end: int  # where pages and payloads end
    tail: bytes  # what the tail must be


def need(condition: bool, rule: str, said: str, where: str = "head") -> None:
    if not condition:
        raise CorruptFileError(rule, said, where)


def parse_head(data: bytes) -> Head:
    """The head out of the first bytes of a file.

    data : all of the head, or all of a shorter file
    errors : CorruptFileError, UnsupportedError
    """
    need(data[:12] == MAGIC, "GSB-0101", "this is no block file", "byte 0")
    need(len(data) >= FIXED.size, "GSB-0102", "the file ends inside its head: truncated")
    (
        _, min_reader, _, incompatible, _, _, head_bytes, file_bytes, content_id,
        resolution, snap_bits, levels, log2, separability, *codes, normal_bits,
    ) = FIXED.unpack_from(data)[:19]  # fmt: skip
    *reals, blocks, opening_bytes, pages, depth, column_rows, section_rows = FIXED.unpack_from(
        data
    )[19:]
    need(465 <= head_bytes <= MAX_HEAD_BYTES, "GSB-0103", f"a head of {head_bytes} bytes")
    need(len(data) >= head_bytes, "GSB-0102", "the file ends inside its head: truncated")
    crc = data[head_bytes - 4 : head_bytes]
    need(crc32(data[: head_bytes - 4]) == int.from_bytes(crc, "little"), "GSB-0103", "another CRC")
    if min_reader > VERSION or incompatible:
        raise UnsupportedError(f"needs a reader of version {min_reader}, features {incompatible}")
    need(file_bytes >= head_bytes + TAIL_BYTES, "GSB-0102", f"a file of {file_bytes} bytes")
    within = (
        1 <= resolution <= 65_536 and snap_bits <= 16 and 1 <= levels <= 17 and 3 <= log2 <= 8
        and separability in (1, 6, 26) and max(codes) <= 1 and 8 <= normal_bits <= 12
        and blocks <= MAX_BLOCKS and pages <= blocks and depth in (1, 2)
    )  # fmt: skip
    need(within, "GSB-0105", "a number is outside its limits")
    matrix, box = np.array(reals[:12]).reshape(3, 4), np.array(reals[12:]).reshape(2, 3)
    _check_places(matrix, box)
    bodies, body_end = _sections(data, section_rows, head_bytes, file_bytes)
    need(opening_bytes <= body_end - head_bytes, "GSB-0310", "the opening run leaves the body")
    level_blocks, level_voxels = _levels(bodies[0], levels, log2, blocks)
    stated = TAIL_MAGIC + data[32:56] + crc + bytes(20)
    return Head(
        head_bytes, file_bytes, content_id, resolution, snap_bits, levels, log2, separability,
        codes[1], normal_bits, matrix, box, blocks, opening_bytes, pages, depth,
        _columns(bodies[1], column_rows, {3: normal_bits, VERTEX: log2 + snap_bits + 1}),
        level_blocks, level_voxels,
        bodies[2], _metadata(bodies[3]), body_end, stated + crc32(stated).to_bytes(4, "little"),
    )  # fmt: skip


def _check_places(matrix: NDArray[np.float64], box: NDArray[np.float64]) -> None:
    finite = bool(np.isfinite(matrix).all() and np.isfinite(box).all())
    need(finite and bool((box[0] <= box[1]).all()), "GSB-0106", "matrix or box mean nothing")
    sign, log = np.linalg.slogdet(matrix[:, :3])
    need(sign != 0 and math.isfinite(log), "GSB-0106", "the matrix has no inverse")


def _sections(data: bytes, rows: int, head_bytes: int, file_bytes: int) -> tuple[list[bytes], int]:
    """The bodies of LEVL, COLM, PAGE and META, and where the body ends."""
    at = FIXED.size + SECTION.size * rows
    need(4 <= rows <= 16 and at <= head_bytes - 4, "GSB-0201", f"{rows} sections")
    table = list(SECTION.iter_unpack(data[FIXED.size : at]))
    bodies = []
    for name, (kind, flags, offset, length, _) in zip(INSIDE, table, strict=False):
        lawful = kind == name and flags & 1 and offset == at and length <= head_bytes - 4 - at
        need(bool(lawful), "GSB-0201", f"section {name.decode()} is not in its place")
        bodies.append(data[at : at + length])
        at += length
    need(at == head_bytes - 4, "GSB-0201", "the sections do not end at the CRC")
    if any(flags & 1 for _, flags, *_ in table[4:]):
        raise UnsupportedError("has a critical section of a kind that is not known")
    body_end = file_bytes - TAIL_BYTES - sum(length for *_, length, _ in table[4:])
    need(body_end >= head_bytes, "GSB-0201", "sections are longer than the file")
    return bodies, body_end


def _columns(table: bytes, count: int, widths: dict[int, int]) -> tuple[Column, ...]:
    """widths : bits of a component, of the columns that take them from the head."""
    need(1 <= count <= 16 and len(table) == count * COLUMN.size, "GSB-0204", f"{count} columns")
    columns = []
    for id_, components, bits, padded in COLUMN.iter_unpack(table):
        try:
            name = padded.rstrip(b"\0").decode()
        except UnicodeDecodeError:
            raise CorruptFileError("GSB-0204", f"name of column {id_}: no UTF-8", "head") from None
        known, parts, width, item_bytes = SHAPES.get(id_, (name, components, bits, 0))
        same = (name, components, bits) == (known, parts, width or widths.get(id_, bits))
        need(same or not item_bytes, "GSB-0204", f"column {id_} has another name or shape")
        columns.append(Column(id_, name, components, bits, item_bytes))
    ids, names = [column.id for column in columns], {column.name for column in columns}
    ascend = ids[0] == 1 and all(a < b for a, b in pairwise(ids))
    need(ascend and len(names) == count and "" not in names, "GSB-0204", "ids or names twice")
    return tuple(columns)


def _levels(
    table: bytes, levels: int, log2: int, blocks: int
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    need(len(table) == levels * LEVEL.size, "GSB-0203", "no table of levels")
    counts, voxels, firsts, edges = zip(*LEVEL.iter_unpack(table), strict=True)
    coarser = [sum(counts[level + 1 :]) for level in range(levels)]
    adds_up = list(firsts) == coarser and sum(counts) == blocks and set(edges) == {log2}
    need(adds_up, "GSB-0203", "the level table does not add up")
    return counts, voxels


def _metadata(data: bytes) -> dict[str, Any]:
    need(len(data) <= MAX_META_BYTES, "GSB-0205", f"metadata of {len(data)} bytes")
    try:
        value = json.loads(data.decode(), object_pairs_hook=_distinct, parse_int=_integer)
        json.dumps(value, ensure_ascii=False, allow_nan=False).encode()  # NaN, 1e999, half pairs
    except (ValueError, RecursionError):
        said = "the metadata is not the JSON it must be"
        raise CorruptFileError("GSB-0205", said, "head") from None
    need(isinstance(value, dict), "GSB-0205", "the metadata is no JSON object")
    texts = all(isinstance(value.get(key), str | None) for key in ("units", "up", "crs"))
    need(isinstance(value.get("ledger"), dict) and texts, "GSB-0205", "no ledger, or no texts")
    need(_depth(value) <= MAX_DEPTH, "GSB-0205", f"metadata nested more than {MAX_DEPTH} deep")
    return dict(value)


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(dict(pairs)) < len(pairs):
        raise ValueError("a key stands twice")
    return dict(pairs)


def _integer(text: str) -> int:
    if math.isinf(float(text)):
        raise ValueError("beyond binary64")
    return int(text)


def _depth(value: object) -> int:
    """Objects and arrays in each other."""
    depth, nodes = 0, [value]
    while nested := [node for node in nodes if isinstance(node, dict | list)]:
        depth += 1
        nodes = [v for n in nested for v in (n.values() if isinstance(n, dict) else n)]
    return depth
