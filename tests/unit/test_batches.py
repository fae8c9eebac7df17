"""Columns of many blocks at once: as of each block alone, and what is wrong with one stays its own.

The oracle is the reader of single blocks in NumPy, which tests/conformance compares with others.
"""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from damaged_block_files import GOOD
from hypothesis import example, given
from hypothesis import strategies as st
from small_block_files import file_bytes, random_scene

from gstream.blockcheck import iter_findings
from gstream.compiled import compiled
from gstream.contentcheck import Content
from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats import batches
from gstream.formats.columns import COLUMN_IDS
from gstream.formats.filters import BIT_PLANES, GREEN_DELTA_BIT_PLANES, NONE
from gstream.formats.framing import CODEC_CONSTANT, CODEC_LZ4, CODEC_RAW
from gstream.read import open_block_file

VECTORS = Path(__file__).parents[2] / "spec" / "vectors"
SCENE = random_scene(64, 4, 12_000, 4)
DATA = file_bytes(SCENE)


def blocks(file, *columns):
    return [view for level in range(file.levels) for view in file.blocks(level, columns)]


@pytest.mark.parametrize("name", GOOD)
def test_columns_that_are_decoded_ahead_are_those_of_each_block_alone(name):
    path = VECTORS / "good" / f"{name}.gsb"
    with open_block_file(path) as slow, open_block_file(path, choose=compiled) as fast:
        known = [name for name, spec in slow.specs.items() if spec.id in COLUMN_IDS]
        for alone, ahead in zip(blocks(slow), blocks(fast, *known), strict=True):
            assert alone.key == ahead.key
            for column, values in ahead.decoded.items():
                wanted = alone.column(column)
                assert (values.dtype, values.shape) == (wanted.dtype, wanted.shape)
                np.testing.assert_array_equal(values, wanted)


def test_all_columns_of_a_sound_file_are_decoded_ahead():
    with open_block_file(DATA, choose=compiled) as file:
        assert all(set(view.decoded) == set(file.columns) for view in blocks(file, *file.columns))


def stored(column, data, filter_id):
    """Other filtered bytes, stored as they are."""
    return replace(column, data=data, codec=CODEC_RAW, filter=filter_id)


DAMAGES = {  # rule -> column, and what is made of it
    "GSB-0401": ("normal", lambda c: replace(c, data=b"\xff" * 99, codec=CODEC_LZ4)),
    "GSB-0402": ("weight", lambda c: replace(c, raw_bytes=4)),
    "GSB-0403": (
        "mask",
        lambda c: replace(c, data=b"", codec=CODEC_CONSTANT, filter=0, constant=64),
    ),
    "GSB-0404": ("normal", lambda c: replace(c, filter=GREEN_DELTA_BIT_PLANES)),
    "GSB-0405": ("mask", lambda c: stored(c, b"\x40" * c.raw_bytes, NONE)),
    "GSB-0406": ("mask", lambda c: stored(c, b"\xff" * (6 * -(-c.raw_bytes // 8)), BIT_PLANES)),
    "GSB-0407": ("occupancy", lambda c: stored(c, bytes(c.raw_bytes), NONE)),
    "GSB-0408": ("occupancy", lambda c: stored(c, b"\xff" * c.raw_bytes, NONE)),
}


def check_that_one_is_refused(data, key, column, rule):
    with open_block_file(data, choose=compiled) as file:
        views = {view.key: view for view in file.blocks(0, file.columns)}
        assert len(views) > 8
        with pytest.raises(CorruptFileError, match=rule):
            views.pop(key).column(column)
        assert all(column in view.decoded for view in views.values())


@pytest.mark.parametrize("rule", DAMAGES)
def test_a_damaged_block_is_refused_and_the_others_of_its_batch_are_read(rule):
    column, change = DAMAGES[rule]
    finest = [(k, block.count) for (level, k), block in SCENE.blocks.items() if level == 0]
    key = next(key for key, count in finest if count % 8)

    def alter(level, at, encoded):
        if (level, at) == (0, key):
            made = change(encoded[column])
            encoded[column] = replace(made, crc=crc32(made.data) if made.data else 0)

    check_that_one_is_refused(file_bytes(SCENE, alter=alter), key, column, rule)


def test_a_block_with_a_flipped_bit_is_refused_and_the_others_of_its_batch_are_read():
    data = bytearray(DATA)
    with open_block_file(DATA) as file:
        view = list(file.blocks(0))[5]
    offset, stored = view.entry["weight"].item()[:2]
    data[offset + stored - 1] ^= 1  # a literal: the column still unpacks
    check_that_one_is_refused(bytes(data), view.key, "weight", "GSB-0411")


def test_a_column_that_the_file_lacks_is_said_when_a_block_is_asked_for_it():
    with open_block_file(DATA, choose=compiled) as file:
        view = next(file.blocks(0, ("spread",)))
        with pytest.raises(UnsupportedError, match="there is no column 'spread'"):
            view.column("spread")


def test_the_columns_of_a_batch_are_read_in_one_request():
    requests = []

    def source(offset, length):
        requests.append((offset, length))
        return DATA[offset : offset + length]

    with open_block_file(source, choose=compiled) as file:
        list(file.blocks(0))
        before = len(requests)
        for view in file.blocks(0, file.columns):
            for name in file.columns:
                view.column(name)
    assert len(requests) - before == 1


@example([batches.BATCH - 1, 1, 1])
@given(st.lists(st.integers(0, 3 * batches.BATCH), max_size=30))
def test_batches_are_all_items_once_and_no_larger_than_they_may_be_unless_one_alone_is(sizes):
    begins = batches.cut(np.array(sizes, np.uint32))
    assert (begins[0], begins[-1]) == (0, len(sizes))
    for first, end in pairwise(begins):
        assert end - first == 1 or sum(sizes[first:end]) <= batches.BATCH
        if end < len(sizes):
            assert sum(sizes[first : end + 1]) > batches.BATCH


def test_a_sound_file_is_checked_without_a_look_at_single_blocks(monkeypatch):
    monkeypatch.setattr(Content, "_group", None)
    assert list(iter_findings(DATA, choose=compiled)) == []
