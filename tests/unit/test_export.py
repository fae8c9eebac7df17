"""`gstream export`: what is in a PLY, npz or zarr is what is in the block file, and no more."""

import errno
import json
import os
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import zarr
from piece_block_files import scene, some_pieces, with_pieces
from small_block_files import ALL, file_bytes, random_scene

from gstream import export as module
from gstream import read
from gstream.errors import CorruptFileError, StoppedError, UsageError
from gstream.export import export
from gstream.formats import batches
from gstream.read import open_block_file
from gstream_cli import main

MATRIX = (0.5, 0.0, 0.0, 10.0, 0.0, 0.5, 0.0, -7.0, 0.0, 0.0, 0.5, 3.0)
SCENE = random_scene(32, 3, 300, seed=4)
SCENE = replace(SCENE, header=replace(SCENE.header, matrix=MATRIX))
TYPES = {"float": "<f4", "double": "<f8", "uchar": "u1", "uint": "<u4"}


def strict_ply(path, corners=4):
    """The elements of a binary PLY, by its grammar alone; every byte is accounted for."""
    data = path.read_bytes()
    head, body = data.split(b"end_header\n", 1)
    first, form, comment, *lines = head.decode("ascii").splitlines()
    assert (first, form) == ("ply", "format binary_little_endian 1.0")
    assert comment.startswith("comment ")
    elements = {}
    for line in lines:
        if match := re.fullmatch(r"element (\w+) (0|[1-9]\d*)", line):
            fields = []
            elements[match[1]] = int(match[2]), fields
        elif line == "property list uchar int vertex_indices":
            fields += [("count", "u1"), ("corners", "<i4", corners)]
        else:
            kind, name = re.fullmatch(r"property (\w+) (\w+)", line).groups()
            fields.append((name, TYPES[kind]))
    rows = {}
    for name, (count, fields) in elements.items():
        dtype = np.dtype(fields)
        rows[name] = np.frombuffer(body, dtype, count)
        body = body[count * dtype.itemsize :]
    assert body == b""
    return rows


def naive_voxels(scene, level):
    """[(x, y, z), values by column] of a level, by loops over bits, blocks by key."""
    for (at, key), block in sorted(scene.blocks.items()):
        if at == level:
            for row, local in enumerate(block.morton.tolist()):
                code = key << 3 * scene.log2 | local
                place = [sum((code >> 3 * i + a & 1) << i for i in range(16)) for a in range(3)]
                yield place, {name: getattr(block, name)[row] for name in ALL[1:]}


def naive_normal(code, bits=11):
    """The direction of an octahedral code, by the textbook."""
    h = (1 << bits - 1) - 1
    if tuple(code) == ((1 << bits) - 1,) * 2:
        return np.zeros(3)
    x, y = (int(c) / h - 1 for c in code)
    z = 1 - abs(x) - abs(y)
    if z < 0:
        x, y = (1 - abs(y)) * (1 if x >= 0 else -1), (1 - abs(x)) * (1 if y >= 0 else -1)
    return np.array([x, y, z]) / np.linalg.norm([x, y, z])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("export")
    (made / "scene.gsb").write_bytes(file_bytes(SCENE))
    return made


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_ply_of_points_has_every_voxel_s_centre_and_attributes(folder, level):
    out = folder / f"points{level}.ply"
    made = export(str(folder / "scene.gsb"), str(out), level)
    rows = strict_ply(out)["vertex"]
    wanted = list(naive_voxels(SCENE, level))
    assert len(rows) == len(wanted) == made.voxels
    for row, (place, values) in zip(rows, wanted, strict=True):
        centre = (np.array(place) + 0.5) * 0.5 * 2**level + (10, -7, 3)
        assert [row["x"], row["y"], row["z"]] == centre.tolist()
        normal = [row["nx"], row["ny"], row["nz"]]
        np.testing.assert_allclose(normal, naive_normal(values["normal"]), atol=1e-4)
        colour = [row[name] for name in ("red", "green", "blue", "alpha")]
        assert colour == values["colour"].tolist()
        assert (row["mask"], row["weight"]) == (values["mask"], values["weight"])


def exported(scene, out, **how):
    path = out.with_name("of.gsb")
    path.write_bytes(file_bytes(scene))
    return export(str(path), str(out), **how)


def test_normals_of_a_stretched_grid_stay_perpendicular_to_its_surfaces(tmp_path):
    matrix = np.diag([1.0, 2.0, 4.0])
    header = replace(SCENE.header, matrix=tuple(np.c_[matrix, [0, 0, 0]].ravel()))
    exported(replace(SCENE, header=header), tmp_path / "a.ply")
    rows = strict_ply(tmp_path / "a.ply")["vertex"]
    found = np.stack([rows["nx"], rows["ny"], rows["nz"]], axis=1)
    for row, (_, values) in zip(found, naive_voxels(SCENE, 0), strict=True):
        normal = naive_normal(values["normal"])
        surface = np.linalg.svd(normal[None])[2][1:] if normal.any() else np.zeros((2, 3))
        np.testing.assert_allclose((surface @ matrix) @ row, 0, atol=1e-3)
        assert abs(np.linalg.norm(row) - normal.any()) < 1e-6


