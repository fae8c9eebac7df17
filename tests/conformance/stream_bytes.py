"""Geometry streams put together with struct alone, whole and broken: the source of the vectors.

Knows spec/stream.md and nothing of gstream. stream_freedoms.py has more good ones, and writes all.
"""

import json
import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import lz4.block

MAGIC = b"\x89GST 1.0\r\n\x1a\n"
POSITION = (1, 4, 3, b"position")
POSITION_F8 = (2, 5, 3, b"position")
NORMAL = (3, 4, 3, b"normal")
COLOUR = (4, 1, 4, b"colour")
CORNERS = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0, -0.0))


def crc(data: bytes) -> bytes:
    return zlib.crc32(data).to_bytes(4, "little")


@dataclass(frozen=True)
class PartBytes:
    attribute: int
    domain: int
    stored: bytes
    raw: int | None = None  # None: as stored
    filter: int = 0
    codec: int = 0
    zero: int = 0
    crc: int | None = None

    def record(self) -> bytes:
        raw = len(self.stored) if self.raw is None else self.raw
        check = zlib.crc32(self.stored) if self.crc is None else self.crc
        head = (self.attribute, self.domain, self.filter, self.codec, self.zero, 0)
        return struct.pack("<HBBBBHIII", *head, len(self.stored), raw, check)


@dataclass(frozen=True)
class ChunkBytes:
    """One chunk; the default is the smallest one that has a triangle."""

    parts: tuple[PartBytes, ...]
    triangles: int = 1
    vertices: int = 3
    index_bytes: int = 0
    source: int = 0
    non_finite: int = 0
    degenerate: int = 0
    box: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0, 2.0, 0.0)
    magic: bytes = b"CHNK"
    payload: int | None = None
    part_count: int | None = None
    wrong_crc: int = 0

    def head(self) -> bytes:
        payload = sum(len(p.stored) for p in self.parts) if self.payload is None else self.payload
        count = len(self.parts) if self.part_count is None else self.part_count
        numbers = (self.index_bytes, count, self.triangles, self.vertices, self.source, payload)
        counters = (self.non_finite, self.degenerate)
        data = struct.pack("<4sHHIIIIII6d", self.magic, *numbers, *counters, *self.box)
        data += b"".join(part.record() for part in self.parts)
        return data + (zlib.crc32(data) ^ self.wrong_crc).to_bytes(4, "little")

    def write(self) -> bytes:
        return self.head() + b"".join(part.stored for part in self.parts)

    def row(self, offset: int) -> bytes:
        numbers = (len(self.write()), self.triangles, self.vertices, self.source)
        return struct.pack("<QIIII6d", offset, *numbers, *self.box)


def counters(read: int, stored: int, non_finite: int = 0, degenerate: int = 0) -> dict[str, Any]:
    numbers = {"read": read, "stored": stored, "non_finite": non_finite, "degenerate": degenerate}
    return {"name": "a.ply", **numbers}


