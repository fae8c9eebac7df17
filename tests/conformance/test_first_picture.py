"""The first picture of every vector takes the first 64 KiB and the opening run, no byte more."""

from pathlib import Path

import numpy as np
import pytest

import gstream

VECTORS = sorted((Path(__file__).parents[2] / "spec" / "vectors" / "good").glob("*.gsb"))


def first_picture(data: bytes) -> list[np.ndarray]:
    """Every column of every block of the coarsest level."""
    with gstream.open(lambda at, length: data[at : at + length]) as file:
        views = file.blocks(file.levels - 1)
        return [view.column(name) for view in views for name in file.columns]


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_the_coarsest_level_needs_only_the_head_which_is_in_64_kib_and_the_opening_run(path):
    whole = path.read_bytes()
    head, opening = (int.from_bytes(whole[at : at + n], "little") for at, n in ((28, 4), (224, 8)))
    assert head <= 65_536
    end = head + opening
    blanked = whole[:end] + bytes(len(whole) - end)
    for found, wanted in zip(first_picture(blanked), first_picture(whole), strict=True):
        np.testing.assert_array_equal(found, wanted)
