"""Hostile files made by hand: each breaks a reader that trusts one number too many.

A row of BOMBS is a name, how the file is made of a small vector, and what `check` has to say of it:
the rules that are broken, `valid`, or `unsupported`.
"""

import struct
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple
from zlib import crc32

import lz4.block
import numpy as np
from conformance.stream_bytes import (
    FAN_CHUNK,
    POSITION,
    SMALLEST,
    PartBytes,
    StreamBytes,
    counters,
    full_chunk,
    with_chunk,
    with_fan_index,
    with_part,
)
from damaged_block_files import Patch, patch, smallest_scene, tiny_file
from small_block_files import IDENTITY, Alter, Paging, Scene, file_bytes, leave, random_scene

from fuzz.anatomy import dissect, number
from gstream.formats.blockhead import BlockFileHeader
from gstream.formats.columns import Block, EncodedColumn, column_specs
from gstream.formats.directory import Rows
from gstream.formats.framing import CODEC_CONSTANT, CODEC_LZ4

U32, U63, U64 = 2**32 - 1, 2**63, 2**64 - 1
FULL = 8**8  # voxels of a block of 256^3


class Bomb(NamedTuple):
    name: str
    make: Callable[[], bytes]
    said: str


def u8(value: int) -> bytes:
    return value.to_bytes(8, "little")


def u4(value: int) -> bytes:
    return value.to_bytes(4, "little")


def head(at: int, value: bytes) -> Callable[[], bytes]:
    """The small block file with other bytes in its head, all checksums right."""
    return lambda: patch().at(at, value).sealed()


def in_section(kind: str, at: int, value: bytes) -> Callable[[], bytes]:
    def make() -> bytes:
        made = patch()
        return made.at(made.sections[kind][0] + at, value).sealed()

    return make


def section_row(number: int, at: int, value: bytes, **arguments: object) -> Callable[[], bytes]:
    """Another row of the section table; 4 and above stand behind the body."""
    return lambda: Patch(tiny_file(**arguments)).at(256 + 32 * number + at, value).sealed()


def entry(row: int, field: str, value: object, column: str = "") -> Callable[[], bytes]:
    return lambda: patch().entry(row, field, value, column).sealed()


def column(row: int, name: str, **fields: int) -> Callable[[], bytes]:
    """Another column record, with the CRC of the bytes that it states."""

    def make() -> bytes:
        made = patch()
        for field, value in fields.items():
            made.entry(row, field, value, name)
        return resealed(made)

    return make


def stored(row: int, name: str, start: bytes, **fields: int) -> Callable[[], bytes]:
    """Other stored bytes at the start of a column, and other fields in its record."""

    def make() -> bytes:
        made = patch().payload(row, name, start)
        for field, value in fields.items():
            made.entry(row, field, value, name)
        return resealed(made)

    return make


def resealed(made: Patch) -> bytes:
    """Like sealed(), and with the CRC of every column where it is stated to be."""
    anatomy = dissect("", tiny_file())
    anatomy.seal(made.data)
    return made.sealed()


def meta(text: bytes) -> Callable[[], bytes]:
    """The smallest block file with other metadata, which is the last part of its head."""

    def make() -> bytes:
        sound = file_bytes(smallest_scene())
        at, length = Patch(sound).sections["META"]
        data = bytearray(sound[:at] + text + sound[at + length :])
        page, more = at + len(text) + 4, len(text) - length
        # Lengths of head, file and section, then the page and the one column that is stored.
        places = ((28, 4), (32, 8), (256 + 3 * 32 + 16, 8), (at - 16, 8), (page + 24, 8))
        for place, size in places:
            data[place : place + size] = (number(data, place, size) + more).to_bytes(size, "little")
        dissect("", bytes(data)).seal(data)
        return bytes(data)

    return make


def ledger(text: bytes) -> Callable[[], bytes]:
    return meta(b'{"ledger":' + text + b"}")


