"""One chunk of a geometry stream: its head, its parts, and the arrays they unpack to.

spec/stream.md, "Chunk". What stands around the chunks is in stream.py.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from struct import Struct
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats import stream_filters
from gstream.formats.framing import (
    CODEC_CONSTANT,
    CODEC_LZ4,
    CODEC_RAW,
    MAX_RAW,
    compress,
    crc32,
    decompress,
)
from gstream.formats.stream_filters import (
    FILTER_DELTA,
    FILTER_FIRST_USE,
    FILTER_NONE,
    FILTER_ORDERED_DELTA,
    Filters,
)

CHUNK_MAGIC: Final = b"CHNK"
MAX_CHUNK_TRIANGLES: Final = 65_536
MAX_CHUNK_VERTICES: Final = 65_536
MAX_PARTS: Final = 32

DOMAIN_VERTEX: Final = 0
DOMAIN_CORNER: Final = 1
DOMAIN_TRIANGLE: Final = 2
DOMAIN_CHUNK: Final = 3

DTYPES: Final = {1: "<u1", 2: "<u2", 3: "<u4", 4: "<f4", 5: "<f8"}
ID_INDEX: Final = 0

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Attribute:
    """What the values of one attribute are: a descriptor in the file's header."""

    LAYOUT: ClassVar = Struct("<HBBI24s")  # 32 bytes
    id: int
    dtype: int  # a key of DTYPES
    components: int
    name: str  # ASCII, at most 24 bytes

    @property
    def value_bytes(self) -> int:
        return self.components * np.dtype(DTYPES[self.dtype]).itemsize


INDEX: Final = Attribute(ID_INDEX, 2, 1, "index")
POSITION_F4: Final = Attribute(1, 4, 3, "position")
POSITION_F8: Final = Attribute(2, 5, 3, "position")
NORMAL: Final = Attribute(3, 4, 3, "normal")
COLOUR: Final = Attribute(4, 1, 4, "colour")
KNOWN: Final = {a.id: a for a in (INDEX, POSITION_F4, POSITION_F8, NORMAL, COLOUR)}


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """At most 65 536 triangles and 65 536 vertices of one source, unpacked."""

    positions: Array  # (v, 3) float32 or float64, world units
    triangles: Array | None = None  # (t, 3) uint16 rows of positions; None: vertices 3i, 3i+1, 3i+2
    normals: Array | None = None  # (v, 3) float32, as read
    colours: Array | None = None  # (v, 4), (t, 4) or (1, 4) uint8 RGBA, sRGB codes, straight alpha
    colour_domain: int = DOMAIN_VERTEX  # vertex, triangle or chunk
    source: int = 0  # number of the input in the totals
    non_finite: int = 0  # triangles that were left out here
    degenerate: int = 0  # triangles with two equal corner positions

    @property
    def triangle_count(self) -> int:
        return len(self.positions) // 3 if self.triangles is None else len(self.triangles)


@dataclass(frozen=True, slots=True)
class Part:
    """How one attribute of one chunk is stored."""

    LAYOUT: ClassVar = Struct("<HBBBBHIII")  # 20 bytes, little-endian
    attribute: int  # id of a descriptor; 0 = indices
    domain: int  # vertex 0, corner 1, triangle 2, chunk 3
    filter: int
    codec: int  # raw 0, LZ4 1, constant 2
    stored: int  # bytes in the file
    raw: int  # bytes after the codec, before the filter is undone
    crc: int  # CRC-32 of the stored bytes

    def write(self) -> bytes:
        return self.LAYOUT.pack(
            self.attribute,
            self.domain,
            self.filter,
            self.codec,
            0,
            0,
            self.stored,
            self.raw,
            self.crc,
        )

    @classmethod
    def read(cls, data: bytes, at: int, path: str, file_at: int) -> "Part":
        attribute, domain, filter_, codec, zero, zeros, stored, raw, crc = cls.LAYOUT.unpack_from(
            data, at
        )
        if zero or zeros:
            raise CorruptFileError(
                "GST-0106", path, file_at, "reserved bytes of a part are not zero"
            )
        if max(stored, raw) > MAX_RAW:
            raise CorruptFileError("GST-0104", path, file_at, f"a part is above {MAX_RAW} bytes")
        return cls(attribute, domain, filter_, codec, stored, raw, crc)


