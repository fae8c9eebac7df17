"""`gstream diff`: equal content is equal in any bytes; what differs is counted and found."""

import json
from dataclasses import replace

import numpy as np
import pytest
from small_block_files import ALL, Paging, coarser, file_bytes, random_scene

from gstream.diff import DIFFERENT, diff
from gstream.formats.columns import Block
from gstream.formats.lodrule import decode_normals, encode_normals
from gstream.formats.morton import decode_morton, encode_morton
from gstream_cli import main

SCENE = random_scene(32, 3, 300, seed=6)


@pytest.fixture
def compare(tmp_path):
    """diff of two scenes or of two files' bytes."""

    def compared(a, b):
        paths = [tmp_path / "a.gsb", tmp_path / "b.gsb"]
        for path, content in zip(paths, (a, b), strict=True):
            path.write_bytes(content if isinstance(content, bytes) else file_bytes(content))
        return diff(str(paths[0]), str(paths[1]))

    return compared


def voxels(scene, level):
    """{(x, y, z): values by column} of a level."""
    found = {}
    for (at, key), block in scene.blocks.items():
        if at == level:
            corner = decode_morton(np.array([key]))[0] << scene.log2
            places = (decode_morton(block.morton) + corner).tolist()
            for row, place in enumerate(places):
                found[tuple(place)] = {n: getattr(block, n)[row].tolist() for n in ALL[1:]}
    return found


def reblocked(scene, log2):
    """The same voxels in blocks of another size."""
    blocks = {}
    for level in range(scene.header.levels):
        everything = voxels(scene, level)
        places = np.array(list(everything))
        codes = encode_morton(places)
        order = np.argsort(codes)
        owner = codes[order] >> np.uint64(3 * log2)
        values = [everything[tuple(places[i])] for i in order]
        for key in np.unique(owner):
            here = np.flatnonzero(owner == key)
            local = (codes[order][here] & np.uint64(8**log2 - 1)).astype(np.uint32)
            one = next(iter(scene.blocks.values()))
            columns = {
                n: np.array([values[i][n] for i in here], getattr(one, n).dtype) for n in ALL[1:]
            }
            blocks[level, int(key)] = Block(local, **columns)
    return replace(scene, header=replace(scene.header, block_log2=log2), blocks=blocks)


def changed(scene, edit, level=0):
    """The scene with edit(block) in place of the block of a level that is last in Morton order."""
    blocks = dict(scene.blocks)
    last = max(key for at, key in blocks if at == level)
    blocks[level, last] = edit(blocks[level, last])
    return replace(scene, blocks=blocks)


def test_a_file_equals_itself_and_its_other_bytes(compare):
    data = file_bytes(SCENE)
    others = [data, file_bytes(SCENE, paging=Paging(8)), file_bytes(SCENE, meta={"units": "m"})]
    assert len(set(others)) == 3
    for other in others:
        found = compare(data, other)
        assert found.equal
        assert [tuple(level.voxels) for level in found.levels] == [
            (len(voxels(SCENE, level)),) * 2 for level in range(SCENE.header.levels)
        ]


@pytest.mark.parametrize("log2", [4, 5])
def test_blocks_of_another_size_with_the_same_voxels_are_equal(compare, log2):
    other = reblocked(SCENE, log2)
    for found in (compare(SCENE, other), compare(other, SCENE)):
        assert found.equal
        assert found.levels[0].voxels == [len(voxels(SCENE, 0))] * 2


@pytest.mark.parametrize("log2", [3, 5])
def test_voxels_of_one_file_alone_are_counted_and_within_the_box(compare, log2):
    other = random_scene(32, 3, 300, seed=7)
    found = compare(SCENE, reblocked(other, log2))
    assert not found.equal
    for level in found.levels:
        a, b = voxels(SCENE, level.level), voxels(other, level.level)
        assert level.voxels == [len(a), len(b)]
        assert level.only == [len(a.keys() - b.keys()), len(b.keys() - a.keys())]
        unlike = np.array([p for p in a.keys() | b.keys() if a.get(p) != b.get(p)])
        assert level.low.tolist() == unlike.min(axis=0).tolist()
        assert level.high.tolist() == unlike.max(axis=0).tolist()
        both = a.keys() & b.keys()
        for name, column in level.columns.items():
            assert column.differing == sum(a[p][name] != b[p][name] for p in both)