def paged(change: Callable[[Patch, int], object]) -> Callable[[], bytes]:
    """A file of depth 2 whose table pages are changed; their CRCs are made right."""

    def make() -> bytes:
        sound = file_bytes(random_scene(64, voxels=40), paging=Paging(8, 4, 5))
        made = Patch(sound)
        change(made, made.sections["PAGE"][0])
        anatomy = dissect("", sound)
        anatomy.seal(made.data)
        return bytes(made.data)

    return make


def loop(made: Patch, records: int) -> None:
    """The first page record of the first table page points back at that table page."""
    at = struct.unpack_from("<Q", made.data, records + 16)[0]
    made.data[at + 16 : at + 28] = made.data[records + 16 : records + 28]


def second_loop(made: Patch, records: int) -> None:
    """The second table page is the first one again."""
    made.data[records + 48 : records + 60] = made.data[records + 16 : records + 28]


def named(name: bytes, id_: int = 900) -> Callable[[], bytes]:
    """The small file whose last column has another name, and an id that no reader knows."""

    def make() -> bytes:
        made = patch()
        at = made.sections["COLM"][0] + 32 * 4
        return made.at(at, id_.to_bytes(2, "little")).at(at + 8, name.ljust(24, b"\0")).sealed()

    return make


def claiming_all(alter: Alter = leave) -> Patch:
    """One voxel in a block of 256^3 that claims all 2^24; all but the octree are constants."""
    header = BlockFileHeader(256, 12, 1, 8, IDENTITY, (0.0,) * 3 + (256.0,) * 3)
    block = Block(
        np.zeros(1, np.uint32), np.full(1, 63, np.uint8), np.full((1, 2), 1023, np.uint16),
        np.zeros((1, 4), np.uint8), np.ones(1, np.uint32),
    )  # fmt: skip

    def claim(rows: Rows) -> Rows:
        rows["count"], rows["high"] = FULL, 255
        for spec in [*column_specs(header.normal_bits).values()][1:5]:
            rows[spec.name]["raw"] = spec.raw_bytes(FULL)
        return rows

    return Patch(file_bytes(Scene(header, {(0, 0): block}), alter=alter, alter_rows=claim))


def replaced(name: str, raw: bytes) -> Alter:
    """Another raw column in place of the one that is written, as one LZ4 block."""
    data = lz4.block.compress(raw, store_size=False)

    def alter(_: int, __: int, encoded: dict[str, EncodedColumn]) -> None:
        column = EncodedColumn(data, len(raw), crc32(data), 0, CODEC_LZ4, 0, 0)
        encoded[name] = column

    return alter


def full_block() -> bytes:
    """All 2^24 voxels of a block of 256^3: 2.4 MB of octree in 9 kB, all else constant."""
    nodes = sum(8**level for level in range(8))
    return claiming_all(replaced("occupancy", b"\xff" * nodes)).sealed()


def claimed_full(**occupancy: int) -> Callable[[], bytes]:
    """2^24 voxels claimed for an octree of one."""

    def make() -> bytes:
        made = claiming_all()
        for field, value in occupancy.items():
            made.entry(0, field, value, "occupancy")
        return made.sealed()

    return make


def zeros_of_64_mib() -> bytes:
    """A weight column of 64 MiB of zeros in 263 kB, the most that LZ4 can do."""
    return claiming_all(replaced("weight", bytes(4 * FULL))).sealed()


def overlapping() -> bytes:
    """Every block's weights are those of the first block."""
    made = patch()
    for field in ("offset", "stored", "crc"):
        made.entries["weight"][field][:] = made.entries["weight"][field][0]
    return made.sealed()


def in_the_directory() -> bytes:
    made = patch()
    return resealed(made.entry(0, "offset", int(made.page_records[0, 2]), "normal"))


