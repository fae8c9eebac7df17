"""The geometry stream (.gst): header, chunks one after another, directory, tail.

spec/stream.md has every byte; one chunk's own layout is in stream_chunk.py.
"""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from struct import Struct
from typing import Any, BinaryIO, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats import stream_filters
from gstream.formats.framing import STREAM_MAGIC, crc32, parse_object
from gstream.formats.stream_chunk import (
    COLOUR,
    DESCRIBED,
    HEAD_READ,
    NORMAL,
    POSITION_F4,
    POSITION_F8,
    Attribute,
    Chunk,
    ChunkHead,
)
from gstream.formats.stream_filters import Filters
from gstream.formats.stream_parts import decode_chunk, decode_parts, encode_chunk

__all__ = [
    "COLOUR",
    "NORMAL",
    "POSITION_F4",
    "POSITION_F8",
    "Attribute",
    "Chunk",
    "StreamReader",
    "StreamWriter",
    "corners",
    "encode_chunk",
]

VERSION: Final = 1
DIRECTORY_MAGIC: Final = b"GDIR"
MAX_ATTRIBUTES: Final = 32
MAX_METADATA: Final = 1 << 20  # bytes of JSON
MAX_TOTALS: Final = 4 << 20  # bytes of JSON
MAX_CHUNKS: Final = 1 << 24

HEADER: Final = Struct("<12sHHIIIHHI")  # 36 bytes: see Header
DIRECTORY: Final = Struct("<4sIII")  # 16 bytes: magic, chunks, bytes of totals, zero
TAIL: Final = Struct("<QQQIII12s")  # 48 bytes: see Tail

ROW: Final = np.dtype(
    [
        ("offset", "<u8"),  # of the chunk's head, from the start of the file
        ("length", "<u4"),  # bytes, head and payload
        ("triangles", "<u4"),
        ("vertices", "<u4"),
        ("source", "<u4"),
        ("box", "<f8", (2, 3)),  # low and high corner of the vertices, both inside
    ]
)  # 72 bytes

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Header:
    """The start of a stream: versions, features, what the attributes are, and free metadata."""

    attributes: tuple[Attribute, ...]
    metadata: Mapping[str, Any]  # units, up, crs, bounds: absent, null and a value differ

    def write(self) -> bytes:
        text = as_json(self.metadata)
        data = HEADER.pack(
            STREAM_MAGIC, VERSION, VERSION, 0, 0, 0, len(self.attributes), 0, len(text)
        )
        for a in self.attributes:
            data += Attribute.LAYOUT.pack(a.id, a.dtype, a.components, 0, a.name.encode("ascii"))
        data += text
        return data + crc32(data).to_bytes(4, "little")


@dataclass(frozen=True, slots=True)
class Tail:
    """The last 48 bytes of a whole file."""

    BYTES: ClassVar = TAIL.size
    file_length: int
    directory_offset: int
    directory_length: int
    directory_crc: int
    header_crc: int  # repeats the header's own CRC

    def write(self) -> bytes:
        numbers = (self.file_length, self.directory_offset, self.directory_length)
        data = TAIL.pack(*numbers, self.directory_crc, self.header_crc, 0, STREAM_MAGIC)[:32]
        return data + crc32(data).to_bytes(4, "little") + STREAM_MAGIC


def as_json(value: Mapping[str, Any]) -> bytes:
    """Canonical JSON: keys sorted, no spaces, UTF-8."""
    text = json.dumps(
        value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    )
    return text.encode("utf-8", "replace")  # a path may have bytes that are no UTF-8


def parse_json(data: bytes, rule: str, path: str, at: int, what: str) -> dict[str, Any]:
    try:
        return parse_object(data)
    except ValueError as error:
        raise CorruptFileError(rule, path, at, f"{what} is not a JSON object") from error


class StreamWriter:
    """Writes a stream front to back: header, chunks as they come, directory and tail."""

    def __init__(
        self, file: BinaryIO, attributes: Sequence[Attribute], metadata: Mapping[str, Any]
    ) -> None:
        self._file = file
        self._header = Header(tuple(sorted(attributes, key=lambda a: a.id)), metadata).write()
        self._rows: list[tuple[Any, ...]] = []
        self._at = len(self._header)
        file.write(self._header)

    def add_chunk(self, data: bytes) -> None:
        """Append one chunk as `encode_chunk` made it."""
        head = ChunkHead.read(data[:HEAD_READ], "", 0)
        box = np.array(head.box).reshape(2, 3)
        self._rows.append((self._at, len(data), head.triangles, head.vertices, head.source, box))
        self._file.write(data)
        self._at += len(data)

    def finish(self, totals: Mapping[str, Any]) -> int:
        """Write directory and tail; totals as the spec has them. Returns the file's length."""
        rows = np.array(self._rows, ROW)
        box = total_box(rows)
        said = {**totals, "box": None if box is None else [list(corner) for corner in box]}
        text = as_json(said)
        directory = DIRECTORY.pack(DIRECTORY_MAGIC, len(rows), len(text), 0) + rows.tobytes() + text
        length = self._at + len(directory) + Tail.BYTES
        header_crc = int.from_bytes(self._header[-4:], "little")
        tail = Tail(length, self._at, len(directory), crc32(directory), header_crc)
        self._file.write(directory + tail.write())
        return length