@dataclass(frozen=True, slots=True)
class ChunkHead:
    """The self-describing head of a chunk: what one needs to know to skip it."""

    LAYOUT: ClassVar = Struct("<4sHHIIIIII6d")  # 80 bytes, little-endian
    index_bytes: int  # 2, or 0 when corners are not shared
    triangles: int
    vertices: int
    source: int
    payload: int  # bytes after the head
    non_finite: int
    degenerate: int
    box: tuple[float, ...]  # low x y z, high x y z of the vertices, world units; zeros when empty
    parts: tuple[Part, ...]

    @property
    def size(self) -> int:
        """Length of the head itself."""
        return self.LAYOUT.size + Part.LAYOUT.size * len(self.parts) + 4

    def write(self) -> bytes:
        data = self.LAYOUT.pack(
            CHUNK_MAGIC, self.index_bytes, len(self.parts), self.triangles, self.vertices,
            self.source, self.payload, self.non_finite, self.degenerate, *self.box,
        )  # fmt: skip
        data += b"".join(part.write() for part in self.parts)
        return data + crc32(data).to_bytes(4, "little")

    @classmethod
    def read(cls, data: bytes, path: str, at: int) -> "ChunkHead":
        """Parse the head at the start of `data`, which lies at byte `at` of the file."""
        if len(data) < cls.LAYOUT.size:
            raise CorruptFileError("GST-0102", path, at, "the file ends inside a chunk head")
        magic, width, parts, triangles, vertices, *numbers = cls.LAYOUT.unpack_from(data)
        if magic != CHUNK_MAGIC:
            raise CorruptFileError("GST-0101", path, at, "no chunk starts here")
        size = cls.LAYOUT.size + Part.LAYOUT.size * parts
        if parts > MAX_PARTS:
            raise CorruptFileError("GST-0104", path, at, f"{parts} parts, above {MAX_PARTS}")
        if len(data) < size + 4:
            raise CorruptFileError("GST-0102", path, at, "the file ends inside a chunk head")
        if crc32(data[:size]) != int.from_bytes(data[size : size + 4], "little"):
            raise CorruptFileError("GST-0103", path, at, "a chunk head's CRC is wrong")
        offsets = range(cls.LAYOUT.size, size, Part.LAYOUT.size)
        records = tuple(Part.read(data, offset, path, at + offset) for offset in offsets)
        source, payload, non_finite, degenerate, *box = numbers
        head = cls(
            width, triangles, vertices, source, payload, non_finite, degenerate, tuple(box), records
        )
        head._check(path, at)
        return head

    def _check(self, path: str, at: int) -> None:
        if self.triangles > MAX_CHUNK_TRIANGLES or self.vertices > MAX_CHUNK_VERTICES:
            said = f"{self.triangles} triangles and {self.vertices} vertices, above 65536 of each"
            raise CorruptFileError("GST-0104", path, at, said)
        if self.payload != sum(part.stored for part in self.parts):
            raise CorruptFileError("GST-0105", path, at, "the parts do not add up to the payload")
        if self.index_bytes not in (0, 2):
            raise CorruptFileError("GST-0107", path, at, f"indices of {self.index_bytes} bytes")
        ids = [part.attribute for part in self.parts]
        positions = ids.count(POSITION_F4.id) + ids.count(POSITION_F8.id)
        if len(set(ids)) != len(ids) or positions != 1:
            said = "a chunk needs one position part and no attribute twice"
            raise CorruptFileError("GST-0108", path, at, said)
        if (ID_INDEX in ids) != (self.index_bytes == 2):
            raise CorruptFileError("GST-0108", path, at, "index part and index width disagree")
        if self.index_bytes == 0 and self.vertices != 3 * self.triangles:
            said = f"{self.triangles} triangles without indices have {self.vertices} vertices"
            raise CorruptFileError("GST-0109", path, at, said)
        if self.degenerate > self.triangles:
            raise CorruptFileError("GST-0116", path, at, "more degenerate triangles than triangles")

    def count(self, domain: int, path: str, at: int) -> int:
        """Values that an attribute of `domain` has in this chunk."""
        if domain > DOMAIN_CHUNK:
            raise UnsupportedError(
                path, f"domain {domain} at byte {at} is unknown", "use a newer gstream"
            )
        return (self.vertices, 3 * self.triangles, self.triangles, 1)[domain]


