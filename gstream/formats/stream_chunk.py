"""The records of one chunk of a geometry stream: head, part records, and what they unpack to.

spec/stream.md, "Chunk". Packing and unpacking is in stream_parts.py, the file in stream.py.
"""

from dataclasses import dataclass
from math import isfinite
from struct import Struct
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats.framing import MAX_RAW, crc32

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
class Place:
    """Where in which file something stands: what an error needs to say."""

    path: str
    at: int

    def corrupt(self, rule: str, said: str) -> CorruptFileError:
        return CorruptFileError(rule, self.path, self.at, said)

    def unsupported(self, said: str) -> UnsupportedError:
        said = f"{said} at byte {self.at} is unknown"
        return UnsupportedError(self.path, said, "use a newer gstream")


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
UV: Final = Attribute(5, 4, 2, "uv")
MATERIAL: Final = Attribute(6, 2, 1, "material")
OBJECT: Final = Attribute(7, 3, 1, "object")
KNOWN: Final = {a.id: a for a in (INDEX, POSITION_F4, POSITION_F8, NORMAL, COLOUR)}
DESCRIBED: Final = KNOWN | {a.id: a for a in (UV, MATERIAL, OBJECT)}  # the last three: reserved


DOMAINS: Final = {  # where this version reads each attribute
    "index": (DOMAIN_CORNER,),
    "position": (DOMAIN_VERTEX,),
    "normal": (DOMAIN_VERTEX,),
    "colour": (DOMAIN_VERTEX, DOMAIN_TRIANGLE, DOMAIN_CHUNK),
}


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
        head._check(Place(path, at))
        return head

    def _check(self, where: Place) -> None:
        if self.triangles > MAX_CHUNK_TRIANGLES or self.vertices > MAX_CHUNK_VERTICES:
            said = f"{self.triangles} triangles and {self.vertices} vertices, above 65536 of each"
            raise where.corrupt("GST-0104", said)
        if self.payload != sum(part.stored for part in self.parts):
            raise where.corrupt("GST-0105", "the parts do not add up to the payload")
        if self.index_bytes not in (0, 2):
            raise where.corrupt("GST-0107", f"indices of {self.index_bytes} bytes")
        ids = [part.attribute for part in self.parts]
        positions = ids.count(POSITION_F4.id) + ids.count(POSITION_F8.id)
        if len(set(ids)) != len(ids) or positions != 1:
            raise where.corrupt("GST-0108", "one position part is needed, and no attribute twice")
        if (ids[0] == ID_INDEX, ID_INDEX in ids) != (self.index_bytes == 2,) * 2:
            said = "an index part must come first, and only where the index width is 2"
            raise where.corrupt("GST-0108", said)
        if self.index_bytes == 0 and self.vertices != 3 * self.triangles:
            said = f"{self.triangles} triangles without indices have {self.vertices} vertices"
            raise where.corrupt("GST-0109", said)
        if not all(map(isfinite, self.box)):
            raise where.corrupt("GST-0115", "the box is not finite")
        if self.degenerate > self.triangles:
            raise where.corrupt("GST-0116", "more degenerate triangles than triangles")


HEAD_READ: Final = ChunkHead.LAYOUT.size + MAX_PARTS * Part.LAYOUT.size + 4  # the longest head