@dataclass(frozen=True)
class StreamBytes:
    """A whole file; each field that starts with `edit` or `wrong` breaks one thing."""

    chunks: tuple[ChunkBytes, ...]
    attributes: tuple[tuple[int, int, int, bytes], ...] = (POSITION,)
    metadata: bytes = b"{}"
    sources: tuple[dict[str, Any], ...] | None = (counters(1, 1),)
    box: Any = ((0.0, 0.0, 0.0), (1.0, 2.0, 0.0))
    totals: bytes | None = None
    totals_bytes: int | None = None
    versions: tuple[int, int] = (1, 1)
    features: tuple[int, int, int] = (0, 0, 0)
    attribute_count: int | None = None
    header_zero: int = 0
    descriptor_zero: int = 0
    wrong_header_crc: int = 0
    directory_magic: bytes = b"GDIR"
    chunk_count: int | None = None
    edit_rows: Callable[[bytes], bytes] = field(default=lambda rows: rows)
    edit_tail: Callable[[list[int]], list[int]] = field(default=lambda numbers: numbers)
    wrong_tail_crc: int = 0

    def header(self) -> bytes:
        count = len(self.attributes) if self.attribute_count is None else self.attribute_count
        numbers = (*self.versions, *self.features, count, self.header_zero, len(self.metadata))
        data = struct.pack("<12sHHIIIHHI", MAGIC, *numbers)
        for id_, dtype, components, name in self.attributes:
            data += struct.pack("<HBBI24s", id_, dtype, components, self.descriptor_zero, name)
        data += self.metadata
        return data + (zlib.crc32(data) ^ self.wrong_header_crc).to_bytes(4, "little")

    def directory(self, start: int) -> bytes:
        rows = b""
        for chunk in self.chunks:
            rows += chunk.row(start)
            start += len(chunk.write())
        text = self.totals
        if text is None:
            said = {"sources": self.sources, "box": self.box}
            text = json.dumps(said, sort_keys=True, separators=(",", ":")).encode()
        count = len(self.chunks) if self.chunk_count is None else self.chunk_count
        size = len(text) if self.totals_bytes is None else self.totals_bytes
        head = struct.pack("<4sIII", self.directory_magic, count, size, 0)
        return head + self.edit_rows(rows) + text

    def write(self) -> bytes:
        body = self.header() + b"".join(chunk.write() for chunk in self.chunks)
        directory = self.directory(len(self.header()))
        length = len(body) + len(directory) + 48
        header_crc = int.from_bytes(self.header()[-4:], "little")
        numbers = [length, len(body), len(directory), zlib.crc32(directory), header_crc]
        tail = struct.pack("<QQQII", *self.edit_tail(numbers))
        check = (zlib.crc32(tail) ^ self.wrong_tail_crc).to_bytes(4, "little")
        return body + directory + tail + check + MAGIC


def floats(values: Sequence[Sequence[float]], letter: str = "f") -> bytes:
    return b"".join(struct.pack(f"<3{letter}", *row) for row in values)


def pack(raw: bytes) -> bytes:
    return lz4.block.compress(raw, store_size=False)


SOUP = ChunkBytes((PartBytes(1, 0, floats(CORNERS)),))
SMALLEST = StreamBytes((SOUP,))

FAN = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 1.0, 0.5))
FAN_TRIANGLES = ((0, 1, 2), (0, 2, 3), (0, 3, 4), (4, 4, 0))
FAN_BOX = (-1.0, 0.0, 0.0, 1.0, 1.0, 0.5)
# First use: 0 1 2 are new, then each index as its distance below the mark; low bytes, high bytes.
FAN_CODES = bytes([0, 0, 0, 3, 1, 0, 4, 1, 0, 1, 1, 5]) + bytes(12)
FAN_INDEX = PartBytes(0, 1, pack(FAN_CODES), len(FAN_CODES), filter=3, codec=1)
FAN_CHUNK = ChunkBytes(
    (
        FAN_INDEX,
        PartBytes(1, 0, floats(FAN)),
        PartBytes(3, 0, struct.pack("<3f", 0.0, 0.0, 1.0), codec=2),
        PartBytes(4, 2, bytes(range(16))),
    ),
    triangles=4,
    vertices=5,
    index_bytes=2,
    degenerate=1,
    non_finite=2,
    box=FAN_BOX,
)
FAN_FILE = StreamBytes(
    (FAN_CHUNK,),
    (POSITION, NORMAL, COLOUR),
    b'{"crs":null,"units":"m"}',
    (counters(6, 4, 2, 1),),
    (FAN_BOX[:3], FAN_BOX[3:]),
)
EDGE_CODES = bytes([255, 0, 0, 1]) + bytes([0, 0, 0, 4]) + bytes(4)
EDGE_CHUNK = replace(
    FAN_CHUNK,
    parts=(PartBytes(0, 1, EDGE_CODES, filter=6), PartBytes(1, 0, floats(FAN))),
    degenerate=0,
)


