"""What gstream writes, decoded by the tables of spec/stream.md with struct, zlib and lz4."""

import json
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import lz4.block
import numpy as np

from gstream.formats.stream import (
    COLOUR,
    NORMAL,
    POSITION_F4,
    POSITION_F8,
    Chunk,
    StreamReader,
    StreamWriter,
    encode_chunk,
)

MAGIC = bytes.fromhex("89 47 53 54 20 31 2E 30 0D 0A 1A 0A")
WIDTHS = {1: 1, 2: 2, 3: 4, 4: 4, 5: 8}  # bytes of a component, by dtype code


def decode(data: bytes) -> dict:
    """The whole file, by the tables alone; any surprise raises."""
    numbers = struct.unpack("<QQQIII12s", data[-48:])
    length, at, directory_bytes, directory_crc, header_crc, tail_crc, magic = numbers
    assert magic == MAGIC == data[:12]
    assert length == len(data)
    assert zlib.crc32(data[-48:-16]) == tail_crc
    directory = data[at : at + directory_bytes]
    assert zlib.crc32(directory) == directory_crc
    head = struct.unpack("<12sHHIIIHHI", data[:36])
    descriptors, end = {}, 36
    for _ in range(head[6]):
        id_, dtype, components, zero, name = struct.unpack("<HBBI24s", data[end : end + 32])
        assert zero == 0
        descriptors[id_] = (name.rstrip(b"\0").decode(), WIDTHS[dtype], components)
        end += 32
    metadata = json.loads(data[end : end + head[8]])
    end += head[8]
    assert zlib.crc32(data[:end]) == header_crc == int.from_bytes(data[end : end + 4], "little")
    magic, count, text, zero = struct.unpack("<4sIII", directory[:16])
    assert (magic, zero) == (b"GDIR", 0)
    totals = json.loads(directory[16 + 72 * count :])
    assert len(directory) == 16 + 72 * count + text
    chunks, end = [], end + 4
    for i in range(count):
        row = struct.unpack("<QIIII6d", directory[16 + 72 * i : 88 + 72 * i])
        assert row[0] == end
        chunks.append(decode_chunk(data[end : end + row[1]], descriptors))
        end += row[1]
    assert end == at
    return {"metadata": metadata, "totals": totals, "chunks": chunks}


def decode_chunk(data: bytes, descriptors: dict) -> dict:
    head = struct.unpack("<4sHHIIIIII6d", data[:80])
    magic, _, parts, triangles, vertices, source, payload, non_finite, degenerate, *box = head
    end = 80 + 20 * parts
    assert magic == b"CHNK"
    assert zlib.crc32(data[:end]) == int.from_bytes(data[end : end + 4], "little")
    at = end + 4
    assert len(data) == at + payload
    counts = {0: vertices, 1: 3 * triangles, 2: triangles, 3: 1}
    found = {"source": source, "box": box, "counters": (non_finite, degenerate)}
    for i in range(parts):
        record = struct.unpack("<HBBBBHIII", data[80 + 20 * i : 100 + 20 * i])
        id_, domain, filter_, codec, zero, zeros, stored, raw, crc = record
        assert (zero, zeros) == (0, 0)
        part = data[at : at + stored]
        assert zlib.crc32(part) == crc
        at += stored
        name, width, components = descriptors[id_] if id_ else ("index", 2, 1)
        if codec == 1:
            part = lz4.block.decompress(part, uncompressed_size=raw)
        assert len(part) == raw
        if filter_ == 6:
            found[name] = [[vertex] for vertex in undo_edges(part, triangles, vertices)]
            continue
        if codec == 2:
            part *= counts[domain]
        shape = (counts[domain], components)
        found[name] = undo(part, shape, width, filter_, found.get("index"))
    return found