def total_box(rows: Array) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Low and high corner over all chunks that have vertices; None when none has."""
    boxes = rows["box"][rows["vertices"] > 0]
    if not len(boxes):
        return None
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    return tuple(map(float, low)), tuple(map(float, high))


class StreamReader:
    """Opens a stream by its header, directory and tail; each chunk is read when asked for.

    The file is opened anew for each read: a reader owns no descriptor and needs no closing.
    """

    attributes: tuple[Attribute, ...]
    metadata: dict[str, Any]
    totals: dict[str, Any]  # {} when recovered
    chunks: Array  # (n,) ROW: offset, length, triangles, vertices, source, box
    box: tuple[tuple[float, ...], tuple[float, ...]] | None  # low, high of all stored vertices

    def __init__(self, path: str | Path, filters: Filters = stream_filters) -> None:
        self._open(path, filters)
        tail = self._read_tail()
        self._read_directory(tail)
        self.box = total_box(self.chunks)

    @classmethod
    def recover(cls, path: str | Path, filters: Filters = stream_filters) -> "StreamReader":
        """Open a cut stream by walking its chunks up to the first that is not whole."""
        reader = cls.__new__(cls)
        reader._open(path, filters)
        reader.totals, rows, at = {}, [], reader.header_bytes
        while (row := reader._row_at(at)) is not None:
            rows.append(row)
            at += row[1]
        reader.chunks = np.array(rows, ROW)
        reader.box = total_box(reader.chunks)
        return reader

    def chunk(self, index: int, wanted: Iterable[str] = ("normal", "colour")) -> Chunk:
        """Read and unpack one chunk; attributes that are not wanted are not unpacked."""
        at, data = self._bytes_of(index)
        return decode_chunk(data, self.path, at, frozenset(wanted), self._filters)

    def parts(self, index: int) -> dict[int, Array]:
        """Values of one chunk by attribute, of all parts that this version knows.

        errors : CorruptFileError, also for the CRC of a part that is not known
        """
        at, data = self._bytes_of(index)
        return decode_parts(data, self.path, at, None, self._filters)[1]

    def _bytes_of(self, index: int) -> tuple[int, bytes]:
        """Where one chunk stands, and its bytes, whose head is what the directory says."""
        row = self.chunks[index]
        at = int(row["offset"])
        data = self.read(at, int(row["length"]))
        self._check_row(row, ChunkHead.read(data[:HEAD_READ], self.path, at), at)
        return at, data

    def read(self, offset: int, length: int) -> bytes:
        """Up to `length` bytes from `offset`; fewer at the end of the file."""
        with open(self.path, "rb") as file:
            file.seek(offset)
            return file.read(length)

    def head(self, index: int) -> ChunkHead:
        """The head of one chunk, without its payload."""
        at = int(self.chunks[index]["offset"])
        head = ChunkHead.read(self.read(at, HEAD_READ), self.path, at)
        self._check_row(self.chunks[index], head, at)
        return head

    def _open(self, path: str | Path, filters: Filters) -> None:
        self.path, self._filters = str(path), filters
        self.file_length = os.stat(path).st_size
        self._read_header()

    def _read_header(self) -> None:
        data = self.read(0, HEADER.size)
        if not data.startswith(STREAM_MAGIC):
            raise CorruptFileError("GST-0001", self.path, 0, "not a geometry stream")
        if len(data) < HEADER.size:
            raise CorruptFileError("GST-0002", self.path, len(data), "the header is cut")
        _, needed, _, incompatible, _, _, count, zero, text = HEADER.unpack(data)
        if needed > VERSION:
            said = f"the file needs a reader of version {needed}, this is {VERSION}"
            raise UnsupportedError(self.path, said, "use a newer gstream")
        if count > MAX_ATTRIBUTES or text > MAX_METADATA:
            said = f"{count} attributes, {text} bytes of metadata"
            raise CorruptFileError("GST-0004", self.path, 28, said + " are above the limits")
        size = HEADER.size + Attribute.LAYOUT.size * count + text
        data = self.read(0, size + 4)
        if len(data) < size + 4:
            raise CorruptFileError("GST-0002", self.path, len(data), "the header is cut")
        self.header_crc = int.from_bytes(data[size:], "little")
        if crc32(data[:size]) != self.header_crc:
            raise CorruptFileError("GST-0003", self.path, size, "the header's CRC is wrong")
        if incompatible:
            said = f"the file has unknown incompatible features {incompatible:#x}"
            raise UnsupportedError(self.path, said, "use a newer gstream")
        if zero:
            raise CorruptFileError("GST-0005", self.path, 30, "reserved bytes are not zero")
        self.header_bytes = size + 4
        starts = range(HEADER.size, size - text, Attribute.LAYOUT.size)
        self.attributes = tuple(_read_attribute(data, start, self.path) for start in starts)
        if len({a.id for a in self.attributes}) != count:
            raise CorruptFileError("GST-0006", self.path, HEADER.size, "an attribute stands twice")
        where = size - text
        self.metadata = parse_json(data[where:size], "GST-0007", self.path, where, "the metadata")

    def _read_tail(self) -> Tail:
        at = self.file_length - Tail.BYTES
        data = self.read(max(at, 0), Tail.BYTES)
        if at < self.header_bytes or data[36:] != STREAM_MAGIC:
            raise CorruptFileError("GST-0201", self.path, max(at, 0), "the file is cut: no tail")
        *numbers, crc, _ = TAIL.unpack(data)
        if crc32(data[:32]) != crc:
            raise CorruptFileError("GST-0202", self.path, at + 32, "the tail's CRC is wrong")
        tail = Tail(*numbers)
        if tail.file_length != self.file_length:
            said = f"the tail states {tail.file_length} bytes, the file has {self.file_length}"
            raise CorruptFileError("GST-0203", self.path, at, said)
        if tail.directory_offset + tail.directory_length != at or tail.directory_length < 16:
            said = "the directory does not end where the tail begins"
            raise CorruptFileError("GST-0204", self.path, at + 8, said)
        if tail.header_crc != self.header_crc:
            raise CorruptFileError("GST-0211", self.path, at + 28, "header and tail disagree")
        return tail

    def _read_directory(self, tail: Tail) -> None:
        at = tail.directory_offset
        data = self.read(at, tail.directory_length)
        if crc32(data) != tail.directory_crc:
            raise CorruptFileError("GST-0205", self.path, at, "the directory's CRC is wrong")
        magic, count, text, zero = DIRECTORY.unpack_from(data)
        end = DIRECTORY.size + ROW.itemsize * count
        if count > MAX_CHUNKS or text > MAX_TOTALS:
            said = f"{count} chunks, {text} bytes of totals are above the limits"
            raise CorruptFileError("GST-0212", self.path, at, said)
        if magic != DIRECTORY_MAGIC or zero or len(data) != end + text:
            raise CorruptFileError("GST-0206", self.path, at, "the directory is malformed")
        self.chunks = np.frombuffer(data, ROW, count, DIRECTORY.size)
        self.totals = parse_json(data[end:], "GST-0209", self.path, at + end, "the totals")
        ends = self.chunks["offset"] + self.chunks["length"]
        starts = np.concatenate([[np.uint64(self.header_bytes)], ends])
        stops = np.concatenate([self.chunks["offset"], [np.uint64(at)]])
        if (starts != stops).any():
            said = "chunks leave a gap or overlap"
            raise CorruptFileError("GST-0208", self.path, at + DIRECTORY.size, said)

    def _check_row(self, row: Any, head: ChunkHead, at: int) -> None:
        said = (head.size + head.payload, head.triangles, head.vertices, head.source)
        stated = (row["length"], row["triangles"], row["vertices"], row["source"])
        if said != stated or tuple(row["box"].ravel()) != head.box:
            said_ = "the directory says something else about this chunk"
            raise CorruptFileError("GST-0207", self.path, at, said_)

    def _row_at(self, at: int) -> tuple[Any, ...] | None:
        try:
            head = ChunkHead.read(self.read(at, HEAD_READ), self.path, at)
        except CorruptFileError:
            return None
        length = head.size + head.payload
        if at + length > self.file_length:
            return None
        box = np.array(head.box).reshape(2, 3)
        return (at, length, head.triangles, head.vertices, head.source, box)


def _read_attribute(data: bytes, at: int, path: str) -> Attribute:
    id_, dtype, components, zero, name = Attribute.LAYOUT.unpack_from(data, at)
    word = name.rstrip(b"\0")
    if zero or b"\0" in word or not word.isascii() or id_ == 0:
        raise CorruptFileError("GST-0006", path, at, "an attribute descriptor is malformed")
    attribute = Attribute(id_, dtype, components, word.decode("ascii"))
    known = DESCRIBED.get(id_)
    if attribute != (known or attribute):
        said = f"attribute {id_} is not {known.name if known else ''} as the spec has it"
        raise CorruptFileError("GST-0006", path, at, said)
    return attribute


def corners(chunk: Chunk) -> tuple[Array, Array | None, Array | None]:
    """Positions (t, 3, 3), normals (t, 3, 3) and colours (t, 3, 4) of each triangle's corners."""
    rows = chunk.triangles
    if rows is None:
        rows = np.arange(len(chunk.positions)).reshape(-1, 3)
    normals = None if chunk.normals is None else chunk.normals[rows]
    colours = chunk.colours
    if colours is not None:
        per_vertex = chunk.colour_domain == 0
        colours = (
            colours[rows] if per_vertex else np.broadcast_to(colours[:, None], (len(rows), 3, 4))
        )
    return chunk.positions[rows], normals, colours