HEAD_READ: Final = ChunkHead.LAYOUT.size + MAX_PARTS * Part.LAYOUT.size + 4  # the longest head


def encode_chunk(chunk: Chunk, lz4: str, filters: Filters = stream_filters) -> bytes:
    """Head and payload of one chunk; lz4: fast | hc."""
    payload: list[bytes] = []
    parts: list[Part] = []
    for attribute, domain, values in _values(chunk):
        part, stored = _encode_part(attribute, domain, values, lz4, filters)
        parts.append(part)
        payload.append(stored)
    head = ChunkHead(
        index_bytes=0 if chunk.triangles is None else 2,
        triangles=chunk.triangle_count,
        vertices=len(chunk.positions),
        source=chunk.source,
        payload=sum(map(len, payload)),
        non_finite=chunk.non_finite,
        degenerate=chunk.degenerate,
        box=tight_box(chunk.positions),
        parts=tuple(parts),
    )
    return b"".join([head.write(), *payload])


def tight_box(positions: Array) -> tuple[float, ...]:
    """Low x y z and high x y z as float64; zeros for no vertices, and a zero is always +0.0."""
    if not len(positions):
        return (0.0,) * 6
    columns = np.ascontiguousarray(
        positions.T
    )  # min over a long axis is vectorised: 8 times faster
    low, high = columns.min(axis=1), columns.max(axis=1)
    return tuple(float(value) + 0.0 for value in (*low, *high))


def position_attribute(positions: Array) -> Attribute:
    return POSITION_F8 if positions.dtype == np.float64 else POSITION_F4


def _values(chunk: Chunk) -> Iterator[tuple[Attribute, int, Array]]:
    if chunk.triangles is not None:
        yield INDEX, DOMAIN_CORNER, chunk.triangles.reshape(-1, 1)
    yield position_attribute(chunk.positions), DOMAIN_VERTEX, chunk.positions
    if chunk.normals is not None:
        yield NORMAL, DOMAIN_VERTEX, chunk.normals
    if chunk.colours is not None:
        yield COLOUR, chunk.colour_domain, chunk.colours


def _encode_part(
    attribute: Attribute, domain: int, values: Array, lz4: str, filters: Filters
) -> tuple[Part, bytes]:
    values = np.ascontiguousarray(values, DTYPES[attribute.dtype])
    filter_, codec, stored, raw = FILTER_NONE, CODEC_RAW, b"", values.nbytes
    bits = values.view(f"<u{values.itemsize}")
    if (
        len(bits) > 1
        and attribute is not INDEX
        and (bits[1] == bits[0]).all()
        and (bits == bits[0]).all()
    ):
        codec, stored = CODEC_CONSTANT, bits[0].tobytes()
        raw = len(stored)
    elif len(bits) > 1:
        planes = np.empty((bits.shape[1], bits.itemsize, len(bits)), np.uint8)
        if attribute is INDEX:
            filter_ = FILTER_FIRST_USE
            filters.first_use_planes(bits[:, 0], planes[0])
        else:
            ordered = values.dtype.kind == "f"
            filter_ = FILTER_ORDERED_DELTA if ordered else FILTER_DELTA
            filters.delta_planes(bits, ordered, planes)
        codec, stored = CODEC_LZ4, compress(planes.data, lz4)
    if codec != CODEC_CONSTANT and (codec == CODEC_RAW or len(stored) >= raw):
        filter_, codec, stored = FILTER_NONE, CODEC_RAW, values.tobytes()
    part = Part(attribute.id, domain, filter_, codec, len(stored), raw, crc32(stored))
    return part, stored


