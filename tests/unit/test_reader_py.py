"""tools/reader_py: what it decodes, what it asks for, and that threads may share a file."""

import re
import threading
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from damaged_block_files import GOOD, Patch, patch, sound_file
from filtered_block_files import every_filter
from small_block_files import ALL, Paging, file_bytes, random_scene

from gstream.read import open_block_file
from gstream_tools.reader_py import (
    BlockFile,
    CorruptFileError,
    UnsupportedError,
    block_places,
    blockfile,
    open_source,
    unit_normals,
)

SPEC = Path(__file__).parents[2] / "spec" / "blockfile.md"
SCENE = random_scene(64, voxels=9000)
LARGE = file_bytes(SCENE, paging=Paging(128))
DEEP = file_bytes(SCENE, paging=Paging(128, 2, 2))


class Memory:
    """A source of bytes that are there; it refuses to be read by two threads at once."""

    name = "memory"

    def __init__(self, data: bytes) -> None:
        self.data, self.size = data, len(data)
        self.ranges: list[tuple[int, int]] = []
        self.opened, self.gate = threading.Event(), threading.Event()
        self.gate.set()
        self._alone = threading.Lock()

    @property
    def requests(self) -> int:
        return len(self.ranges)

    def read(self, offset: int, length: int) -> bytes:
        assert self._alone.acquire(blocking=False)
        self.ranges.append((offset, length))
        self.opened.set()
        self.gate.wait()
        threading.Event().wait(0.001)  # so that a second thread would be seen
        self._alone.release()
        return self.data[offset : offset + length]

    def close(self) -> None:
        pass


def opened(data: bytes) -> BlockFile:
    return BlockFile(Memory(data))


def entries_of(file: BlockFile) -> np.ndarray:
    pages = [file.page(number) for number in range(file.pages)]
    entries = np.concatenate(pages) if pages else np.empty(0, file.entry_dtype)
    return entries[entries["state"] == 1]


SLOW = ("blocks-full-256", "blocks-most-pages")  # of which test_conformance asks too
SMALL = {name: make for name, make in GOOD.items() if name not in SLOW}


@pytest.mark.parametrize("name", SMALL)
def test_every_column_of_a_good_vector_is_what_gstream_reads(name):
    data = SMALL[name]()
    file, near = opened(data), open_block_file(data)
    known = [column.name for column in file.head.columns if column.item_bytes]
    entries = entries_of(file)
    views = [view for level in reversed(range(near.levels)) for view in near.blocks(level)]
    for view, found in zip(views, file.load(entries, known), strict=True):
        for column in known[1:]:
            wanted = view.column(column)
            assert found[column].dtype == wanted.dtype
            np.testing.assert_array_equal(found[column], wanted)
        places = view.positions().astype(int) - view.corner
        words = places[:, 0] | places[:, 1] << 8 | places[:, 2] << 16
        np.testing.assert_array_equal(found["words"] & 0xFFFFFF, words)


def test_every_codec_and_filter_is_in_the_file_that_has_every_filter():
    entries = entries_of(opened(every_filter()))
    ways = {tuple(way) for way in entries["colour"][["codec", "filter"]].tolist()}
    assert ways >= {(codec, filter_) for codec in (0, 1) for filter_ in range(6)} | {(2, 0)}


def test_words_hold_the_mask_where_it_is_asked_for():
    file = opened(sound_file())
    for found in file.load(entries_of(file), ["mask", "occupancy"]):
        np.testing.assert_array_equal(found["words"] >> 24, found["mask"])
    assert all((f["words"] >> 24 == 0).all() for f in file.load(entries_of(file), ["occupancy"]))


def test_the_head_is_what_gstream_reads():
    data = GOOD["blocks-other-settings"]()
    file, near = opened(data), open_block_file(data)
    assert (file.resolution, file.levels, file.metadata) == (8, 1, near.metadata)
    assert (file.block_log2, file.normal_bits, file.separability, file.faces) == (3, 12, 1, 1)
    np.testing.assert_array_equal(file.matrix, near.matrix[:3])
    np.testing.assert_array_equal(file.box, [[-1, -2, -3], [-1, 2, 3]])
    assert (file.content_id.hex(), file.file_bytes) == (near.content_id, len(data))
    assert file.columns == dict(enumerate(ALL, 1))
    assert (file.level_blocks, file.level_voxels, file.blocks, file.pages) == ((1,), (8,), 1, 1)