def shifted(column, row, value):
    def edit(block):
        values = getattr(block, column).copy()
        values[row] = value(values[row])
        return replace(block, **{column: values})

    return edit


@pytest.mark.parametrize(
    ("column", "value", "largest"),
    [
        ("mask", lambda mask: mask ^ 0b10110 or 1, 3.0),
        ("colour", lambda colour: (colour + 128).astype(np.uint8), 128.0),
        ("weight", lambda weight: weight + (3 << 20), 3.0),
    ],
    ids=["mask", "colour", "weight"],
)
def test_a_changed_value_is_found_with_its_size_and_its_place(compare, column, value, largest):
    found = compare(SCENE, changed(SCENE, shifted(column, 1, value)))
    changed_level, *others = found.levels
    assert all(level.equal for level in others)
    assert changed_level.only == [0, 0]
    last = max(key for at, key in SCENE.blocks if at == 0)
    corner = decode_morton(np.array([last]))[0] * 8
    place = (decode_morton(SCENE.blocks[0, last].morton)[1] + corner).tolist()
    assert changed_level.low.tolist() == changed_level.high.tolist() == place
    assert found.box(changed_level) == [*place, *(c + 1 for c in place)]
    for name, difference in changed_level.columns.items():
        expected = (1, largest) if name == column else (0, 0.0)
        assert (difference.differing, difference.largest) == expected


@pytest.mark.parametrize(
    ("before", "after", "angle"),
    [((0, 0, 1), (0, 1, 0), 90), ((1, 0, 0), (1, 1, 0), 45), ((0, 0, 1), (0, 0, 0), 180)],
    ids=["right angle", "half of it", "no direction"],
)
def test_normals_differ_by_an_angle(compare, before, after, angle):
    codes = encode_normals(np.array([before, after]) * 1000, 11)
    a = changed(SCENE, shifted("normal", 0, lambda _: codes[0]))
    b = changed(SCENE, shifted("normal", 0, lambda _: codes[1]))
    column = compare(a, b).levels[0].columns["normal"]
    assert column.differing == 1
    assert abs(column.largest - angle) < 0.1


def test_normals_of_other_bits_are_compared_as_directions(compare):
    fine, coarse = (random_scene(16, 3, 40, bits=bits) for bits in (12, 8))
    column = compare(fine, coarse).levels[0].columns["normal"]
    angles = []
    for key, block in fine.blocks.items():
        if key[0] == 0:
            x = decode_normals(block.normal, 12).astype(float)
            y = decode_normals(coarse.blocks[key].normal, 8).astype(float)
            cosine = (x * y).sum(axis=1) / np.linalg.norm(x, axis=1) / np.linalg.norm(y, axis=1)
            angles += np.degrees(np.arccos(np.clip(cosine, -1, 1))).tolist()
    assert abs(column.largest - max(angles)) < 1e-3


def test_equal_bytes_for_other_voxels_are_compared_voxel_by_voxel(compare):
    scene = random_scene(8, 3, 40, lod=False)
    (block,) = scene.blocks.values()
    columns = {name: getattr(block, name)[:3] for name in ALL[1:]}
    a, b = (Block(np.arange(n, n + 3, dtype=np.uint32), **columns) for n in (0, 1))
    level = compare(*(replace(scene, blocks={(0, 0): one}) for one in (a, b))).levels[0]
    assert (level.voxels, level.only) == ([3, 3], [1, 1])
    assert level.columns["weight"].differing == 2  # three weights, one voxel further on


def test_a_column_of_one_file_alone_is_a_difference_and_named(compare):
    found = compare(file_bytes(SCENE), file_bytes(SCENE, kept=ALL[:4]))
    assert not found.equal
    assert found.columns == (("weight",), ())
    assert all(level.equal for level in found.levels)


