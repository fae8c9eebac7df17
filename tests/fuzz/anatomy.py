"""Where the fields and checksums of a sound block file or geometry stream lie.

Knows the two specs, and of gstream nothing: what a file says of itself is read with NumPy alone.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from zlib import crc32

import numpy as np

TAIL = {b"GSB": 64, b"GST": 48}


def kind(fields: str) -> np.dtype:
    """A packed record of fields, written as `2u2 f8`; S is a run of bytes."""
    return np.dtype([(f"f{i}", *_field(word)) for i, word in enumerate(fields.split())])


def _field(word: str) -> tuple:
    letter = next(i for i, c in enumerate(word) if c in "ufS")
    count = int(word[:letter] or 1)
    return ("<" + word[letter:],) if count == 1 else ("<" + word[letter:], count)


RECORD = kind("u8 u4 u4 u4 u4 u1 u1 6u1")
PAGE = kind("u1 3u1 u4 u8 u8 u4 u4")
ENTRY = kind("u8 u4 u1 u1 u1 u1 3u1 3u1 2u1")
SECTION = kind("S4 u4 u8 u8 u4 u4")
LEVEL = kind("u8 u8 u8 u1 7u1")
COLUMN = kind("u2 u1 u1 u4 S24")
BLOCK_HEAD = kind("S12 u2 u2 u4 u4 u4 u4 u8 S16 u4 9u1 3u1 12f8 6f8 u8 u8 u4 u1 u1 u1 17u1")
BLOCK_TAIL = kind("S12 u8 S16 u4 20u1 u4")
STREAM_HEAD = kind("S12 u2 u2 u4 u4 u4 u2 u2 u4")
ATTRIBUTE = kind("u2 u1 u1 u4 S24")
CHUNK = kind("S4 u2 u2 u4 u4 u4 u4 u4 u4 6f8")
PART = kind("u2 u1 u1 u1 u1 u2 u4 u4 u4")
DIRECTORY = kind("S4 u4 u4 u4")
ROW = kind("u8 u4 u4 u4 u4 6f8")
STREAM_TAIL = kind("u8 u8 u8 u4 u4 u4 S12")

Span = tuple[int, int]  # offset, length


@dataclass(frozen=True)
class Anatomy:
    """A sound file and the places in it."""

    name: str
    data: bytes
    fields: tuple[Span, ...]
    rows: tuple[Span, ...]  # records of a table, each next to others of its kind
    texts: tuple[Span, ...]  # JSON
    payloads: tuple[Span, ...]
    body_end: int  # where the tail of a block file begins, or the directory of a stream
    seal: Callable[[bytearray], None]  # makes the checksums right again, where they stand

    @property
    def is_stream(self) -> bool:
        return self.data[1:4] == b"GST"


def put_crc(data: bytearray, at: int, first: int, end: int) -> None:
    """The CRC of data[first:end] at `at`, if there is room for it."""
    if 0 <= at <= len(data) - 4:
        data[at : at + 4] = crc32(data[first:end]).to_bytes(4, "little")


def number(data: bytes | bytearray, at: int, size: int) -> int:
    return int.from_bytes(data[at : at + size], "little")


def leaves(at: int, dtype: np.dtype) -> Iterator[Span]:
    """Every field of a record that stands at `at`, arrays item by item."""
    for name in dtype.names:
        part, offset = dtype.fields[name][:2]
        item, count = part.subdtype or (part, (1,))
        yield from ((at + offset + i * item.itemsize, item.itemsize) for i in range(count[0]))


def table(at: int, dtype: np.dtype, count: int) -> list[int]:
    return [at + i * dtype.itemsize for i in range(count)]


def dissect(name: str, data: bytes) -> Anatomy:
    """The anatomy of a sound file."""
    return (_stream if data[1:4] == b"GST" else _blocks)(name, data)


def _blocks(name: str, data: bytes) -> Anatomy:
    head, sections = number(data, 28, 4), table(256, SECTION, data[238])
    starts = [number(data, at + 8, 8) for at in sections]
    lengths = [number(data, at + 16, 8) for at in sections]
    levels = table(starts[0], LEVEL, lengths[0] // 32)
    columns = table(starts[1], COLUMN, lengths[1] // 32)
    pages = table(starts[2], PAGE, lengths[2] // 32)
    tables: list[int] = []
    if data[236] == 2:
        tables = pages
        inside = [table(number(data, at + 16, 8), PAGE, number(data, at + 4, 4)) for at in tables]
        pages = [at for part in inside for at in part]
    entry_bytes = 24 + 32 * len(columns)
    entries = [
        number(data, at + 16, 8) + i * entry_bytes
        for at in pages
        for i in range(number(data, at + 4, 4))
    ]
    records = [at + 24 + 32 * i for at in entries for i in range(len(columns))]
    tail = len(data) - TAIL[b"GSB"]
    kinds = [(BLOCK_HEAD, [0]), (SECTION, sections), (LEVEL, levels), (COLUMN, columns)]
    kinds += [(PAGE, tables + pages), (ENTRY, entries), (RECORD, records), (BLOCK_TAIL, [tail])]
    payloads = [(number(data, at, 8), number(data, at + 8, 4)) for at in records]

    def seal(changed: bytearray) -> None:
        for at in records:
            first, stored = number(changed, at, 8), number(changed, at + 8, 4)
            if stored:
                put_crc(changed, at + 16, first, first + stored)
        for at in [*pages, *tables]:
            first = number(changed, at + 16, 8)
            put_crc(changed, at + 28, first, first + number(changed, at + 24, 4))
        for at in sections[4:]:
            first = number(changed, at + 8, 8)
            put_crc(changed, at + 24, first, first + number(changed, at + 16, 8))
        put_crc(changed, head - 4, 0, head - 4)
        end = len(changed) - TAIL[b"GSB"]
        changed[end + 12 : end + 36] = changed[32:56]
        changed[end + 36 : end + 40] = changed[head - 4 : head]
        put_crc(changed, len(changed) - 4, end, len(changed) - 4)

    return Anatomy(
        name,
        data,
        tuple(span for dtype, places in kinds for at in places for span in leaves(at, dtype)),
        tuple((at, dtype.itemsize) for dtype, places in kinds[1:-1] for at in places),
        ((starts[3], lengths[3]),),
        tuple(span for span in payloads if span[1]),
        tail,
        seal,
    )


def _stream(name: str, data: bytes) -> Anatomy:
    attributes = table(36, ATTRIBUTE, number(data, 28, 2))
    text = 36 + 32 * len(attributes), number(data, 32, 4)
    header = sum(text)
    tail = len(data) - TAIL[b"GST"]
    directory = number(data, tail + 8, 8)
    size = number(data, tail + 16, 8)
    rows = table(directory + 16, ROW, number(data, directory + 4, 4))
    chunks = [number(data, at, 8) for at in rows]
    parts = [table(at + 80, PART, number(data, at + 6, 2)) for at in chunks]
    payloads = []
    for at, inside in zip(chunks, parts, strict=True):
        first = at + 84 + 20 * len(inside)
        for part in inside:
            payloads.append((first, number(data, part + 8, 4)))
            first += payloads[-1][1]
    all_parts = [at for inside in parts for at in inside]
    kinds = [(STREAM_HEAD, [0]), (ATTRIBUTE, attributes), (CHUNK, chunks), (PART, all_parts)]
    kinds += [(DIRECTORY, [directory]), (ROW, rows), (STREAM_TAIL, [tail])]
    totals = directory + 16 + 72 * len(rows)

    def seal(changed: bytearray) -> None:
        moved = len(changed) - len(data)  # what was cut or put in stands before the directory
        for row, at, inside in zip(rows, chunks, parts, strict=True):
            first = at + 84 + 20 * len(inside)
            for part in inside:
                stored = number(changed, part + 8, 4)
                put_crc(changed, part + 16, first, first + stored)
                first += stored
            put_crc(changed, at + 80 + 20 * len(inside), at, at + 80 + 20 * len(inside))
            if moved == 0:
                changed[row + 12 : row + 24] = changed[at + 8 : at + 20]
                changed[row + 24 : row + 72] = changed[at + 32 : at + 80]
        put_crc(changed, header, 0, header)
        end = len(changed) - TAIL[b"GST"]
        changed[end + 28 : end + 32] = changed[header : header + 4]
        put_crc(changed, end + 24, directory + moved, directory + moved + size)
        put_crc(changed, end + 32, end, end + 32)

    return Anatomy(
        name,
        data,
        tuple(span for dtype, places in kinds for at in places for span in leaves(at, dtype)),
        tuple((at, dtype.itemsize) for dtype, places in kinds[1:-1] for at in places),
        (text, (totals, tail - totals)),
        tuple(span for span in payloads if span[1]),
        directory,
        seal,
    )