def decode_chunk(
    data: bytes,
    path: str,
    at: int,
    wanted: frozenset[str] = frozenset({"normal", "colour"}),
    filters: Filters = stream_filters,
) -> Chunk:
    """Unpack the chunk in `data`, which lies at byte `at` of `path`; what is not wanted is None.

    errors: CorruptFileError; UnsupportedError for an unknown filter or codec of what is wanted
    """
    head = ChunkHead.read(data, path, at)
    if len(data) != head.size + head.payload:
        raise CorruptFileError("GST-0110", path, at, "the file ends inside a chunk")
    found: dict[str, Array] = {}
    domains: dict[str, int] = {}
    offset = head.size
    for part in head.parts:
        attribute = KNOWN.get(part.attribute)
        if attribute and attribute.name in wanted | {"index", "position"}:
            stored = memoryview(data)[offset : offset + part.stored]
            domains[attribute.name] = part.domain
            found[attribute.name] = decode_part(
                head, part, attribute, stored, path, at + offset, filters
            )
        offset += part.stored
    index = found.get("index")
    return Chunk(
        positions=found["position"],
        triangles=None if index is None else index.reshape(-1, 3),
        normals=found.get("normal"),
        colours=found.get("colour"),
        colour_domain=domains.get("colour", DOMAIN_VERTEX),
        source=head.source,
        non_finite=head.non_finite,
        degenerate=head.degenerate,
    )


def decode_part(
    head: ChunkHead,
    part: Part,
    attribute: Attribute,
    stored: memoryview,
    path: str,
    at: int,
    filters: Filters = stream_filters,
) -> Array:
    """The (n, components) values of one part whose stored bytes lie at byte `at`."""
    if crc32(stored) != part.crc:
        raise CorruptFileError("GST-0111", path, at, f"the CRC of a {attribute.name} part is wrong")
    _check_domain(part, attribute, path, at)
    count = head.count(part.domain, path, at)
    dtype = np.dtype(DTYPES[attribute.dtype])
    raw = attribute.value_bytes * (1 if part.codec == CODEC_CONSTANT else count)
    if part.raw != raw:
        said = f"a {attribute.name} part states {part.raw} bytes where {raw} are needed"
        raise CorruptFileError("GST-0107", path, at, said)
    data = _unpack(part, stored, path, at)
    values = np.empty((count, attribute.components), dtype)
    bits = values.view(f"<u{dtype.itemsize}")
    if part.filter == FILTER_NONE:
        values[:] = np.frombuffer(data, dtype).reshape(-1, attribute.components)
    else:
        planes = np.frombuffer(data, np.uint8).reshape(attribute.components, dtype.itemsize, count)
        _undo(part, planes, bits, head.vertices, path, at, filters)
    if attribute is INDEX and count and int(bits.max()) >= head.vertices:
        said = f"vertex {int(bits.max())} of {head.vertices} is named"
        raise CorruptFileError("GST-0112", path, at, said)
    return values


def _check_domain(part: Part, attribute: Attribute, path: str, at: int) -> None:
    allowed: dict[str, tuple[int, ...]] = {
        "index": (DOMAIN_CORNER,),
        "position": (DOMAIN_VERTEX,),
        "normal": (DOMAIN_VERTEX,),
    }
    domains = allowed.get(attribute.name, (DOMAIN_VERTEX, DOMAIN_TRIANGLE, DOMAIN_CHUNK))
    if part.domain not in domains:
        said = f"{attribute.name} in domain {part.domain} at byte {at}"
        raise UnsupportedError(path, said, "use a newer gstream")


def _unpack(part: Part, stored: memoryview, path: str, at: int) -> bytes | memoryview:
    if part.codec == CODEC_LZ4:
        return decompress(stored, part.raw, "GST-0113", path, at)
    if part.codec not in (CODEC_RAW, CODEC_CONSTANT):
        raise UnsupportedError(path, f"codec {part.codec} at byte {at}", "use a newer gstream")
    if part.stored != part.raw or (part.codec == CODEC_CONSTANT and part.filter != FILTER_NONE):
        raise CorruptFileError("GST-0107", path, at, "a part that is not packed has another length")
    return stored


def _undo(
    part: Part, planes: Array, bits: Array, vertices: int, path: str, at: int, filters: Filters
) -> None:
    if part.filter == FILTER_FIRST_USE and part.attribute == ID_INDEX:
        used = filters.undo_first_use_planes(planes[0], vertices, bits[:, 0])
        if used != vertices:
            said = (
                f"the indices use {used} of {vertices} vertices" if used >= 0 else "a broken index"
            )
            raise CorruptFileError("GST-0114", path, at, said)
    elif part.filter in (FILTER_DELTA, FILTER_ORDERED_DELTA):
        filters.undo_delta_planes(planes, part.filter == FILTER_ORDERED_DELTA, bits)
    else:
        raise UnsupportedError(path, f"filter {part.filter} at byte {at}", "use a newer gstream")
