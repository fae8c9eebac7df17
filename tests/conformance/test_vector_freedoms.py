"""The good vectors use every way of storing a column or part that the specs allow."""

from itertools import product
from pathlib import Path
from struct import unpack_from

import numpy as np
from conformance.stream_bytes import FAN
from conformance.stream_every_filter import COLOURS, EVERY_FILTER, NORMALS, TRIANGLES
from damaged_block_files import GOOD

from gstream.formats.stream import StreamReader

VECTORS = Path(__file__).parents[2] / "spec" / "vectors" / "good"
STREAM = VECTORS / "stream-every-filter.gst"
OCCUPANCY, COLOUR, LAST = 1, 4, 7  # column ids
ALLOWED = (
    {(OCCUPANCY, codec, 0) for codec in (0, 1)}
    | set(product(range(2, LAST + 1), (0, 1), range(5)))
    | {(COLOUR, codec, 5) for codec in (0, 1)}
    | {(column, 2, 0) for column in range(2, LAST + 1)}
)


def ways_of(data: bytes) -> set[tuple[int, int, int]]:
    """(column, codec, filter) of every column record of a file of depth 1."""
    assert data[236] == 1
    columns = data[237]
    size = 24 + 32 * columns
    (_, colm, _), (_, page, rows) = (unpack_from("<8sQQ", data, at) for at in (288, 320))
    ids = [unpack_from("<H", data, colm + 32 * i)[0] for i in range(columns)]
    found = set()
    for row in range(page, page + rows, 32):
        count, _, offset = unpack_from("<IQQ", data, row + 4)
        for entry in range(offset, offset + count * size, size):
            if data[entry + 13] == 1:
                codecs = data[entry + 48 : entry + size : 32], data[entry + 49 : entry + size : 32]
                found |= set(zip(ids, *codecs, strict=True))
    return found


def test_every_column_stands_by_every_codec_and_filter_in_a_good_vector():
    paths = [p for p in VECTORS.glob("*.gsb") if p.stem != "blocks-table-pages"]  # of depth 2
    assert len(paths) == len(GOOD) - 1
    ways = set().union(*(ways_of(path.read_bytes()) for path in paths))
    assert {way for way in ways if way[0] <= LAST} == ALLOWED


def stream_ways_of(data: bytes) -> set[tuple[int, int, int]]:
    """(attribute, filter, codec) of every part of a stream."""
    directory = unpack_from("<Q", data, len(data) - 40)[0]
    found = set()
    for row in range(unpack_from("<I", data, directory + 4)[0]):
        at = unpack_from("<Q", data, directory + 16 + 72 * row)[0]
        for part in range(at + 80, at + 80 + 20 * data[at + 6], 20):
            found.add((data[part], data[part + 3], data[part + 4]))
    return found


def test_every_part_stands_by_every_filter_and_codec_in_a_good_vector():
    floats = product((1, 2, 3), (0, 2, 5), (0, 1))
    colours, indices = product((4,), (0, 1, 4), (0, 1)), product((0,), (0, 3, 6), (0, 1))
    assert {*floats, *colours, *indices} <= stream_ways_of(STREAM.read_bytes())


def test_whatever_filter_and_codec_a_part_took_the_values_are_those_put_in():
    assert STREAM.read_bytes() == EVERY_FILTER.write()
    reader = StreamReader(STREAM)
    for index in range(12):
        chunk = reader.chunk(index)
        wanted = np.array(FAN, chunk.positions.dtype), np.array(NORMALS, np.float32)
        np.testing.assert_array_equal(chunk.positions, wanted[0])
        np.testing.assert_array_equal(chunk.normals, wanted[1])
        assert np.signbit(chunk.normals[3, 0])
        np.testing.assert_array_equal(chunk.colours, COLOURS)
        np.testing.assert_array_equal(chunk.triangles, TRIANGLES)