@pytest.mark.parametrize("flip", [1.0, -1.0], ids=["right-handed", "left-handed"])
def test_cubes_are_closed_face_outward_and_have_the_voxel_s_volume(tmp_path, flip):
    matrix = np.c_[np.diag([0.5 * flip, 0.5, 0.5]), [1, 2, 3]]
    header = replace(SCENE.header, matrix=tuple(matrix.ravel().tolist()))
    exported(replace(SCENE, header=header), tmp_path / "a.ply", cubes=True)
    rows = strict_ply(tmp_path / "a.ply")
    vertex, face = rows["vertex"], rows["face"]
    places = np.stack([vertex["x"], vertex["y"], vertex["z"]], axis=1).astype(float)
    assert set(face["count"]) == {4}
    a, b, c, d = places[face["corners"].T]
    volume = (np.cross(b - a, c - a) * a + np.cross(c - a, d - a) * a).sum(axis=1) / 6
    np.testing.assert_allclose(volume.reshape(-1, 6).sum(axis=1), 0.125, atol=1e-4)
    assert {len(set(c.ravel())) for c in face["corners"].reshape(-1, 6, 4)} == {8}
    for cube, colour, (place, values) in zip(
        places.reshape(-1, 8, 3), vertex["red"].reshape(-1, 8), naive_voxels(SCENE, 0), strict=True
    ):
        centre = matrix[:, :3] @ (np.array(place) + 0.5) + matrix[:, 3]
        np.testing.assert_allclose(cube.mean(axis=0), centre)
        assert set(colour) == {values["colour"][0]}


BOUNDS = (11.0, -5.25, 3.0, 20.0, 4.0, 12.5)


def touching(scene, bounds, level=0):
    """The voxels whose closed cubes touch the closed box."""
    edge = 0.5 * 2**level
    for place, _ in naive_voxels(scene, level):
        low = np.array(place) * edge + (10, -7, 3)
        if (low <= bounds[3:]).all() and (low + edge >= bounds[:3]).all():
            yield place


def test_source_triangles_are_those_of_the_blocks_in_the_world(tmp_path):
    path = tmp_path / "pieces.gsb"
    path.write_bytes(with_pieces())
    made = export(str(path), str(tmp_path / "a.ply"), geometry=True)
    rows = strict_ply(tmp_path / "a.ply", corners=3)
    points = np.stack([rows["vertex"][axis] for axis in "xyz"], axis=1)
    header, want = scene().header, []
    for level, key in sorted(scene().blocks):
        if level == 0 and key != 1:
            vertices, triangles = some_pieces(key, 1 << (header.block_log2 + header.snap_bits))
            corner = [8 * (key >> axis & 1) for axis in range(3)]
            want.append((vertices / 4096 + corner)[triangles])
    assert np.array_equal(points[rows["face"]["corners"]], np.concatenate(want).astype("<f4"))
    assert made.columns == ("vertex", "triangle")


@pytest.mark.parametrize("more", [{"level": 1}, {"cubes": True}, {"output": "a.npz"}])
def test_source_triangles_are_level_0_alone_and_ply(tmp_path, more):
    path, more = tmp_path / "pieces.gsb", {"output": "a.ply", **more}
    path.write_bytes(with_pieces())
    output = tmp_path / more.pop("output")
    with pytest.raises(UsageError):
        export(str(path), str(output), geometry=True, **more)
    assert not output.exists()


def test_a_file_without_source_triangles_says_so(folder):
    with pytest.raises(UsageError, match="stores no source triangles"):
        export(str(folder / "scene.gsb"), str(folder / "t.ply"), geometry=True)


@pytest.mark.parametrize("level", [0, 1])
def test_bounds_leave_the_voxels_that_touch_the_box(folder, level):
    out = folder / "part.npz"
    made = export(str(folder / "scene.gsb"), str(out), level, BOUNDS)
    wanted = list(touching(SCENE, BOUNDS, level))
    assert np.load(out)["positions"].tolist() == wanted
    assert made.voxels == len(wanted)
    edge = SCENE.header.block_log2
    owners = {tuple(c >> edge for c in place) for place in wanted}
    assert len(owners) <= made.blocks < sum(at == level for at, _ in SCENE.blocks) + level