def two_pages_in_one() -> bytes:
    made = Patch(tiny_file(paging=Paging(1)))
    made.page_records[1] = made.page_records[0]
    return made.sealed()


BLOCKS = (
    Bomb("a head of 4 GiB", lambda: bytes(patch().at(28, u4(U32)).data), "GSB-0103"),
    Bomb("a head of 0 bytes", lambda: bytes(patch().at(28, u4(0)).data), "GSB-0103"),
    Bomb("a file of 2^63 bytes", head(32, u8(U63)), "GSB-0102"),
    Bomb("a file of 2^64 - 1 bytes", head(32, u8(U64)), "GSB-0102"),
    Bomb("a file of 0 bytes", head(32, u8(0)), "GSB-0102"),
    Bomb("2^63 blocks", head(216, u8(U63)), "GSB-0105"),
    Bomb("2^24 blocks", head(216, u8(2**24)), "GSB-0203"),
    Bomb("2^32 - 1 pages", head(232, u4(U32)), "GSB-0105"),
    Bomb("no pages", head(232, u4(0)), "GSB-0206"),
    Bomb("a page table of depth 255", head(236, b"\xff"), "GSB-0105"),
    Bomb("a page table of depth 2 that has pages", head(236, b"\2"), "GSB-0206"),
    Bomb("255 sections", head(238, b"\xff"), "GSB-0201"),
    Bomb("no sections", head(238, b"\0"), "GSB-0201"),
    Bomb("255 columns", head(237, b"\xff"), "GSB-0204"),
    Bomb("no columns", head(237, b"\0"), "GSB-0204"),
    Bomb("an opening run of 2^63 bytes", head(224, u8(U63)), "GSB-0310"),
    Bomb("a resolution of 2^32 - 1", head(56, u4(U32)), "GSB-0105"),
    Bomb("255 levels", head(61, b"\xff"), "GSB-0105"),
    Bomb("17 levels, and rows for 2", head(61, b"\x11"), "GSB-0203"),
    Bomb("blocks of 2^255 voxels", head(62, b"\xff"), "GSB-0105"),
    Bomb("blocks of 256^3 in bytes of 8^3", head(62, b"\x08"), "GSB-0203"),
    Bomb("a resolution of 1 with many blocks", head(56, u4(1)), "GSB-0305"),
    Bomb("a matrix of NaN", head(72, struct.pack("<12d", *[np.nan] * 12)), "GSB-0106"),
    Bomb("a matrix of zeros", head(72, bytes(96)), "GSB-0106"),
    Bomb("a matrix whose volume overflows", head(72, struct.pack("<d", 1e308)), "GSB-0106"),
    Bomb("a section of 2^63 bytes", section_row(0, 16, u8(U63)), "GSB-0201"),
    Bomb("a section that wraps around 2^64", section_row(1, 8, u8(U64 - 15)), "GSB-0201"),
    Bomb("metadata over the level table", section_row(3, 8, u8(384)), "GSB-0201"),
    Bomb(
        "a section of 2^63 bytes behind the body",
        section_row(4, 16, u8(U63), extra=[(b"note", b"hello")]),
        "GSB-0201",
    ),
    Bomb(
        "a section behind the body that takes the whole body",
        section_row(4, 8, u8(484) + u8(2400), extra=[(b"note", b"hello")]),
        "GSB-0201",
    ),
    Bomb("2^64 - 1 blocks in a level", in_section("LEVL", 0, u8(U64)), "GSB-0203"),
    Bomb("2^64 - 1 voxels in a level", in_section("LEVL", 8, u8(U64)), "GSB-0602 GSB-0203"),
    Bomb("a column named after a field of the entry", named(b"key"), "valid"),
    Bomb("a column with the name of another", named(b"mask"), "GSB-0204"),
    Bomb("a column whose name clears the screen", named(b"\x1b[2J\n\r\x07"), "valid"),
    Bomb("a column whose name is no UTF-8", named(b"\xff\xfe"), "GSB-0204"),
    Bomb("a column with a zero in its name", named(b"a\0b"), "valid"),
    Bomb("columns in falling order", named(b"x", 2), "GSB-0204"),
    Bomb("2^32 - 1 rows in a page", in_section("PAGE", 4, u4(U32)), "GSB-0206"),
    Bomb("a page of 4 GiB", in_section("PAGE", 24, u4(U32)), "GSB-0206"),
    Bomb("a page at 2^63", in_section("PAGE", 16, u8(U63)), "GSB-0206"),
    Bomb("a page that wraps around 2^64", in_section("PAGE", 16, u8(U64 - 15)), "GSB-0206"),
    Bomb("a page in the head", in_section("PAGE", 16, u8(0)), "GSB-0206"),
    Bomb("one page listed twice", two_pages_in_one, "GSB-0206"),
    Bomb("a table page that lists itself", paged(loop), "GSB-0312"),
    Bomb("a table page listed twice", paged(second_loop), "GSB-0312"),
    Bomb("2^32 - 1 voxels in a block", entry(0, "count", U32), "GSB-0409"),
    Bomb("key 2^63", entry(-1, "key", U63), "GSB-0305"),
    Bomb("key 2^48", entry(-1, "key", 2**48), "GSB-0303"),
    Bomb("one key twice", lambda: patch().entry(2, "key", 0).sealed(), "GSB-0303"),
    Bomb("a block of level 255", entry(0, "level", 255), "GSB-0302"),
    Bomb("eight children that are not there", entry(0, "children", 254), "GSB-0306"),
    Bomb("no children above level 0", entry(0, "children", 0), "GSB-0306"),
    Bomb("bounds from 255 to 255", entry(1, "high", 255), "GSB-0305"),
    Bomb("a block in state 255", entry(1, "state", 255), "GSB-0305"),
    Bomb("stored bytes at 2^63", entry(0, "offset", U63, "normal"), "GSB-0311"),
    Bomb("stored bytes that wrap around 2^64", entry(0, "offset", U64 - 7, "normal"), "GSB-0311"),
    Bomb("4 GiB of stored bytes", entry(0, "stored", U32, "normal"), "GSB-0311"),
    Bomb("blocks that share their stored bytes", overlapping, "GSB-0311"),
    Bomb("a column stored in the directory", in_the_directory, "GSB-0312"),
    Bomb("a raw column of 4 GiB", entry(0, "raw", U32, "normal"), "GSB-0311"),
    Bomb("a raw column of 64 MiB", entry(0, "raw", 64 << 20, "normal"), "GSB-0402"),
    Bomb("an octree of 64 MiB", entry(0, "raw", 64 << 20, "occupancy"), "GSB-0402"),
    Bomb("2^24 voxels of 8^3", entry(0, "count", FULL), "GSB-0409"),
    Bomb("2^24 voxels in an octree of one", claimed_full(), "GSB-0408"),
    Bomb("an octree of 64 MiB in a few bytes", claimed_full(raw=64 << 20), "GSB-0401"),
    Bomb("an octree of 128 MiB", claimed_full(raw=128 << 20), "GSB-0311"),
    Bomb("64 MiB of zeros", zeros_of_64_mib, "GSB-0408"),
    Bomb(
        "LZ4: a length without end", stored(0, "normal", b"\xff" * 30, codec=CODEC_LZ4), "GSB-0401"
    ),
    Bomb(
        "LZ4: a match before the start",
        stored(0, "normal", b"\x10\0\xff\xff", codec=CODEC_LZ4),
        "GSB-0401",
    ),
    Bomb(
        "LZ4: a match at distance 0",
        stored(0, "normal", b"\x1f\0\0\0\xff\xff", codec=CODEC_LZ4),
        "GSB-0401",
    ),
    Bomb("LZ4: a stream of one byte", column(0, "normal", stored=1), "GSB-0312"),
    Bomb("an octree node without a child", stored(0, "occupancy", b"\0"), "GSB-0407"),
    Bomb("an octree that never ends", stored(0, "occupancy", b"\xff" * 3), "GSB-0408"),
    Bomb("codec 255", entry(0, "codec", 255, "normal"), "valid"),
    Bomb("filter 255", entry(0, "filter", 255, "normal"), "valid"),
    Bomb("occupancy of codec 255", entry(0, "codec", 255, "occupancy"), "valid"),
    Bomb("a constant octree", entry(0, "codec", CODEC_CONSTANT, "occupancy"), "GSB-0311"),
    Bomb("brackets 12 288 deep", meta(b"[" * 12_000), "GSB-0205"),
    Bomb("objects 2000 deep", ledger(b'{"a":' * 2000 + b"1" + b"}" * 2000), "GSB-0205"),
    Bomb(
        "a ledger that is there twice", meta(b'{"ledger":{},"ledger":{"voxels":[1]}}'), "GSB-0205"
    ),
    Bomb(
        "an array 900 deep for a counter",
        ledger(b'{"voxels":' + b"[" * 900 + b"]" * 900 + b"}"),
        "GSB-0205",
    ),
    Bomb(
        "a counter of 4000 digits",
        ledger(b'{"triangles":' + b"9" * 4000 + b"}"),
        "GSB-0602 GSB-0601",
    ),
    Bomb("a counter of 9000 digits", ledger(b'{"triangles":' + b"9" * 9000 + b"}"), "GSB-0205"),
    Bomb("a counter of 1e999", ledger(b'{"triangles":1e999}'), "GSB-0205"),
    Bomb("1e999 beside the ledger", meta(b'{"a":1e999,"ledger":{"voxels":[1]}}'), "GSB-0205"),
    Bomb("a counter that is true", ledger(b'{"triangles":true}'), "GSB-0603"),
    Bomb("half a surrogate pair", meta(b'{"units":"\\ud800","ledger":{"voxels":[1]}}'), "GSB-0205"),
    Bomb(
        "units that clear the screen",
        meta(b'{"units":"\\u001b[2J\\n","ledger":{"voxels":[1]}}'),
        "valid",
    ),
    Bomb("counters that clear the screen", ledger(b'{"\\u001b[2J\\n":"\\u001b[2J"}'), "GSB-0603"),
)