def full_chunk(last: int, *numbers: int) -> StreamBytes:
    """65 536 triangles on 65 536 vertices, all in one place; the last one has the edge code `last`.

    numbers : those that the codes take after the three of the first triangle
    """
    codes = bytes([255]) + bytes(65_533) + bytes([1, last])
    low = bytes([0, 0, 0, *(number & 255 for number in numbers)])
    high = bytes([0, 0, 0, *(number >> 8 for number in numbers)])
    raw = codes + low + high
    parts = (
        PartBytes(0, 1, pack(raw), len(raw), filter=6, codec=1),
        PartBytes(1, 0, bytes(12), codec=2),
    )
    chunk = replace(
        FAN_CHUNK, parts=parts, triangles=65_536, vertices=65_536, degenerate=65_536, non_finite=0,
        box=(0.0,) * 6,
    )  # fmt: skip
    sources = (counters(65_536, 65_536, 0, 65_536),)
    return replace(SMALLEST, chunks=(chunk,), sources=sources, box=((0.0,) * 3, (0.0,) * 3))


UNKNOWN_PART = PartBytes(900, 7, b"unknown domain, filter and codec", filter=99, codec=77)
EMPTY_CHUNK = ChunkBytes((PartBytes(1, 0, b""),), 0, 0, non_finite=5, box=(0.0,) * 6)


def with_chunk(**changes: Any) -> StreamBytes:
    return replace(SMALLEST, chunks=(replace(SOUP, **changes),))


def with_part(**changes: Any) -> StreamBytes:
    return with_chunk(parts=(replace(SOUP.parts[0], **changes),))


def with_fan_index(part: PartBytes) -> StreamBytes:
    return replace(FAN_FILE, chunks=(replace(FAN_CHUNK, parts=(part, *FAN_CHUNK.parts[1:])),))


GOOD: dict[str, StreamBytes] = {
    "stream-smallest": SMALLEST,
    "stream-indexed": FAN_FILE,
    "stream-edges": replace(FAN_FILE, chunks=(EDGE_CHUNK,), sources=(counters(6, 4, 2),)),
    "stream-no-chunks": replace(SMALLEST, chunks=(), sources=(), box=None),
    "stream-empty-chunk": replace(
        SMALLEST, chunks=(EMPTY_CHUNK,), sources=(counters(5, 0, 5),), box=None
    ),
    "stream-float64": replace(
        with_chunk(parts=(PartBytes(2, 0, floats(CORNERS, "d")), PartBytes(4, 3, b"\1\2\3\4"))),
        attributes=(POSITION_F8, COLOUR),
    ),
    "stream-unknown-attribute": replace(
        with_chunk(parts=(UNKNOWN_PART, SOUP.parts[0])),
        attributes=(POSITION, (900, 2, 7, b"from the future")),
    ),
    "stream-ignorable-features": replace(SMALLEST, versions=(1, 9), features=(0, 6, 5)),
}

NEWER: dict[str, StreamBytes] = {
    "version": replace(SMALLEST, versions=(2, 2)),
    "incompatible feature": replace(SMALLEST, features=(1, 0, 0)),
    "codec": with_part(codec=9),
    "filter": with_part(filter=200),
    "index filter": with_fan_index(replace(FAN_INDEX, filter=200)),
    "domain": with_part(domain=3),
}


def _swap(tail: list[int], index: int, value: int) -> list[int]:
    return [*tail[:index], value, *tail[index + 1 :]]


def _not_known() -> dict[str, StreamBytes]:
    """Sound streams with a part of a known attribute that version 1 cannot read."""
    index, positions, normals, colours = FAN_CHUNK.parts

    def with_parts(*parts: PartBytes) -> StreamBytes:
        return replace(FAN_FILE, chunks=(replace(FAN_CHUNK, parts=parts),))

    planes = floats(FAN)  # what they hold does not matter
    return {
        "": with_parts(index, positions, replace(normals, codec=3), colours),
        "-filter": with_parts(index, replace(positions, stored=planes, filter=1), colours),
        "-domain": with_parts(index, positions, PartBytes(4, 1, bytes(48))),
        "-index": with_parts(
            replace(index, filter=7), positions, PartBytes(3, 0, bytes(60), filter=5), colours
        ),
    }


