"""Writing block files: layout, order, content id, and bytes that depend on nothing else."""

import io
from dataclasses import replace
from hashlib import blake2b

import numpy as np
import pytest
from small_block_files import ALL, IDENTITY, Paging, file_bytes, pile_bytes, random_scene

from gstream.errors import CorruptFileError, RefusedError
from gstream.formats.blockfile import write_block_file
from gstream.formats.blockhead import BlockFileHeader, pack_head, parse_head
from gstream.formats.columns import column_specs
from gstream.formats.directory import (
    OPENING_BYTES,
    entry_dtype,
    entry_order,
    group_starts,
    opening_bytes,
    page_starts,
    payload_offsets,
    pile_dtype,
)
from gstream.formats.pages import Directory
from gstream.formats.pile import read_pile_rows
from gstream.read import open_block_file

HEADER = BlockFileHeader(1024, 12, 5, 6, IDENTITY, (0.0, 0.0, 0.0, 1.0, 1.0, 1.0))
SPECS = column_specs(11)
COLUMNS = [SPECS["occupancy"], SPECS["mask"]]


def rows_with(keys, level=0, sizes=(1, 1)):
    """Rows of COLUMNS whose columns store sizes[0] and sizes[1] bytes."""
    rows = np.zeros(len(keys), pile_dtype(COLUMNS))
    rows["key"], rows["level"] = keys, level
    for column, size in zip(COLUMNS, sizes, strict=True):
        rows[column.name]["stored"] = size
    return rows


def test_settings_come_back_from_the_head():
    for changes in ({}, {"sep": "26", "ties": "closed"}, {"faces": "both", "normals": "input"}):
        scene = random_scene()
        header = replace(scene.header, **changes)
        assert parse_head(file_bytes(replace(scene, header=header)), "x").settings == header


@pytest.mark.parametrize("given", [{}, {"crs": None}, {"crs": "EPSG:4978", "up": "z"}])
def test_metadata_keeps_absent_null_and_value_apart(given):
    with open_block_file(file_bytes(random_scene(), meta=given)) as file:
        assert {k: v for k, v in file.metadata.items() if k != "ledger"} == given


def test_bytes_do_not_depend_on_the_order_of_rows_or_on_how_piles_are_cut():
    scene = random_scene(64, voxels=900)
    shuffled = dict(sorted(scene.blocks.items(), key=lambda item: hash(item[0]) % 17))
    assert file_bytes(scene) == file_bytes(replace(scene, blocks=shuffled))


def test_the_writer_never_goes_back():
    class Forward(io.BytesIO):
        def seek(self, *_):
            raise AssertionError("the writer went back")

    scene = random_scene()
    pile = pile_bytes(scene)
    rows = read_pile_rows(lambda at, n: pile[at : at + n], len(pile))
    columns = [SPECS[n] for n in ALL]
    fetch = lambda _, at, n: pile[at : at + n]  # noqa: E731
    file = Forward()
    write_block_file(file, scene.header, rows, fetch, {"ledger": {}}, columns)
    assert file.getvalue() == file_bytes(scene)


def test_the_content_id_is_the_hash_that_the_spec_describes():
    scene = random_scene()
    data = file_bytes(scene)
    pile = pile_bytes(scene)
    rows = read_pile_rows(lambda at, n: pile[at : at + n], len(pile))
    at, length = 256 + 4 * 32 + 32 * scene.header.levels, 32 * len(ALL)
    wanted = blake2b(data[56:216] + data[at : at + length], digest_size=16)
    for row in rows[np.lexsort((rows["key"], -rows["level"].astype(int)))]:
        wanted.update(int(row["key"]).to_bytes(8, "little") + bytes([row["level"]]))
        wanted.update(int(row["count"]).to_bytes(4, "little"))
        for name in ALL:
            wanted.update(int(row["hash"][name]).to_bytes(8, "little"))
    assert data[40:56] == wanted.digest()


def test_the_content_id_does_not_depend_on_paging_metadata_or_compression():
    scene = random_scene(64, voxels=900)
    ids = {
        file_bytes(scene, paging=paging, meta=meta)[40:56]
        for paging in (Paging(), Paging(8, 4, 4))
        for meta in ({}, {"units": "mm"})
    }
    assert len(ids) == 1
    assert ids != {file_bytes(scene, kept=ALL[:-1])[40:56]}


def test_two_blocks_of_one_key_are_refused():
    scene = random_scene()
    with pytest.raises(CorruptFileError, match=r"two finished blocks.*GSP-0003"):
        file_bytes(scene, alter_rows=lambda rows: np.concatenate([rows, rows[:1]]))