def stream(**changes: object) -> Callable[[], bytes]:
    return lambda: replace(SMALLEST, **changes).write()


def chunk(**changes: object) -> Callable[[], bytes]:
    return lambda: with_chunk(**changes).write()


def part(**changes: object) -> Callable[[], bytes]:
    return lambda: with_part(**changes).write()


def index(data: bytes, raw: int, **fields: int) -> Callable[[], bytes]:
    """The indexed stream with another index part."""
    return lambda: with_fan_index(PartBytes(0, 1, data, raw, **fields)).write()


def tail(place: int, value: int) -> Callable[[], bytes]:
    def edit(numbers: list[int]) -> list[int]:
        return [*numbers[:place], value, *numbers[place + 1 :]]

    return stream(edit_tail=edit)


def row(at: int, value: bytes) -> Callable[[], bytes]:
    return stream(edit_rows=lambda rows: rows[:at] + value + rows[at + len(value) :])


def totals(text: bytes) -> Callable[[], bytes]:
    return stream(totals=text)


def two_chunks_in_one() -> bytes:
    """Two rows of the directory for the one chunk, as long as needed to leave no gap."""
    file = replace(SMALLEST, chunk_count=2, edit_rows=lambda rows: rows + rows)
    return file.write()


def wrapping_rows() -> bytes:
    """Two rows whose lengths lead beyond 2^64 and back to where the first began."""
    start = len(SMALLEST.header())

    def edit(rows: bytes) -> bytes:
        return rows[:8] + u4(U32) + rows[12:] + u8(start + U32) + rows[8:]

    return replace(SMALLEST, chunk_count=2, edit_rows=edit).write()


