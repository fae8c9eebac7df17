"""The geometry stream: what is written is read back, and a reader reads no more than it must."""

import os
import struct
import zlib

import numpy as np
import pytest
from conformance.stream_bytes import POSITION, SMALLEST, SOUP, ChunkBytes, PartBytes
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gstream.errors import CorruptFileError
from gstream.formats.stream import (
    COLOUR,
    NORMAL,
    POSITION_F4,
    POSITION_F8,
    Chunk,
    StreamReader,
    StreamWriter,
    corners,
    encode_chunk,
)
from gstream.formats.stream_parts import decode_chunk
from gstream.kernels import indexing

ALL = [POSITION_F4, POSITION_F8, NORMAL, COLOUR]
FINITE = {"allow_nan": False, "allow_infinity": False}


def write(path, chunks, metadata=None, lz4="fast", filters=indexing):
    with open(path, "wb") as file:
        writer = StreamWriter(file, ALL, metadata or {})
        for chunk in chunks:
            writer.add_chunk(encode_chunk(chunk, lz4, filters))
        writer.finish({"sources": []})
    return path


def assert_same_chunk(found, chunk):
    for name in ("positions", "triangles", "normals", "colours"):
        ours, theirs = getattr(found, name), getattr(chunk, name)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            assert ours.dtype == theirs.dtype
            assert ours.tobytes() == theirs.tobytes()  # bit for bit: -0.0 stays -0.0
    assert found.colour_domain == (0 if chunk.colours is None else chunk.colour_domain)
    assert (found.source, found.non_finite) == (chunk.source, chunk.non_finite)
    assert found.degenerate == chunk.degenerate


@st.composite
def chunks(draw):
    triangles = None
    if draw(st.booleans()):
        corner_list, used = [], 0
        for _ in range(3 * draw(st.integers(1, 12))):
            corner_list.append(draw(st.integers(0, used)))
            used = max(used, corner_list[-1] + 1)
        triangles, vertices = np.array(corner_list, np.uint16).reshape(-1, 3), used
    else:
        vertices = 3 * draw(st.integers(0, 8))
    count = vertices // 3 if triangles is None else len(triangles)
    dtype, width = draw(st.sampled_from([(np.float32, 32), (np.float64, 64)]))
    numbers = st.floats(width=width, **FINITE)
    normals = st.floats(width=32)  # normals are stored as read, whatever they are
    domain = draw(st.sampled_from([0, 2, 3]))
    rows = {0: vertices, 2: count, 3: 1}[domain]
    return Chunk(
        draw(hnp.arrays(dtype, (vertices, 3), elements=numbers)),
        triangles,
        draw(st.none() | hnp.arrays(np.float32, (vertices, 3), elements=normals)),
        draw(st.none() | hnp.arrays(np.uint8, (rows, 4))),
        domain,
        draw(st.integers(0, 9)),
        draw(st.integers(0, 9)),
        draw(st.integers(0, count)),
    )


@given(chunk=chunks(), lz4=st.sampled_from(["fast", "hc"]))
def test_a_chunk_comes_back_bit_for_bit(chunk, lz4):
    data = encode_chunk(chunk, lz4, indexing)
    assert data == encode_chunk(chunk, lz4)  # the plain filters write the same bytes
    assert_same_chunk(decode_chunk(data, "a.gst", 0), chunk)
    assert_same_chunk(decode_chunk(data, "a.gst", 0, filters=indexing), chunk)


def test_the_smallest_file_is_the_bytes_printed_in_the_spec(tmp_path):
    chunk = Chunk(np.array([[0, 0, 0], [1, 0, 0], [0, 2, -0.0]], np.float32))
    with open(tmp_path / "a.gst", "wb") as file:
        writer = StreamWriter(file, [POSITION_F4], {})
        writer.add_chunk(encode_chunk(chunk, "fast"))
        source = {"name": "a.ply", "read": 1, "stored": 1, "non_finite": 0, "degenerate": 0}
        writer.finish({"sources": [source]})
    assert (tmp_path / "a.gst").read_bytes() == SMALLEST.write()


def test_metadata_keeps_absent_null_and_value_apart(tmp_path):
    path = write(tmp_path / "a.gst", [], {"units": "mm", "crs": None})
    assert StreamReader(path).metadata == {"units": "mm", "crs": None}
    assert "up" not in StreamReader(path).metadata


def test_an_empty_stream_has_no_box(tmp_path):
    reader = StreamReader(write(tmp_path / "a.gst", []))
    assert len(reader.chunks) == 0
    assert reader.box is None


def test_the_box_is_the_exact_box_of_all_stored_vertices(tmp_path):
    random = np.random.default_rng(3)
    parts = [random.normal(size=(30, 3)).astype(np.float32) for _ in range(3)]
    reader = StreamReader(write(tmp_path / "a.gst", [Chunk(part) for part in parts]))
    points = np.concatenate(parts).astype(np.float64)
    assert reader.box == (tuple(points.min(axis=0)), tuple(points.max(axis=0)))
    assert reader.chunks["box"][1, 0].tolist() == parts[1].min(axis=0).tolist()


