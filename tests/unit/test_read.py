"""Reading block files: what was written comes back, only what is asked for is read."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from damaged_block_files import Patch
from small_block_files import ALL, Paging, file_bytes, random_scene

from gstream.compiled import after, compiled
from gstream.errors import CorruptFileError, UnsupportedError, UsageError
from gstream.formats.arithmetic import PLAIN
from gstream.formats.lodrule import decode_normals
from gstream.formats.morton import decode_morton, encode_morton
from gstream.read import open_block_file

SCENE = random_scene(seed=9)
DATA = file_bytes(SCENE)


class Source:
    """A range reader that remembers its requests."""

    def __init__(self, data):
        self.data, self.requests = data, []

    def __call__(self, offset, length):
        self.requests.append((offset, length))
        return self.data[offset : offset + length]


@pytest.fixture(scope="module")
def large_file():
    """A file of several times 64 KiB."""
    return file_bytes(random_scene(64, 4, 20_000))


def places(level):
    """Voxel coordinates of a level of SCENE, in the order of blocks."""
    parts = []
    for (there, key), block in sorted(SCENE.blocks.items()):
        if there == level:
            corner = decode_morton(np.array([key]))[0] * 8
            parts.append(decode_morton(block.morton) + corner)
    return np.concatenate(parts)


def test_morton_codes_have_x_in_bit_0_y_in_bit_1_and_z_in_bit_2():
    assert encode_morton(np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0]])).tolist() == [
        1, 2, 4, 8,
    ]  # fmt: skip


def test_morton_codes_come_back_up_to_21_bits_per_axis():
    given = np.random.default_rng(1).integers(0, 1 << 21, (1000, 3))
    np.testing.assert_array_equal(decode_morton(encode_morton(given)), given)


def test_both_arithmetics_read_the_same_values():
    with open_block_file(DATA) as slow, open_block_file(DATA, choose=compiled) as fast:
        for a, b in zip(slow.blocks(0), fast.blocks(0), strict=True):
            for name in slow.columns:
                np.testing.assert_array_equal(a.column(name), b.column(name))
            for what in ("positions", "normals", "words", "octree"):
                x, y = getattr(a, what)(), getattr(b, what)()
                np.testing.assert_array_equal(x, y)
                assert x.dtype == y.dtype


def test_a_file_is_read_with_compiled_code_once_that_many_voxels_were_decoded():
    voxels = sum(block.count for (level, _), block in SCENE.blocks.items() if level == 0)
    with open_block_file(DATA, choose=after(2 * voxels)) as file:
        used = []
        for _ in range(3):
            for view in file.blocks(0):
                view.column("occupancy")
            used.append(file.arithmetic(0) is PLAIN)
    assert used == [True, True, False]


def test_every_column_of_every_block_comes_back():
    with open_block_file(DATA) as file:
        for (level, key), block in SCENE.blocks.items():
            view = file.block(level, decode_morton(np.array([key]))[0])
            assert (view.level, view.key, view.count) == (level, key, block.count)
            np.testing.assert_array_equal(view.column("occupancy"), block.morton)
            np.testing.assert_array_equal(view.mask, block.mask)
            np.testing.assert_array_equal(view.normal_codes, block.normal)
            np.testing.assert_array_equal(view.colour, block.colour)
            np.testing.assert_array_equal(view.weight, block.weight)


def test_blocks_of_a_level_come_in_morton_order_and_hold_its_voxels():
    with open_block_file(file_bytes(SCENE, paging=Paging(8))) as file:
        for level in range(file.levels):
            views = list(file.blocks(level))
            assert [v.key for v in views] == sorted(k for at, k in SCENE.blocks if at == level)
            found = np.concatenate([v.positions() for v in views])
            np.testing.assert_array_equal(found, places(level))


def test_words_hold_position_and_mask():
    with open_block_file(DATA) as file:
        view = next(file.blocks(0))
        words = view.words()
        local = view.positions() - view.corner
        np.testing.assert_array_equal(words & 255, local[:, 0])
        np.testing.assert_array_equal(words >> 8 & 255, local[:, 1])
        np.testing.assert_array_equal(words >> 16 & 255, local[:, 2])
        np.testing.assert_array_equal(words >> 24, view.mask)


def test_normals_are_unit_vectors_and_zero_for_no_direction():
    scene = random_scene(voxels=40)
    key = next(iter(scene.blocks))
    scene.blocks[key].normal[0] = 2047
    with open_block_file(file_bytes(scene)) as file:
        view = file.block(0, decode_morton(np.array([key[1]]))[0])
        normals = view.normals()
        assert normals.dtype == np.float32
        assert not normals[0].any()
        np.testing.assert_allclose(np.linalg.norm(normals[1:], axis=1), 1, atol=1e-6)
        wanted = decode_normals(view.normal_codes, 11)
        assert (np.sign(normals[1:]) == np.sign(wanted[1:])).all()


@pytest.mark.parametrize("level", [0, 1])
def test_a_region_is_every_voxel_that_touches_the_box(level):
    low, high = (3.5, 0.0, 10.0), (17.25, 31.0, 20.0)
    edge = 2.0**level
    at = places(level) * edge
    inside = ((at + edge >= low) & (at <= high)).all(axis=1)
    with open_block_file(DATA) as file:
        found = file.region(low, high, level, ["mask", "colour"])
    np.testing.assert_array_equal(found.positions, places(level)[inside])
    assert len(found.columns["mask"]) == inside.sum()
    assert found.columns["colour"].shape == (inside.sum(), 4)


def test_a_region_follows_the_matrix_of_the_grid():
    matrix = (0.5, 0.0, 0.0, 100.0, 0.0, 0.5, 0.0, -7.0, 0.0, 0.0, 0.5, 3.0)
    scene = replace(SCENE, header=replace(SCENE.header, matrix=matrix))
    with open_block_file(file_bytes(scene)) as file, open_block_file(DATA) as plain:
        low, high = np.array([2.5, 2.5, 2.5]), np.array([20.5, 9.5, 30.5])
        shift = np.array([100.0, -7.0, 3.0])
        moved = file.region(low / 2 + shift, high / 2 + shift)
        np.testing.assert_array_equal(moved.positions, plain.region(low, high).positions)


def test_an_empty_region_has_no_voxels():
    with open_block_file(DATA) as file:
        assert len(file.region((900, 900, 900), (901, 901, 901)).positions) == 0


def test_a_place_without_voxels_has_no_block():
    with open_block_file(file_bytes(random_scene(voxels=1))) as file:
        there = decode_morton(np.array([next(file.blocks(0)).key]))[0]
        assert file.block(0, there) is not None
        assert file.block(0, (there + 1) % 4) is None
        assert file.block(0, (-1, 0, 0)) is None
        assert file.block(0, (1 << 40, 0, 0)) is None


def first_picture(data):
    """The requests that show the coarsest level, and the open file's head."""
    source = Source(data)
    with open_block_file(source) as file:
        file.load_opening()
        coarsest = next(file.blocks(file.levels - 1))
        coarsest.words()
        coarsest.normals()
        return source.requests, file.head