@cache
def directions():
    """The decoder of normals that the spec prints."""
    names: dict[str, object] = {}
    exec(re.findall(r"```python\n(.*?)```", SPEC.read_text(), re.S)[-1], names)
    return names["directions"]


@pytest.mark.parametrize("bits", range(8, 13))
def test_unit_normals_are_the_directions_of_the_spec(bits):
    h = (1 << bits - 1) - 1
    side = np.unique(np.append(np.arange(0, 2 * h + 1, 1 << bits - 8), [h, 2 * h])).astype(
        np.uint16
    )
    codes = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    found = unit_normals(codes, bits)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, directions()(codes.astype(int), bits) / 32767, atol=2.5e-5)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=3e-7)


def test_no_direction_is_the_zero_vector():
    codes = np.array([[2047, 2047], [2046, 1023]], np.uint16)
    np.testing.assert_array_equal(unit_normals(codes, 11), [[0, 0, 0], [1, 0, 0]])


def test_places_of_blocks_are_the_bits_of_their_keys_by_threes():
    keys = np.array([0, 0o123, 2**48 - 1, 0o1 << 45], np.uint64)
    wanted = [[0, 0, 0], [5, 3, 0], [65535] * 3, [32768, 0, 0]]
    np.testing.assert_array_equal(block_places(keys), wanted)


def test_an_empty_block_has_no_values_of_the_type_that_others_have():
    file = opened(GOOD["blocks-empty-block"]())
    entries = np.concatenate([file.page(number) for number in range(file.pages)])
    (empty,) = file.load(entries[entries["state"] == 0], ALL)
    full = file.load(entries[entries["state"] == 1][:1], ALL)[0]
    assert {k: (v.dtype, v.shape[1:]) for k, v in empty.items()} == {
        k: (v.dtype, v.shape[1:]) for k, v in full.items()
    }
    assert {len(values) for values in empty.values()} == {0}


def test_a_constant_is_told_packed_and_read_as_an_array():
    file = opened(GOOD["blocks-smallest"]())
    (entry,) = file.page(0)
    assert (file.constant(entry, "mask"), file.constant(entry, "occupancy")) == (63, None)
    assert file.load([entry], ["mask"])[0]["mask"].tolist() == [63]


def test_a_column_that_is_absent_or_of_an_unknown_kind_is_named():
    file = opened(GOOD["blocks-most-tables"]())
    unknown = list(file.columns.values())[-1]
    for name, said in (("label", "stores no column 'label'"), (unknown, "not known")):
        with pytest.raises(UnsupportedError, match=said):
            file.load(entries_of(file), [name])


def test_a_column_of_an_unknown_codec_leaves_the_others_readable():
    file = opened(patch().entry(1, "codec", 9, "mask").sealed())
    entries = entries_of(file)
    with pytest.raises(UnsupportedError, match="column 'mask' of block 0 of level 0 is of a kind"):
        file.load(entries, ["mask"])
    assert len(file.load(entries, ["occupancy", "normal"])) == len(entries)


def test_a_file_cut_anywhere_or_with_more_behind_it_is_refused():
    data = GOOD["blocks-smallest"]()
    for length in range(len(data)):
        with pytest.raises(CorruptFileError, match=r"GSB-010[12]\]"):
            opened(data[:length])
    with pytest.raises(CorruptFileError, match=r"GSB-0102\]"):
        opened(data + b"\0")


def test_the_first_picture_takes_two_requests_and_nothing_in_it_more():
    file = opened(LARGE)
    assert file.source.ranges == [(0, 65_536)]
    file.load_opening()
    end = file.head.head_bytes + file.opening_bytes
    coarse = [entry for entry in file.page(0) if entry["mask"]["offset"] < end]
    assert len(coarse) == 1 + 8 + 64
    assert 65_536 < end < len(LARGE)
    file.load(coarse, ALL)
    assert file.source.ranges == [(0, 65_536), (65_536, end - 65_536)]


def test_what_is_in_memory_is_not_asked_for_again_with_what_is_not():
    file = opened(LARGE)
    file.load_opening()
    known = sum(file.source.ranges[-1])
    rows = file.page(0)
    file.load(rows, ["mask"])
    assert (rows["mask"]["offset"] < known).any()
    assert all(offset >= known for offset, _ in file.source.ranges[2:])


def test_a_small_file_takes_one_request():
    file = opened(sound_file())
    file.load_opening()
    file.load(entries_of(file), ALL)
    assert file.source.requests == 1