def test_a_zero_in_a_box_is_positive():
    data = encode_chunk(Chunk(np.full((3, 3), -0.0, np.float32)), "fast")
    assert data[32:80] == bytes(48)


def test_opening_reads_header_directory_and_tail_alone(tmp_path, monkeypatch):
    random = np.random.default_rng(3)
    many = [Chunk(random.normal(size=(3000, 3)).astype(np.float32)) for _ in range(9)]
    path = write(tmp_path / "a.gst", many)
    taken = []
    read = StreamReader.read

    def counting(self, offset, length):
        taken.append(length)
        return read(self, offset, length)

    monkeypatch.setattr(StreamReader, "read", counting)
    reader = StreamReader(path)
    assert sum(taken) < 2000
    taken.clear()
    for index in range(9):
        reader.head(index)
    assert sum(taken) < 9 * 800


def test_attributes_that_are_not_wanted_are_not_unpacked(tmp_path):
    chunk = Chunk(np.eye(3, dtype=np.float32), None, np.eye(3, dtype=np.float32))
    reader = StreamReader(write(tmp_path / "a.gst", [chunk]))
    assert reader.chunk(0, []).normals is None
    assert reader.chunk(0).normals is not None


def test_corners_give_every_domain_three_rows_per_triangle():
    positions = np.arange(12, dtype=np.float32).reshape(4, 3)
    rows = np.array([[0, 1, 2], [0, 2, 3]], np.uint16)
    colours = np.arange(8, dtype=np.uint8).reshape(2, 4)
    points, normals, colour = corners(Chunk(positions, rows, positions, colours, 2))
    np.testing.assert_array_equal(points, positions[rows])
    np.testing.assert_array_equal(normals, positions[rows])
    assert colour.shape == (2, 3, 4)
    assert (colour[1] == colours[1]).all()


def test_offsets_above_4_gib_are_read(tmp_path):
    size = 64 << 20
    hole = PartBytes(900, 0, b"", crc=zlib.crc32(bytes(size)))
    big = ChunkBytes((SOUP.parts[0], hole), payload=36 + size)
    record = struct.pack("<HBBBBHIII", 900, 0, 0, 0, 0, 0, size, size, hole.crc)
    head = big.head()[:100] + record
    head += zlib.crc32(head).to_bytes(4, "little")
    path, length, many = tmp_path / "big.gst", len(head) + 36 + size, 65
    with open(path, "wb") as file:
        file.write(SMALLEST.header())
        rows, at = b"", file.tell()
        for index in range(many + 1):
            file.seek(at)
            last = index == many
            file.write(SOUP.write() if last else head + SOUP.parts[0].stored)
            width = len(SOUP.write()) if last else length
            rows += struct.pack("<QIIII6d", at, width, 1, 3, 0, *SOUP.box)
            at += width
        directory = struct.pack("<4sIII", b"GDIR", many + 1, 2, 0) + rows + b"{}"
        tail = struct.pack(
            "<QQQII", at + len(directory) + 48, at, len(directory), zlib.crc32(directory),
            int.from_bytes(SMALLEST.header()[-4:], "little"),
        )  # fmt: skip
        file.write(
            directory + tail + zlib.crc32(tail).to_bytes(4, "little") + SMALLEST.write()[:12]
        )
    reader = StreamReader(path)
    assert reader.chunks["offset"][-1] > 1 << 32
    assert len(reader.chunk(many).positions) == 3
    assert os.stat(path).st_blocks * 512 < 1 << 20
    assert POSITION[0] == reader.attributes[0].id


@pytest.mark.parametrize("raw", [64 << 20, (64 << 20) + 1, 2**32 - 1])
def test_a_bomb_is_refused_before_anything_is_allocated(tmp_path, raw):
    part = PartBytes(1, 0, b"\0" * 40, raw, filter=2, codec=1)
    path = tmp_path / "bomb.gst"
    chunk = ChunkBytes((part,), triangles=21_845, vertices=65_535)
    path.write_bytes(SMALLEST.__class__((chunk,)).write())
    with pytest.raises(CorruptFileError, match="GST-01"):
        StreamReader(path).chunk(0)


def test_an_lz4_part_cannot_claim_more_than_255_times_its_stored_bytes(tmp_path):
    part = PartBytes(1, 0, b"\0" * 40, 65_535 * 12, filter=2, codec=1)
    path = tmp_path / "bomb.gst"
    chunk = ChunkBytes((part,), triangles=21_845, vertices=65_535)
    path.write_bytes(SMALLEST.__class__((chunk,)).write())
    with pytest.raises(CorruptFileError, match=r"40 stored bytes cannot unpack .* \[GST-0113\]"):
        StreamReader(path).chunk(0)
