"""Which reader opens a file, what is refused by its first bytes, and the mesh that comes back."""

import gzip
import os
import pickle
from pathlib import Path

import numpy as np
import pytest

from gstream.errors import InputError, UsageError
from gstream.readers import needs_spill, open_mesh
from gstream.readers.mesh import DiskArray, Mesh
from gstream.readers.warm import SAMPLES, warm_readers

OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
CONTENTS = [(suffix, content) for suffix, contents in SAMPLES.items() for content in contents]


def read(path: Path) -> Mesh:
    return open_mesh(path, lambda label: path.parent / "scratch" / f"{path.name}-{label}")


@pytest.mark.parametrize(("suffix", "content"), CONTENTS)
def test_content_decides_the_format_where_it_can(tmp_path, suffix, content):
    name = "a.obj" if suffix == ".obj" else "a.bin"
    (tmp_path / name).write_bytes(content)
    assert read(tmp_path / name).triangle_count >= 1


@pytest.mark.parametrize(("suffix", "content"), CONTENTS)
def test_gzipped_files_give_the_same_mesh_and_leave_no_copy(tmp_path, suffix, content):
    plain, packed = tmp_path / f"a{suffix}", tmp_path / f"b{suffix.upper()}.gz"
    plain.write_bytes(content)
    packed.write_bytes(gzip.compress(content[:20]) + gzip.compress(content[20:]))
    assert needs_spill(packed)
    one, two = read(plain), read(packed)
    np.testing.assert_array_equal(one.positions.map(), two.positions.map())
    assert one.triangle_count == two.triangle_count
    inflated = tmp_path / "scratch" / f"{packed.name}-inflated"
    assert inflated.exists() == two.lies_in(inflated)


def test_a_gzipped_binary_stl_is_mapped_in_scratch(tmp_path):
    data = b"x" * 80 + (2).to_bytes(4, "little") + bytes(100)
    (tmp_path / "a.stl.gz").write_bytes(gzip.compress(data))
    assert read(tmp_path / "a.stl.gz").positions.map().shape == (2, 3, 3)


def test_a_gzipped_obj_finds_its_materials_beside_itself(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl m\nKd 1 0 0\n")
    content = b"mtllib m.mtl\nusemtl m\n" + OBJ
    (tmp_path / "a.obj.gz").write_bytes(gzip.compress(content))
    colours = read(tmp_path / "a.obj.gz").triangle_colours
    assert colours is not None
    assert colours.map().tolist() == [[255, 0, 0, 255]]


@pytest.mark.parametrize("damage", ["cut", "checksum", "body", "twice"])
def test_a_damaged_gzip_is_refused_with_its_place(tmp_path, damage):
    data = bytearray(gzip.compress(OBJ * 50))
    if damage == "cut":
        data = data[:-9]
    elif damage == "twice":
        data = bytearray(gzip.compress(data))
    else:
        data[-6 if damage == "checksum" else 30] ^= 0xFF
    (tmp_path / "a.obj.gz").write_bytes(data)
    with pytest.raises(InputError, match=r"is compressed twice|byte .* of the decompressed data"):
        read(tmp_path / "a.obj.gz")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.ply", b"version https://git-lfs.github.com/spec/v1\noid", "is a Git LFS .*lfs pull"),
        ("a.obj", b"", "is empty; copy"),
        ("a.obj", OBJ.decode().encode("utf-16"), "byte 0: is UTF-16 text"),
        ("a.obj", OBJ.decode().encode("utf-16-le"), "line 1: holds a zero byte"),
        ("a.ply", OBJ, "line 1: the first line is not 'ply'"),
        ("a.glb", b"glTF\2\0\0\0", "is of no known mesh format; gstream reads PLY, STL, OBJ"),
        ("a", b"hello", "is of no known mesh format"),
    ],
)  # fmt: skip
def test_what_is_no_mesh_is_refused_and_says_why(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=said) as caught:
        read(tmp_path / name)
    assert caught.value.exit_code == 4
    assert "\n" not in str(caught.value)


def test_paths_that_cannot_be_read_are_usage_errors(tmp_path):
    os.mkfifo(tmp_path / "pipe.obj")
    for path in (tmp_path / "none.obj", tmp_path, tmp_path / "pipe.obj", tmp_path / ("x" * 300)):
        with pytest.raises(UsageError):
            read(path)
        with pytest.raises(UsageError):
            needs_spill(path)


@pytest.mark.parametrize(("suffix", "content"), CONTENTS)
def test_a_mesh_survives_json_and_pickle(tmp_path, suffix, content):
    (tmp_path / f"a{suffix}").write_bytes(content)
    mesh = read(tmp_path / f"a{suffix}")
    assert Mesh.from_json(mesh.to_json()) == mesh
    assert pickle.loads(pickle.dumps(mesh)) == mesh


def test_a_disk_array_maps_strides_and_byte_orders_read_only(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"?" + np.arange(12, dtype=">i2").tobytes())
    array = DiskArray(str(path), 3, ">i2", (3, 2), (8, 2)).map()
    assert array.tolist() == [[1, 2], [5, 6], [9, 10]]
    assert not array.flags.writeable
    assert DiskArray(str(path), 99, "<f4", (0, 3), (12, 4)).map().shape == (0, 3)


def test_a_file_that_shrank_after_it_was_opened_is_an_input_error(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(bytes(23))
    with pytest.raises(InputError, match="byte 23: the file ends before byte 24"):
        DiskArray(str(path), 0, "<f4", (2, 3), (12, 4)).map()


def test_warming_takes_any_suffix():
    assert warm_readers([".PLY", ".weird"]) is None  # it raises for none
