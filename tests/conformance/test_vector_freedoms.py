"""The good vectors use every way of storing a column that section 7 of spec/blockfile.md allows."""

from itertools import product
from pathlib import Path
from struct import unpack_from

from damaged_block_files import GOOD

VECTORS = Path(__file__).parents[2] / "spec" / "vectors" / "good"
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
    assert set().union(*(ways_of(path.read_bytes()) for path in paths)) == ALLOWED