def undo(data: bytes, shape: tuple[int, int], width: int, filter_: int, index) -> list:
    """Rows of unsigned integers: the bits of the values."""
    rows, components = shape
    if filter_ == 0:
        flat = [int.from_bytes(data[i : i + width], "little") for i in range(0, len(data), width)]
        return [flat[components * i : components * (i + 1)] for i in range(rows)]

    def planed(row: int, component: int) -> int:
        return sum(data[(component * width + b) * rows + row] << 8 * b for b in range(width))

    if filter_ == 3:
        mark, found = 0, []
        for row in range(rows):
            code = planed(row, 0)
            found.append([(mark - code) % 65536])
            mark += code == 0 and mark < 65536
        return found
    bases = [row - 1 for row in range(rows)]
    if filter_ in (4, 5):
        seen = set()
        for corner, (vertex,) in enumerate(index):
            if vertex not in seen:
                first = corner - corner % 3
                others = [index[first + k][0] for k in range(3) if index[first + k][0] < vertex]
                bases[vertex] = max(others, default=vertex - 1)
                seen.add(vertex)
    modulus, half = 1 << 8 * width, 1 << 8 * width - 1
    codes: list[list[int]] = []
    for row in range(rows):
        before = codes[bases[row]] if bases[row] >= 0 else [0] * components
        zigzag = [planed(row, c) for c in range(components)]
        steps = [z // 2 if z % 2 == 0 else -(z + 1) // 2 for z in zigzag]
        codes.append([(b + s) % modulus for b, s in zip(before, steps, strict=True)])
    if filter_ in (1, 4):
        return codes
    assert filter_ in (2, 5)
    return [[c - half if c >= half else modulus - 1 - c for c in row] for row in codes]


def undo_edges(data: bytes, triangles: int, vertices: int) -> list[int]:
    """Section 5.3: the vertex of each corner."""
    edges: list[tuple[int, int]] = []
    mark, found = 0, []
    count = (len(data) - triangles) // 2
    halves = data[triangles : triangles + count], data[triangles + count :]
    numbers = iter([low | high << 8 for low, high in zip(*halves, strict=True)])

    def take(number: int) -> int:
        nonlocal mark
        vertex = (mark - number) % 65536
        mark += number == 0 and mark < vertices
        return vertex

    for code in data[:triangles]:
        if code == 255:
            a, b, c = take(next(numbers)), take(next(numbers)), take(next(numbers))
            found += [a, b, c]
            edges.append((b, a))
        else:
            a, b = edges[-1 - code // 6]
            c = take(next(numbers) if code % 2 else 0)
            corners = {code // 2 % 3: a, (code // 2 + 1) % 3: b, (code // 2 + 2) % 3: c}
            found += [corners[k] for k in range(3)]
        edges += [(c, b), (a, c)]
    assert next(numbers, None) is None
    assert mark == vertices
    return found


def bits(array: np.ndarray) -> list:
    return np.ascontiguousarray(array).view(f"<u{array.itemsize}").tolist()


def written(path: Path, chunks: list[Chunk], lz4_mode: str) -> bytes:
    with open(path, "wb") as file:
        writer = StreamWriter(
            file, [POSITION_F4, POSITION_F8, NORMAL, COLOUR], {"units": "mm", "crs": None}
        )
        for chunk in chunks:
            writer.add_chunk(encode_chunk(chunk, lz4_mode))
        writer.finish({"sources": []})
    return path.read_bytes()


def sheet(random: np.random.Generator, dtype: type) -> Chunk:
    """A rough height field of 17 x 17 vertices in order of first use."""
    x, y = np.meshgrid(np.arange(17.0), np.arange(17.0))
    points = np.stack([x, y, random.normal(size=(17, 17))], axis=2).reshape(-1, 3) - 8
    corner = (17 * np.arange(16)[:, None] + np.arange(16)).ravel()
    quads = np.stack([corner, corner + 1, corner + 18, corner, corner + 18, corner + 17], axis=1)
    used, first, place = np.unique(quads.ravel(), return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    order = used[np.argsort(first)]
    triangles = rank[place].reshape(-1, 3).astype(np.uint16)
    normals = random.normal(size=(len(order), 3)).astype(np.float32)
    colours = random.integers(90, 99, (len(order), 4), np.uint8)
    return Chunk(points[order].astype(dtype), triangles, normals, colours, source=2, non_finite=9)


def index_parts(path: Path) -> list:
    reader = StreamReader(path)
    parts = [part for i in range(len(reader.chunks)) for part in reader.head(i).parts]
    return [part for part in parts if part.attribute == 0]


def test_the_tables_of_the_spec_decode_what_gstream_writes(tmp_path):
    random = np.random.default_rng(5)
    soup = Chunk(
        random.normal(size=(30, 3)).astype(np.float32), colours=np.full((30, 4), 7, np.uint8)
    )
    shuffled = sheet(random, np.float32)
    scattered = random.permutation(shuffled.triangles)
    first = np.argsort(np.unique(scattered.ravel(), return_index=True)[1])
    scattered = replace(
        shuffled,
        positions=shuffled.positions[first],
        triangles=np.argsort(first).astype(np.uint16)[scattered],
        normals=shuffled.normals[first],
        colours=shuffled.colours[first],
    )
    chunks = [shuffled, sheet(random, np.float64), scattered, soup]
    for mode in ("fast", "hc"):
        data = written(tmp_path / "a.gst", chunks, mode)
        assert [part.filter for part in index_parts(tmp_path / "a.gst")] == [6, 6, 3]
        found = decode(data)
        assert found["metadata"] == {"units": "mm", "crs": None}
        for chunk, decoded in zip(chunks, found["chunks"], strict=True):
            assert decoded["position"] == bits(chunk.positions)
            assert decoded["colour"] == chunk.colours.tolist()
            assert decoded["source"] == chunk.source
            if chunk.triangles is not None:
                assert decoded["index"] == chunk.triangles.reshape(-1, 1).tolist()
                assert decoded["normal"] == bits(chunk.normals)
            low, high = chunk.positions.min(axis=0), chunk.positions.max(axis=0)
            assert decoded["box"] == [*low.tolist(), *high.tolist()]


def test_the_good_vectors_decode_by_the_tables_of_the_spec():
    vectors = Path(__file__).parents[2] / "spec" / "vectors" / "good"
    for path in sorted(vectors.glob("stream-*.gst")):
        if "unknown" not in path.name:
            assert "sources" in decode(path.read_bytes())["totals"]


def test_the_smallest_file_is_the_dump_printed_in_the_spec():
    root = Path(__file__).parents[2] / "spec"
    dump = (root / "stream.md").read_text().split("## 13.")[1].split("```")[1]
    printed = bytes.fromhex("".join(line[4:] for line in dump.strip().splitlines()))
    assert printed == (root / "vectors" / "good" / "stream-smallest.gst").read_bytes()