def test_a_level_of_one_file_alone_is_its_voxels(compare):
    single = random_scene(32, 3, 300, seed=6, lod=False)
    found = compare(SCENE, single)
    assert [level.equal for level in found.levels] == [True, False, False]
    assert found.levels[1].only == [len(voxels(SCENE, 1)), 0]


def test_levels_below_the_single_block_of_the_other_file_are_no_difference(compare):
    other = reblocked(SCENE, 4)
    blocks = {key: block for key, block in other.blocks.items() if key[0] < 2}
    header = replace(other.header, levels=2)  # 32^3 in blocks of 16^3: level 1 is one block
    found = compare(SCENE, replace(other, header=header, blocks=blocks))
    assert found.equal
    assert found.made_with == {"block_edge": (8, 16), "levels": (3, 2)}


def test_other_grids_are_different_and_their_voxels_not_compared(compare):
    moved = replace(SCENE.header, matrix=(1.0, 0.0, 0.0, 0.5, *SCENE.header.matrix[4:]))
    found = compare(SCENE, replace(SCENE, header=moved))
    assert (found.equal, found.same_grid, found.levels) == (False, False, [])


def test_settings_of_the_build_are_named_and_no_difference(compare):
    other = replace(SCENE, header=replace(SCENE.header, sep="26", snap_bits=9))
    found = compare(SCENE, other)
    assert found.equal
    assert found.made_with == {"sep": ("6", "26"), "snap_bits": (12, 9)}


def test_a_scene_without_voxels_equals_itself_alone(compare):
    nothing = replace(SCENE, blocks={})
    assert compare(nothing, nothing).equal
    assert compare(nothing, SCENE).levels[0].only == [0, len(voxels(SCENE, 0))]


def test_equal_files_are_one_line_and_0_and_others_are_found_and_7(capsys, tmp_path):
    a, b, c = (tmp_path / name for name in ("a.gsb", "b.gsb", "c.gsb"))
    a.write_bytes(file_bytes(SCENE))
    b.write_bytes(file_bytes(reblocked(SCENE, 4)))
    c.write_bytes(file_bytes(changed(SCENE, shifted("weight", 1, lambda w: w + (1 << 19)))))
    assert main.status(["diff", str(a), str(b)]) == 0
    said = capsys.readouterr()
    assert said.out.startswith(f"{a} and {b}: equal: ")
    assert (said.out.count("\n"), said.err) == (1, "")
    assert main.status(["diff", str(a), str(c)]) == DIFFERENT == 7
    said = capsys.readouterr()
    assert "  weight: 1 voxels differ, by at most 0.5 voxel faces\n" in said.out
    assert said.out.splitlines()[-1] == f"{a} and {c}: DIFFERENT"
    assert said.err == ""
    assert main.status(["diff", str(a), str(c), "--json"]) == 7
    held = json.loads(capsys.readouterr().out)
    assert (held["equal"], held["same_grid"]) == (False, True)
    assert [level["equal"] for level in held["levels"]] == [False, True, True]
    assert held["levels"][0]["columns"]["weight"] == {
        "differing": 1, "largest": 0.5, "unit": "voxel faces",
    }  # fmt: skip
    assert len(held["levels"][0]["box"]) == 6


def test_a_file_that_is_not_there_or_none_of_ours_is_an_error_not_a_difference(capsys, tmp_path):
    sound, odd = tmp_path / "a.gsb", tmp_path / "odd.gsb"
    sound.write_bytes(file_bytes(SCENE))
    odd.write_bytes(b"odd" * 300)
    assert main.status(["diff", str(sound), str(tmp_path / "no.gsb")]) == 2
    assert main.status(["diff", str(odd), str(sound)]) == 4
    assert capsys.readouterr().err.count("\n") == 2


def test_coarser_levels_are_compared_on_their_own(compare):
    blocks = {key: block for (level, key), block in SCENE.blocks.items() if level == 0}
    merged = coarser(blocks, 3, 11, area=False)
    other = dict(SCENE.blocks) | {(1, key): block for key, block in merged.items()}
    found = compare(SCENE, replace(SCENE, blocks=other))
    assert [level.equal for level in found.levels] == [True, False, True]