def test_bounds_without_a_voxel_leave_an_empty_file_and_outside_the_grid_none(folder):
    out = folder / "none.ply"
    gap = next(p for p in np.ndindex(32, 32, 32) if not any(touching(SCENE, point(p))))
    assert export(str(folder / "scene.gsb"), str(out), bounds=point(gap)).voxels == 0
    assert len(strict_ply(out)["vertex"]) == 0
    with pytest.raises(UsageError, match="--bounds is outside the grid"):
        export(str(folder / "scene.gsb"), str(folder / "no.ply"), bounds=(0, 0, 0, 1, 1, 1))


def point(place):
    """A box within a voxel of level 0 of SCENE."""
    low = (np.array(place) + 0.4) * 0.5 + (10, -7, 3)
    return (*low, *(low + 0.1))


def test_an_npz_has_the_arrays_that_its_help_names(folder):
    out = folder / "scene.npz"
    export(str(folder / "scene.gsb"), str(out), 1)
    arrays = np.load(out, allow_pickle=False)
    wanted = list(naive_voxels(SCENE, 1))
    assert arrays["positions"].tolist() == [place for place, _ in wanted]
    for name in ("mask", "colour", "weight"):
        np.testing.assert_array_equal(arrays[name], [values[name] for _, values in wanted])
    normals = [naive_normal(values["normal"]) for _, values in wanted]
    np.testing.assert_allclose(arrays["normal"], normals, atol=1e-4)
    assert arrays["level"] == 1
    assert arrays["matrix"].tolist() == [[1, 0, 0, 10], [0, 1, 0, -7], [0, 0, 1, 3]]


def test_the_same_export_has_the_same_bytes(folder):
    for name in ("a.npz", "a.ply"):
        written = []
        for _ in range(2):
            export(str(folder / "scene.gsb"), str(folder / name))
            written.append((folder / name).read_bytes())
        assert written[0] == written[1]