def _bad() -> dict[str, bytes]:
    nan_box = (0.0, 0.0, 0.0, float("nan"), 2.0, 0.0)
    raw_index = struct.pack("<12H", *(7 if i == 5 else i % 5 for i in range(12)))
    broken = PartBytes(0, 1, b"\xf0" * 9, 24, filter=3, codec=1)
    above = PartBytes(0, 1, bytes([9]) + bytes(23), filter=3)
    twice = replace(SMALLEST, attributes=(POSITION, POSITION))
    wrong_length = replace(SMALLEST, edit_tail=lambda t: _swap(t, 0, t[0] + 1))
    wrong_offset = replace(SMALLEST, edit_tail=lambda t: _swap(t, 1, t[1] + 1))
    wrong_header = replace(SMALLEST, edit_tail=lambda t: _swap(t, 4, t[4] ^ 1))
    wrong_directory = replace(SMALLEST, edit_tail=lambda t: _swap(t, 3, t[3] ^ 1))
    gap = replace(SMALLEST, edit_rows=lambda rows: bytes([rows[0] + 1]) + rows[1:])
    row = replace(SMALLEST, edit_rows=lambda rows: rows[:16] + b"\4" + rows[17:])
    files = {
        "GST-0003": replace(SMALLEST, wrong_header_crc=1),
        "GST-0004": replace(SMALLEST, attribute_count=33),
        "GST-0005": replace(SMALLEST, header_zero=1),
        "GST-0006": twice,
        "GST-0006-reserved": replace(SMALLEST, attributes=(POSITION, (5, 4, 3, b"uv"))),
        "GST-0007": replace(SMALLEST, metadata=b"[]"),
        "GST-0101": with_chunk(magic=b"CHNC"),
        "GST-0102": with_chunk(part_count=32),
        "GST-0103": with_chunk(wrong_crc=1),
        "GST-0104": with_chunk(triangles=65_537, vertices=3 * 65_537),
        "GST-0105": with_chunk(payload=35),
        "GST-0106": with_part(zero=1),
        "GST-0107": with_part(raw=24),
        "GST-0108": with_chunk(parts=SOUP.parts * 2),
        "GST-0109": with_chunk(vertices=4),
        "GST-0111": with_part(crc=0),
        "GST-0112": with_fan_index(PartBytes(0, 1, raw_index)),
        "GST-0112-constant": with_fan_index(PartBytes(0, 1, b"\5\0", codec=2)),
        "GST-0113": with_fan_index(broken),
        "GST-0114": with_fan_index(above),
        "GST-0114-even-code": full_chunk(0, 0),
        "GST-0115": with_chunk(box=nan_box),
        "GST-0116": with_chunk(degenerate=1),
        "GST-0117": with_chunk(box=(0.0, 0.0, 0.0, 1.0, 3.0, 0.0)),
        **{f"GST-0119{name}": file for name, file in _not_known().items()},
        "GST-0118": with_chunk(parts=(SOUP.parts[0], UNKNOWN_PART)),
        "GST-0202": replace(SMALLEST, wrong_tail_crc=1),
        "GST-0203": wrong_length,
        "GST-0204": wrong_offset,
        "GST-0205": wrong_directory,
        "GST-0206": replace(SMALLEST, directory_magic=b"GDIS"),
        "GST-0207": row,
        "GST-0208": gap,
        "GST-0209": replace(SMALLEST, totals=b"{"),
        "GST-0210": replace(SMALLEST, sources=(counters(2, 1),)),
        "GST-0211": wrong_header,
        "GST-0212": replace(SMALLEST, chunk_count=1 << 25),
        "GST-0212-totals": replace(SMALLEST, totals_bytes=(4 << 20) + 1),
        "GST-0213": replace(SMALLEST, box=None),
    }
    whole = SMALLEST.write()
    cut = {"GST-0001": b"\x89PNG" + whole[4:], "GST-0002": whole[:60], "GST-0201": whole[:-1]}
    return {**cut, **{rule: file.write() for rule, file in files.items()}}


BAD = _bad()
