"""The first picture of every vector takes the first 64 KiB and the opening run, no byte more."""

from itertools import islice
from pathlib import Path
from struct import unpack_from

import numpy as np
import pytest

import gstream
from gstream.formats.columns import COLUMN_NAMES

VECTORS = sorted((Path(__file__).parents[2] / "spec" / "vectors" / "good").glob("*.gsb"))


def blocks_of_page_0(data: bytes) -> int | None:
    """How many it lists; None at depth 2, where the coarsest level of every vector fits in it."""
    (page_table,) = unpack_from("<Q", data, 256 + 2 * 32 + 8)
    has_one = data[236] == 1 and any(data[232:236])
    return int(unpack_from("<I", data, page_table + 4)[0]) if has_one else None


def first_picture(data: bytes) -> list[np.ndarray]:
    """Every known column of the blocks of the coarsest level that page 0 lists."""
    with gstream.open(lambda at, length: data[at : at + length]) as file:
        views = islice(file.blocks(file.levels - 1), blocks_of_page_0(data))
        known = [name for name in file.columns if name in COLUMN_NAMES]
        return [view.column(name) for view in views for name in known]


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_the_coarsest_level_needs_only_the_head_which_is_in_64_kib_and_the_opening_run(path):
    whole = path.read_bytes()
    head, opening = unpack_from("<I", whole, 28)[0], unpack_from("<Q", whole, 224)[0]
    assert head <= 65_536
    end = head + opening
    blanked = whole[:end] + bytes(len(whole) - end)
    for found, wanted in zip(first_picture(blanked), first_picture(whole), strict=True):
        np.testing.assert_array_equal(found, wanted)