@pytest.mark.parametrize("level", [0, 1])
def test_a_zarr_is_1_where_there_is_a_voxel_and_0_elsewhere(tmp_path, level):
    scene = random_scene(150, 3, 400, seed=2)
    made = exported(scene, tmp_path / "a.zarr", level=level)
    array = zarr.open_array(tmp_path / "a.zarr", mode="r")
    dense = np.zeros((-(-150 // 2**level),) * 3, np.uint8)
    for (x, y, z), _ in naive_voxels(scene, level):
        dense[z, y, x] = 1
    np.testing.assert_array_equal(array[:], dense)
    assert made.voxels == dense.sum()
    assert array.metadata.dimension_names == ("z", "y", "x")


def test_a_zarr_of_a_box_says_where_it_begins_and_stores_chunks_with_voxels_alone(tmp_path):
    scene = random_scene(200, 3, 60, seed=3)
    bounds = (70.5, 0.5, 130.5, 90.5, 199.5, 140.5)
    exported(scene, tmp_path / "a.zarr", bounds=bounds)
    array = zarr.open_array(tmp_path / "a.zarr", mode="r")
    origin = array.attrs["origin"]
    assert (origin, array.shape) == ([64, 0, 128], (64, 200, 64))
    assert np.array(array.attrs["matrix"])[:, 3].tolist() == origin
    found = {(x + 64, y, z + 128) for z, y, x in np.argwhere(array[:]).tolist()}
    low, high = np.array(bounds[:3]) - 1, np.array(bounds[3:])
    inside = [p for p, _ in naive_voxels(scene, 0) if (p >= low).all() and (p <= high).all()]
    assert found == set(map(tuple, inside))
    chunks = {tuple(np.array(place) // 64) for place in inside}
    assert sum(p.is_file() for p in (tmp_path / "a.zarr" / "c").rglob("*")) == len(chunks)


def test_positions_far_from_the_origin_are_doubles(tmp_path):
    matrix = (0.01, 0.0, 0.0, 4.5e6, 0.0, 0.01, 0.0, 5.4e6, 0.0, 0.0, 0.01, 300.0)
    exported(replace(SCENE, header=replace(SCENE.header, matrix=matrix)), tmp_path / "a.ply")
    rows = strict_ply(tmp_path / "a.ply")["vertex"]
    assert rows.dtype["x"] == "<f8"
    (x, _, _), _ = next(naive_voxels(SCENE, 0))
    assert abs(rows["x"][0] - (4.5e6 + (x + 0.5) * 0.01)) < 1e-8


@pytest.mark.parametrize("name", ["a.ply", "a.npz", "a.zarr"])
def test_an_export_that_fails_leaves_what_was_there(tmp_path, name):
    out = tmp_path / name
    exported(SCENE, out)
    before = read_all(out)
    data = bytearray((tmp_path / "of.gsb").read_bytes())
    with open_block_file(bytes(data)) as file:
        *_, last = file.blocks(0)
        data[int(last.entry["occupancy"]["offset"])] ^= 1
    (tmp_path / "of.gsb").write_bytes(data)
    with pytest.raises(CorruptFileError):
        export(str(tmp_path / "of.gsb"), str(out))
    assert read_all(out) == before
    assert sorted(os.listdir(tmp_path)) == [name, "of.gsb"]


def read_all(path):
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    return {str(p): p.read_bytes() for p in files}


def test_a_full_disk_is_one_line_and_can_be_tried_again(folder, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(module, "write_points", full)
    with pytest.raises(StoppedError, match="No space left on device while it was written; free"):
        export(str(folder / "scene.gsb"), str(folder / "full.ply"))
    assert not list(folder.glob("full*"))


@pytest.mark.parametrize("name", ["a.ply", "a.npz", "a.zarr"])
def test_memory_does_not_grow_with_the_voxels(tmp_path, monkeypatch, name):
    for place in (batches, read):
        monkeypatch.setattr(place, "BATCH", 1 << 10)
    peaks = []
    for resolution, voxels in ((64, 2_000), (128, 30_000)):
        scene = random_scene(resolution, 5, voxels, lod=False)
        path = tmp_path / f"{resolution}.gsb"
        path.write_bytes(file_bytes(scene))
        if not peaks:
            export(str(path), str(tmp_path / name))  # imports and kernels
        tracemalloc.start()
        export(str(path), str(tmp_path / f"{resolution}-{name}"))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0] + (1 << 18)  # the columns take 1.2 MB


def call(capsys, *arguments):
    status = main.status([str(argument) for argument in arguments])
    said = capsys.readouterr()
    return status, said.out, said.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["no.gsb", "-o", "a.ply"], "no.gsb: no such file; check its name and folder"),
        (["scene.gsb", "-o", "a.xyz"], "a.xyz: no kind of export; end its name in .ply, .npz, .z"),
        (["scene.gsb", "-o", "a.npz", "--cubes"], "cubes are for .ply alone; drop --cubes or"),
        (["scene.gsb", "-o", "old.ply"], "old.ply: exists already; add --force to replace it"),
        (
            ["scene.gsb", "-o", "no/a.ply"],
            "/no: the output's folder does not exist; create",
        ),
        (["scene.gsb", "-o", "a.ply", "--level", "9"], "there is no level 9; 0 to 2"),
        (["scene.gsb", "-o", "a.ply", "--bounds", "1,2"], "is not a box; write it like"),
        (["scene.gsb", "-o", "mine.zarr", "--force"], "mine.zarr: exists and is no zarr array"),
        (["scene.gsb", "-o", "a.ply", "--level"], "requires an argument"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_usage_error_is_one_line_and_writes_nothing(
    capsys, monkeypatch, tmp_path, arguments, said
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.gsb").write_bytes(file_bytes(SCENE))
    (tmp_path / "old.ply").write_text("old")
    (tmp_path / "mine.zarr").mkdir()
    status, out, err = call(capsys, "export", *arguments)
    assert (status, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
    assert sorted(os.listdir(tmp_path)) == ["mine.zarr", "old.ply", "scene.gsb"]
    assert (tmp_path / "old.ply").read_text() == "old"


def test_a_zarr_is_replaced_whole_when_forced(capsys, tmp_path):
    (tmp_path / "of.gsb").write_bytes(file_bytes(SCENE))
    out = tmp_path / "a.zarr"
    arguments = ("export", tmp_path / "of.gsb", "-o", out, "--quiet")
    assert call(capsys, *arguments) == (0, "", "")
    (out / "stray").touch()
    assert call(capsys, *arguments)[0] == 2
    assert call(capsys, *arguments, "--force", "--level", 1) == (0, "", "")
    assert not (out / "stray").exists()
    assert zarr.open_array(out, mode="r").attrs["level"] == 1
    assert sorted(os.listdir(tmp_path)) == ["a.zarr", "of.gsb"]


def test_the_counts_are_printed_and_in_the_json(capsys, folder):
    out = folder / "counted.ply"
    status, said, _ = call(capsys, "export", folder / "scene.gsb", "-o", out)
    voxels, size = len(list(naive_voxels(SCENE, 0))), out.stat().st_size
    assert status == 0
    assert f"level 0, {voxels} voxels of " in said
    assert f"with normal, colour, mask, weight, {size:,} bytes" in said
    _, said, _ = call(capsys, "export", folder / "scene.gsb", "-o", out, "--force", "--json")
    held = json.loads(said)
    assert (held["voxels"], held["bytes"], held["kind"]) == (voxels, size, "ply")
    assert held["columns"] == ["normal", "colour", "mask", "weight"]
    assert held["left_out"] == []
