"""spec/*.ksy: the compiled parsers read every good vector, field by field, as gstream does."""

import dataclasses
import json
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kaitaistruct import KaitaiStruct
from ksy.compiler import COMPILER, HERE, SOURCES, beginning, compiled
from ksy.gstream_blockfile import GstreamBlockfile
from ksy.gstream_stream import GstreamStream
from node import node

from gstream.blockview import BlockView
from gstream.formats import blockhead, stream
from gstream.formats.framing import BLOCK_MAGIC, STREAM_MAGIC
from gstream.formats.stream import StreamReader
from gstream.formats.stream_chunk import CHUNK_MAGIC, ChunkHead
from gstream.read import BlockFile, open_block_file

GOOD = Path(__file__).parents[2] / "spec" / "vectors" / "good"
BLOCK_FILES = sorted(GOOD.glob("*.gsb"))
STREAMS = sorted(GOOD.glob("*.gst"))


@pytest.mark.parametrize("name", SOURCES)
def test_the_committed_parser_was_made_from_the_ksy_of_today(name):
    assert (HERE / f"{name}.py").read_text().startswith(beginning(name))


@pytest.mark.parametrize("name", SOURCES)
def test_the_committed_parser_is_what_the_compiler_makes(name):
    node()
    if not COMPILER.exists():
        pytest.skip("the Kaitai compiler is missing: cd tests && python -m ksy.compiler install")
    assert (HERE / f"{name}.py").read_text() == compiled(name)


def fields(parsed: Any) -> Any:
    """Everything that a parser has read in sequence, as plain values."""
    if isinstance(parsed, KaitaiStruct):
        return {k: fields(v) for k, v in vars(parsed).items() if k[0] != "_" and k != "is_table"}
    if isinstance(parsed, list):
        return [fields(value) for value in parsed]
    return int(parsed) if isinstance(parsed, IntEnum) else parsed


def row_fields(row: Any) -> dict[str, Any]:
    """A row of one of gstream's tables, as plain values."""
    plain = {}
    for name in row.dtype.names:
        value = row[name]
        if name == "zero":
            plain[name] = value.tobytes()
        else:
            plain[name] = value.decode() if isinstance(value, bytes) else np.ravel(value).tolist()
    return {n: v[0] if isinstance(v, list) and len(v) == 1 else v for n, v in plain.items()}


def head_fields(file: BlockFile, data: bytes) -> dict[str, Any]:
    """The fixed fields, in the order of the file, but for what `tables` has."""
    head, settings = file.head, file.header
    return {
        "magic": BLOCK_MAGIC,
        "min_reader_version": 1,
        "writer_version": int.from_bytes(data[14:16], "little"),
        "incompatible_features": 0,
        "read_only_features": head.read_only_features,
        "ignorable_features": int.from_bytes(data[24:28], "little"),
        "head_bytes": head.head_bytes,
        "file_bytes": head.file_bytes,
        "content_id": head.content_id,
        "resolution": settings.resolution,
        "snap_bits": settings.snap_bits,
        "num_levels": settings.levels,
        "block_log2": settings.block_log2,
        "separability": blockhead.SEPARABILITY[settings.sep],
        "ties": blockhead.TIES[settings.ties],
        "faces": blockhead.FACES[settings.faces],
        "normals": blockhead.NORMALS[settings.normals],
        "lod_weighting": blockhead.WEIGHTING[settings.lod_weighting],
        "normal_bits": settings.normal_bits,
        "zero": bytes(3),
        "matrix": list(settings.matrix),
        "box": list(settings.box),
        "num_blocks": head.blocks,
        "opening_bytes": head.opening_bytes,
        "num_pages": head.pages,
        "depth": head.depth,
        "num_columns": len(head.columns),
        "num_sections": len(blockhead.HEAD_SECTIONS) + len(head.sections),
        "zero2": bytes(17),
        "crc": head.crc,
    }


def entry_fields(row: Any, records: list[str]) -> dict[str, Any]:
    own = row_fields(row[[name for name in row.dtype.names if name not in records]])
    return {**own, "records": [row_fields(row[name]) for name in records]}


@pytest.mark.parametrize("path", BLOCK_FILES, ids=lambda path: path.stem)
def test_the_head_and_its_tables_are_parsed_as_gstream_reads_them(path):
    data = path.read_bytes()
    parsed = GstreamBlockfile.from_bytes(data)
    found = fields(parsed)
    with open_block_file(path) as file:
        head = file.head
        tables = {name: found.pop(name) for name in ("sections", "levels", "columns", "pages")}
        assert json.loads(found.pop("metadata")) == head.metadata
        assert found == head_fields(file, data)
        assert tables["levels"] == [row_fields(row) for row in head.levels]
        assert tables["pages"] == [row_fields(row) for row in head.page_table]
        shapes = [(c.id, c.components, c.bits, c.name, bytes(4)) for c in head.columns]
        names = ("id", "components", "bits", "name", "zero")
        assert tables["columns"] == [dict(zip(names, shape, strict=True)) for shape in shapes]
        assert [row["type"].encode() for row in tables["sections"][:4]] == list(
            blockhead.HEAD_SECTIONS
        )
        for number, row in enumerate(tables["sections"]):
            section = blockhead._parse_section(data, number, str(path))
            wanted = dataclasses.asdict(section) | {"type": section.type.decode()}
            wanted |= {"flags": int(wanted.pop("critical")), "zero": bytes(4)}
            assert row == wanted
        for section, wanted in zip(parsed.sections[4:], head.sections, strict=True):
            assert section.body == file.read_range(wanted.offset, wanted.length)