@pytest.mark.parametrize(("data", "more"), [(LARGE, 0), (DEEP, 1)], ids=["depth 1", "depth 2"])
def test_eight_siblings_take_a_request_for_a_column_and_one_for_their_page(data, more):
    key = entries_of(opened(data))[-1]["key"] >> 3
    file = opened(data)
    page = file.page_of(0, int(key) << 3)
    assert not file.page_is_loaded(page)
    entries = file.page(page)
    assert file.page_is_loaded(page)
    siblings = entries[(entries["level"] == 0) & (entries["key"] >> 3 == key)]
    before = file.source.requests
    assert before == 2 + more
    found = file.load(siblings, ["normal"])
    assert file.source.requests == before + 1
    assert file.source.ranges[-1][1] == siblings["normal"]["stored"].sum()
    assert [len(one["normal"]) for one in found] == siblings["count"].tolist()
    file.page(page)
    assert file.source.requests == before + 1


@pytest.mark.parametrize("data", [LARGE, DEEP], ids=["depth 1", "depth 2"])
def test_every_block_is_in_the_page_that_the_search_names(data):
    file = opened(data)
    for number in range(file.pages):
        rows = file.page(number)
        found = [file.page_of(int(e["level"]), int(e["key"])) for e in rows]
        assert found == [number] * len(rows)
    assert file.page_of(file.levels - 1, 0) == 0


def test_ranges_join_across_small_gaps_and_never_above_the_limit(monkeypatch):
    def asked(gap, most):
        monkeypatch.setattr(blockfile, "MAX_GAP", gap)
        monkeypatch.setattr(blockfile, "MAX_RUN", most)
        file = opened(LARGE)
        entries = entries_of(file)
        file.source.ranges.clear()
        file.load(entries[entries["level"] == 0][200:], ["occupancy", "mask"])
        return file.source.ranges

    (one,) = asked(1 << 20, 8 << 20)
    many = asked(1 << 20, 10_000)
    assert len(many) >= one[1] // 10_000
    assert max(length for _, length in many) <= 10_000
    assert {offset for offset, _ in asked(0, 8 << 20)} > {one[0]}


def test_the_order_of_what_is_loaded_is_that_of_the_entries():
    file = opened(LARGE)
    entries = entries_of(file)
    shuffled = entries[np.random.default_rng(0).permutation(len(entries))]
    for entry, found in zip(shuffled, file.load(list(shuffled), ["mask"]), strict=True):
        np.testing.assert_array_equal(found["mask"], file.load([entry], ["mask"])[0]["mask"])


def test_pages_are_looked_up_while_another_thread_reads():
    file = opened(LARGE)
    source = file.source
    source.gate.clear()
    source.opened.clear()
    last = file.pages - 1
    reader = threading.Thread(target=file.page, args=(last,))
    reader.start()
    assert source.opened.wait(60)
    assert not file.page_is_loaded(last)
    assert file.page_of(0, 2**48 - 1) == last
    source.gate.set()
    reader.join()
    assert file.page_is_loaded(last)


def test_threads_that_load_the_same_blocks_get_the_same():
    file = opened(LARGE)
    entries, found = entries_of(file)[:300], {}

    def load(number: int) -> None:
        found[number] = [
            file.load(entries[first : first + 20], ["occupancy", "mask"])
            for first in range(0, 300, 20)
        ]

    threads = [threading.Thread(target=load, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number in range(1, 4):
        for mine, first in zip(found[number], found[0], strict=True):
            for a, b in zip(mine, first, strict=True):
                np.testing.assert_array_equal(a["words"], b["words"])
    assert len(found) == 4


def test_pages_and_records_that_lie_outside_the_file_are_refused_before_they_are_read():
    for offset in (2**63, 2**64 - 8, len(sound_file())):
        file = opened(patch().entry(0, "offset", offset, "normal").sealed())
        with pytest.raises(CorruptFileError, match=r"block 0 of level 1: .* \[GSB-0311\]"):
            file.page(0)
    made = Patch(LARGE)
    made.page_records[1, 2] = 2**64 - 8
    with pytest.raises(CorruptFileError, match=r"GSB-0206\]"):
        opened(made.sealed())


def test_a_local_file_counts_what_was_read(tmp_path):
    path = tmp_path / "a.gsb"
    path.write_bytes(LARGE)
    source = open_source(str(path))
    with BlockFile(source) as file:
        file.load_opening()
        assert (source.requests, source.bytes) == (2, file.head.head_bytes + file.opening_bytes)
    with pytest.raises(FileNotFoundError):
        open_source(str(tmp_path / "b.gsb"))