def most_triangles() -> StreamBytes:
    """65 536 triangles on one vertex in some 300 bytes of edge codes."""
    codes = bytes([255]) + bytes([1]) * 65_535
    extra = np.zeros(65_538, np.uint16)
    extra[1:] = 1
    extra[0] = 0
    raw = codes + extra.astype("<u2").view(np.uint8).reshape(-1, 2).T.tobytes()
    parts = (
        PartBytes(0, 1, lz4.block.compress(raw, store_size=False), len(raw), filter=6, codec=1),
        PartBytes(1, 0, bytes(12)),
    )
    chunk = replace(
        FAN_CHUNK, parts=parts, triangles=65_536, vertices=1, degenerate=65_536, non_finite=0,
        box=(0.0,) * 6,
    )  # fmt: skip
    sources = (counters(65_536, 65_536, 0, 65_536),)
    return replace(SMALLEST, chunks=(chunk,), sources=sources, box=((0.0,) * 3, (0.0,) * 3))


ZEROS = lz4.block.compress(bytes(64 << 20), store_size=False)
NESTED = b'{"a":' * 170_000 + b"1" + b"}" * 170_000
COUNTERS = b'{"read":1,"stored":1,"non_finite":0,"degenerate":0,"name":"%s"}'

STREAMS = (
    Bomb("65 535 attributes", stream(attribute_count=65_535), "GST-0004"),
    Bomb("metadata 10^6 deep", stream(metadata=b"[" * 10**6), "GST-0007"),
    Bomb("objects 170 000 deep", stream(metadata=NESTED), "GST-0007"),
    Bomb("metadata of 5000 digits", stream(metadata=b'{"a":' + b"9" * 5000 + b"}"), "GST-0007"),
    Bomb("metadata of 1e999", stream(metadata=b'{"a":1e999}'), "GST-0007"),
    Bomb("a key of the metadata twice", stream(metadata=b'{"a":1,"a":2}'), "GST-0007"),
    Bomb("metadata that clears the screen", stream(metadata=b'{"units":"\\u001b[2J"}'), "valid"),
    Bomb("half a surrogate pair in a stream", stream(metadata=b'{"units":"\\udfff"}'), "GST-0007"),
    Bomb("an attribute twice", stream(attributes=(POSITION, POSITION)), "GST-0006"),
    Bomb(
        "an attribute of 255 components", stream(attributes=((1, 4, 255, b"position"),)), "GST-0006"
    ),
    Bomb(
        "an attribute that clears the screen",
        stream(attributes=(POSITION, (900, 9, 255, b"\x1b[2J\n"))),
        "valid",
    ),
    Bomb("2^32 - 1 triangles", chunk(triangles=U32), "GST-0104"),
    Bomb("2^32 - 1 vertices", chunk(vertices=U32), "GST-0104"),
    Bomb("3 x triangles = 2^32 + vertices", chunk(triangles=0x55555556, vertices=2), "GST-0104"),
    Bomb("65 536 triangles of nothing", chunk(triangles=65_536, vertices=196_608), "GST-0104"),
    Bomb("a payload of 4 GiB", chunk(payload=U32), "GST-0105"),
    Bomb("65 535 parts", chunk(part_count=65_535), "GST-0104"),
    Bomb("no parts", chunk(parts=()), "GST-0108"),
    Bomb("source 2^32 - 1", chunk(source=U32), "GST-0210"),
    Bomb("2^32 - 1 non-finite triangles", chunk(non_finite=U32), "GST-0210"),
    Bomb("indices of 65 535 bytes", chunk(index_bytes=65_535), "GST-0107"),
    Bomb("a part of 4 GiB", part(raw=U32), "GST-0104"),
    Bomb("a part of 64 MiB", part(raw=64 << 20), "GST-0107"),
    Bomb("64 MiB of zeros for 36 bytes", part(stored=ZEROS, raw=64 << 20, codec=1), "GST-0107"),
    Bomb("64 MiB of zeros called 36 bytes", part(stored=ZEROS, raw=36, codec=1), "GST-0113"),
    Bomb("a corner delta without indices", part(filter=5), "GST-0107"),
    Bomb("NaN for a position", part(stored=b"\xff" * 36), "GST-0117"),
    Bomb("LZ4: no end of a length", part(stored=b"\xff" * 40, raw=36, codec=1), "GST-0113"),
    Bomb("LZ4: nothing", part(stored=b"", raw=36, codec=1), "GST-0113"),
    Bomb("edges that are not there", index(bytes([42] * 4), 4, filter=6), "GST-0114"),
    Bomb("edges without extras", index(b"\xff" * 4, 4, filter=6), "GST-0114"),
    Bomb("extras without edges", index(bytes(4 + 24), 28, filter=6), "GST-0114"),
    Bomb("indices below the first vertex", index(b"\xff" * 24, 24, filter=3), "GST-0114"),
    Bomb("vertex 65 535 of 5", index(b"\xff" * 24, 24), "GST-0112"),
    Bomb("an even edge code behind the last vertex", lambda: full_chunk(0, 0).write(), "GST-0114"),
    Bomb("a constant index", index(b"\0\0", 2, codec=2), "GST-0116"),
    Bomb("65 536 triangles in 1 kB", lambda: most_triangles().write(), "valid"),
    Bomb("2^32 - 1 chunks", stream(chunk_count=U32), "GST-0212"),
    Bomb("2^24 chunks in one row", stream(chunk_count=2**24), "GST-0206"),
    Bomb("one chunk listed twice", two_chunks_in_one, "GST-0208"),
    Bomb("a chunk at 2^63", row(0, u8(U63)), "GST-0208"),
    Bomb("a chunk of 4 GiB", row(8, u4(U32)), "GST-0208"),
    Bomb("chunks that lead around 2^64", wrapping_rows, "GST-0208"),
    Bomb("a chunk that is the directory", row(0, u8(36)), "GST-0208"),
    Bomb("totals 10^6 deep", totals(b"[" * 10**6), "GST-0209"),
    Bomb("totals of 4 MiB and a byte", totals(b"[]".ljust((4 << 20) + 1)), "GST-0212"),
    Bomb("totals without sources", totals(b"{}"), "GST-0209"),
    Bomb("sources that are a number", totals(b'{"sources":5}'), "GST-0209"),
    Bomb("sources that are numbers", totals(b'{"sources":[5]}'), "GST-0209"),
    Bomb("sources that are texts", totals(b'{"sources":[{"read":"x"}]}'), "GST-0209"),
    Bomb("200 000 sources", totals(b'{"sources":[' + b"{}," * 200_000 + b"{}]}"), "GST-0209"),
    Bomb(
        "a source that clears the screen",
        totals(b'{"box":[[0,0,0],[1,2,0]],"sources":[' + COUNTERS % b"\\u001b[2J\\n" + b"]}"),
        "valid",
    ),
    Bomb("a tail of 2^63 bytes", tail(0, U63), "GST-0203"),
    Bomb("a directory at 2^64 - 1", tail(1, U64), "GST-0204"),
    Bomb("a directory of 2^63 bytes", tail(2, U63), "GST-0204"),
    Bomb("a directory in the header", tail(1, 0), "GST-0204"),
    Bomb("a file that is its magic", lambda: SMALLEST.write()[:12], "GST-0002"),
    Bomb(
        "a header with two tails",
        lambda: SMALLEST.write()[:36] + SMALLEST.write()[-48:] * 2,
        "GST-0003",
    ),
)

BOMBS = BLOCKS + STREAMS