@pytest.mark.parametrize("path", BLOCK_FILES, ids=lambda path: path.stem)
def test_pages_entries_and_stored_columns_are_parsed_as_gstream_reads_them(path):
    parsed = GstreamBlockfile.from_file(path)
    with parsed._io._io, open_block_file(path) as file:
        directory, records = file.directory, [spec.field for spec in file.head.columns]
        pages = list(parsed.pages)
        if file.head.depth == 2:
            pages = [page for table in pages for page in table.pages]
        assert [fields(page) for page in pages] == [
            row_fields(directory.record(number)) for number in range(directory.count)
        ]
        for number, page in enumerate(pages):
            rows = directory.page(number)
            assert fields(page.entries) == [entry_fields(row, records) for row in rows]
            for entry, row in zip(page.entries, rows, strict=True):
                for name, record in zip(file.columns, entry.records, strict=True):
                    assert record.data == BlockView(file, row).stored(name)


@pytest.mark.parametrize("path", BLOCK_FILES, ids=lambda path: path.stem)
def test_the_tail_is_parsed_as_gstream_writes_it(path):
    data = path.read_bytes()
    tail = fields(GstreamBlockfile.from_bytes(data).tail)
    with open_block_file(path) as file:
        packed = blockhead.pack_tail(file.head, file.head.crc)
    assert tail == {
        "magic": packed[:12],
        "file_bytes": len(data),
        "content_id": packed[20:36],
        "head_crc": int.from_bytes(packed[36:40], "little"),
        "zero": bytes(20),
        "crc": int.from_bytes(packed[60:], "little"),
    }


@pytest.mark.parametrize("path", STREAMS, ids=lambda path: path.stem)
def test_header_directory_and_tail_of_a_stream_are_parsed_as_gstream_reads_them(path):
    data = path.read_bytes()
    parsed = GstreamStream.from_bytes(data)
    found, directory = fields(parsed), fields(parsed.directory)
    reader = StreamReader(path)
    names = (
        "magic", "min_reader_version", "writer_version", "incompatible_features",
        "read_only_features", "ignorable_features", "num_attributes", "zero", "metadata_bytes",
    )  # fmt: skip
    fixed = dict(zip(names, stream.HEADER.unpack_from(data), strict=True))
    assert found.pop("crc") == reader.header_crc
    assert json.loads(found.pop("metadata")) == reader.metadata
    assert found.pop("attributes") == [
        dataclasses.asdict(a) | {"zero": bytes(4)} for a in reader.attributes
    ]
    assert found == fixed | {"magic": STREAM_MAGIC, "zero": bytes(2)}

    assert json.loads(directory.pop("totals")) == reader.totals
    assert directory.pop("rows") == [row_fields(row) for row in reader.chunks]
    names = ("magic", "num_chunks", "totals_bytes", "zero")
    at = parsed.tail.directory_offset
    fixed = dict(zip(names, stream.DIRECTORY.unpack_from(data, at), strict=True))
    assert directory == fixed | {"zero": bytes(4)}

    names = (
        "file_length", "directory_offset", "directory_length", "directory_crc", "header_crc",
        "crc", "magic",
    )  # fmt: skip
    tail = stream.TAIL.unpack(data[-stream.TAIL.size :])
    assert fields(parsed.tail) == dict(zip(names, tail, strict=True))


@pytest.mark.parametrize("path", STREAMS, ids=lambda path: path.stem)
def test_chunks_and_parts_are_parsed_as_gstream_reads_them(path):
    data = path.read_bytes()
    parsed, reader = GstreamStream.from_bytes(data), StreamReader(path)
    assert len(parsed.directory.rows) == len(reader.chunks)
    for number, row in enumerate(parsed.directory.rows):
        found, head = fields(row.chunk), reader.head(number)
        payload = found.pop("payload")
        parts = [dataclasses.asdict(part) | {"zero": bytes(3)} for part in head.parts]
        assert found.pop("parts") == parts
        assert [len(stored) for stored in payload] == [part.stored for part in head.parts]
        assert b"".join(payload) == data[row.offset + head.size :][: head.payload]
        packed = ChunkHead.write(head)
        assert found == {
            "magic": CHUNK_MAGIC,
            "index_bytes": head.index_bytes,
            "num_parts": len(head.parts),
            "triangles": head.triangles,
            "vertices": head.vertices,
            "source": head.source,
            "payload_bytes": head.payload,
            "non_finite": head.non_finite,
            "degenerate": head.degenerate,
            "box": list(head.box),
            "crc": int.from_bytes(packed[-4:], "little"),
        }