def test_a_damaged_payload_of_a_pile_is_not_copied():
    def damaged(rows):
        rows["mask"]["crc"][0] ^= 1
        return rows

    with pytest.raises(CorruptFileError, match="GSP-0004"):
        file_bytes(random_scene(), alter_rows=damaged)


def test_metadata_above_its_limit_is_refused():
    with pytest.raises(RefusedError, match="metadata"):
        file_bytes(random_scene(), meta={"crs": "x" * 12_288})


def test_progress_ends_at_the_number_of_blocks():
    scene = random_scene()
    pile = pile_bytes(scene)
    rows = read_pile_rows(lambda at, n: pile[at : at + n], len(pile))
    seen = []
    write_block_file(
        io.BytesIO(), scene.header, rows, lambda _, at, n: pile[at : at + n], {"ledger": {}},
        [SPECS[n] for n in ALL], lambda *counts: seen.append(counts),
    )  # fmt: skip
    assert seen[-1] == (len(rows), len(rows))
    assert seen == sorted(seen)


def test_entries_are_ordered_by_level_from_coarse_to_fine_then_by_key():
    rows = np.concatenate([rows_with([5, 1]), rows_with([0], 2), rows_with([3, 0], 1)])
    found = rows[entry_order(rows)]
    assert list(zip(found["level"], found["key"], strict=True)) == [
        (2, 0), (1, 0), (1, 3), (0, 1), (0, 5),
    ]  # fmt: skip


def test_a_page_holds_whole_sibling_groups_only():
    rows = rows_with([*range(8), *range(8, 13), 24, 25, *range(32, 40)])
    assert group_starts(rows).tolist() == [0, 8, 13, 15, 23]
    assert page_starts(rows, 16).tolist() == [0, 15, 23]
    assert page_starts(rows, 8).tolist() == [0, 8, 15, 23]


def test_blocks_of_one_parent_on_two_levels_are_two_groups():
    rows = np.concatenate([rows_with([0, 1], 1), rows_with([0, 1], 0)])
    assert group_starts(rows).tolist() == [0, 2, 4]


def test_payloads_go_group_by_group_then_column_by_column_then_child_by_child():
    rows = rows_with([0, 3, 9], sizes=(10, 1))
    rows["mask"]["stored"][1] = 0
    offsets, end = payload_offsets(rows, COLUMNS, 100)
    assert offsets.tolist() == [[100, 120], [110, 0], [121, 131]]
    assert end == 132


@pytest.mark.parametrize(("fine", "wanted"), [(1000, 2 + 2 * 1000), (OPENING_BYTES, 2)])
def test_the_opening_run_ends_behind_the_last_level_that_fits(fine, wanted):
    rows = np.concatenate([rows_with([0], 1), rows_with([0, 1], 0, (fine // 2, fine // 2))])
    length = opening_bytes(rows, COLUMNS, 88 * 3, np.array([2, 1], np.uint64))
    assert length == 88 * 3 + wanted


def test_the_opening_run_leaves_out_a_level_that_page_0_does_not_list_whole():
    rows = np.concatenate([rows_with([0], 1), rows_with([0, 1], 0)])
    assert opening_bytes(rows, COLUMNS, 0, np.array([3, 1], np.uint64)) == 2


@pytest.mark.parametrize("paging", [Paging(), Paging(8), Paging(8, 4, 5), Paging(64, 1, 1)])
def test_every_block_is_found_and_no_other(paging):
    scene = random_scene(64, voxels=500)
    with open_block_file(file_bytes(scene, paging=paging)) as file:
        for level in range(file.levels):
            for key in range(8 ** (file.levels - 1 - level)):
                entry = file.directory.find(level, key)
                assert (entry is not None) == ((level, key) in scene.blocks)


def test_any_block_is_reached_by_two_more_requests_at_depth_1_and_three_at_depth_2():
    scene = random_scene(64, voxels=500)
    for paging, wanted in ((Paging(8), 1), (Paging(8, 4, 5), 2)):
        data = file_bytes(scene, paging=paging)
        requests = []

        def read_at(offset, length, data=data, requests=requests):
            requests.append(offset)
            return data[offset : offset + length]

        directory = Directory(parse_head(data, "x"), read_at, "x")
        assert directory.find(0, max(k for level, k in scene.blocks if level == 0)) is not None
        assert len(requests) == wanted


def test_entry_rows_are_24_bytes_and_32_per_column():
    for n in range(1, 6):
        assert entry_dtype([SPECS[name] for name in ALL[:n]]).itemsize == 24 + 32 * n


def test_packing_what_was_parsed_gives_the_same_head():
    data = file_bytes(random_scene(), meta={"up": "z"})
    head = parse_head(data, "x")
    assert pack_head(head) == data[: head.head_bytes]