def test_the_first_picture_takes_two_requests_and_of_a_small_file_one(large_file):
    requests, head = first_picture(large_file)
    assert requests == [(0, 65_536), (head.head_bytes, head.opening_bytes)]
    requests, _ = first_picture(DATA)
    assert requests == [(0, 65_536)]


def test_a_column_that_is_not_asked_for_is_not_read(large_file):
    source = Source(large_file)
    with open_block_file(source) as file:
        *_, view = file.blocks(0)
        asked = {name: int(view.entry[name]["offset"]) for name in ALL}
        view.mask  # noqa: B018
    offsets = {offset for offset, _ in source.requests}
    assert asked["mask"] in offsets
    assert not offsets & {asked[name] for name in ALL if name != "mask"}


def test_a_column_that_is_not_stored_is_unsupported_and_named():
    with (
        open_block_file(file_bytes(SCENE, kept=ALL[:2])) as file,
        pytest.raises(UnsupportedError, match=r"'colour'.*stores occupancy, mask"),
    ):
        next(file.blocks(0)).colour  # noqa: B018


def test_a_path_memory_and_a_callable_read_the_same(tmp_path):
    path = tmp_path / "scene.gsb"
    path.write_bytes(DATA)
    found = []
    for source in (path, str(path), DATA, Source(DATA)):
        with open_block_file(source) as file:
            found.append(file.region((0, 0, 0), (32, 32, 32)).positions)
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])


def test_a_missing_path_is_a_usage_error_and_a_closed_file_too(tmp_path):
    with pytest.raises(UsageError):
        open_block_file(tmp_path / "missing.gsb")
    path = tmp_path / "scene.gsb"
    path.write_bytes(DATA)
    with open_block_file(path) as file:
        view = next(file.blocks(0))
    with pytest.raises(UsageError, match="closed"):
        view.mask  # noqa: B018
    with pytest.raises(UsageError, match="level 9"), open_block_file(path) as file:
        next(file.blocks(9))


@pytest.mark.parametrize("size", [0, 11, 12, 300, 1000, len(DATA) - 1])
def test_a_cut_file_is_refused_on_opening(size):
    with pytest.raises(CorruptFileError):
        open_block_file(DATA[:size])


def test_a_source_that_ends_early_is_truncated_not_empty():
    source = Source(DATA[: len(DATA) // 2])
    with open_block_file(source) as file, pytest.raises(CorruptFileError, match="GSB-0102"):
        for view in file.blocks(0):
            view.words()


def test_a_damaged_column_concerns_its_block_alone():
    with open_block_file(DATA) as file:
        views = list(file.blocks(0))
        at = int(views[3].entry["occupancy"]["offset"])
    damaged = bytearray(DATA)
    damaged[at] ^= 1
    with open_block_file(bytes(damaged)) as file:
        for i, view in enumerate(file.blocks(0)):
            view.mask  # noqa: B018
            if i == 3:
                with pytest.raises(CorruptFileError, match="GSB-0411"):
                    view.positions()
            else:
                view.positions()


@pytest.mark.parametrize(
    ("listed", "said"),
    [
        (True, r"of level 0 is not in the child mask of its parent, at byte \d+ \[GSB-0306\]"),
        (False, r"level 0 has 60 blocks, not the 61 of the child masks, at .* \[GSB-0306\]"),
    ],
    ids=["one that is not listed", "one that is missing"],
)
def test_a_level_that_differs_from_the_child_masks_above_is_refused(listed, said):
    made = Patch(file_bytes(random_scene(32, 3, 200, 2)))
    rows = (made.entries["level"] == 1) & (made.entries["children"] != 255)
    parent = np.flatnonzero(rows)[0]
    mask = int(made.entries["children"][parent])
    bit = next(bit for bit in range(8) if (mask >> bit & 1) == listed)
    made.entry(parent, "children", mask ^ 1 << bit)
    with open_block_file(made.sealed()) as file, pytest.raises(CorruptFileError, match=said):
        list(file.blocks(0))


def test_reading_does_not_import_numba():
    code = "import sys, gstream.read; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
