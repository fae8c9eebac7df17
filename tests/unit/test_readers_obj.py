"""OBJ: indices, polygons, continuations, colours, normals and materials."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gstream.errors import InputError
from gstream.readers import mtl, obj, open_mesh, text_blocks
from gstream.readers.mesh import Mesh

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def read(path: Path, text: str | bytes | None = None) -> Mesh:
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return open_mesh(path, lambda label: path.parent / "scratch" / f"{path.name}-{label}")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.obj"


def triangles(mesh: Mesh) -> list:
    assert mesh.triangles is not None
    return mesh.triangles.map().tolist()


@pytest.mark.parametrize(
    "face",
    ["1 2 3 4", "-4 -3 -2 -1", "1/9 2/9 3/9 4/9", "1//1 2//1 3//1 4//1",
     "1/1/1 2/1/1 -2/1/-1 4/1/1",
     "1 2 \\\n 3 4", "1 2\\\r\n3 4", "1 2 3 4 # a square", "1 2 3 \\\n\\\n 4 \\\n", "1/ 2/ 3/ 4/"],
)  # fmt: skip
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_every_form_of_a_face_gives_the_same_fan(path, face, end):
    text = "# made by a test\\\n" + SQUARE + "vn 0 0 1\nvt 0 0\n  f " + face
    mesh = read(path, text.replace("\r", "").replace("\n", end))
    assert triangles(mesh) == [[0, 1, 2], [0, 2, 3]]
    assert mesh.positions.map().tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert (mesh.faces, mesh.skipped_faces, dict(mesh.notes)) == (1, 0, {})


def test_points_lines_and_small_faces_are_counted_and_unknown_lines_noted(path):
    mesh = read(path, SQUARE + "p 1 2\nl 1 2 3\nf 1 2\nf 1 1 2\ncurv 0 1 2\no a\ng b\ns off\n")
    assert triangles(mesh) == [[0, 0, 1]]
    assert (mesh.faces, mesh.skipped_faces) == (2, 3)
    assert mesh.notes == {"lines_not_read": 1}


def test_vertices_may_follow_the_faces_that_use_them(path):
    assert triangles(read(path, "f 1 2 3\n" + SQUARE)) == [[0, 1, 2]]


def test_a_vertex_keeps_the_last_normal_that_a_face_gives_it(path):
    text = SQUARE + "vn 1 0 0\nvn 0 1 0\nf 1//1 2//1 3//1\nf 1//2 3//-1 4\n"
    mesh = read(path, text)
    assert mesh.normals is not None
    assert mesh.normals.map().tolist() == [[0, 1, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0]]


def test_normals_out_of_range_are_counted_and_read_as_none(path):
    mesh = read(path, SQUARE + "vn 1 0 0\nf 1//1 2//7 3//-2\n")
    assert mesh.normals is not None
    assert mesh.normals.map().tolist() == [[1, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    assert mesh.notes == {"normals_out_of_range": 2}


@pytest.mark.parametrize(("full", "half"), [("1", "0.5"), ("255", "127.5")])
def test_vertex_colours_are_0_to_1_unless_any_is_above_1(path, full, half):
    rows = f"v 0 0 0 {full} 0 0\nv 1 0 0\nv 1 1 0 0 {half} 0\nv 0 0 0 1.0\nf 1 2 3\n"
    mesh = read(path, rows)
    assert mesh.colours is not None
    white = [255] * 4
    assert mesh.colours.map().tolist() == [[255, 0, 0, 255], white, [0, 128, 0, 255], white]
    assert mesh.triangle_colours is None


def test_kd_of_materials_colours_triangles(path):
    (path.parent / "my lib.mtl").write_text(
        "newmtl red one\nKd 1 0 0.5\nnewmtl b\nKd 0.2\nKa 1 1 1\n"
    )
    faces = "f 1 2 3\nusemtl red one\nf 1 2 3 4\nusemtl b\nf 2 3 4\nusemtl c\nf 1 2 4"
    text = f"mtllib my lib.mtl\n{SQUARE}{faces}"
    mesh = read(path, text)
    assert mesh.triangle_colours is not None
    white, red = [255] * 4, [255, 0, 128, 255]
    assert mesh.triangle_colours.map().tolist() == [white, red, red, [51, 51, 51, 255], white]
    assert mesh.notes == {"materials_without_colour": 1}


@pytest.mark.parametrize("library", ["a.mtl b.mtl", "a\\ b.mtl", "sub/../a.mtl", "sub\\..\\a.mtl"])
def test_libraries_are_found_by_every_spelling_of_their_name(path, library):
    (path.parent / "sub").mkdir()
    for name in ("a.mtl", "a b.mtl", "b.mtl"):
        (path.parent / name).write_text("newmtl m\nKd 1 1 0\n")
    mesh = read(path, f"mtllib {library}\n{SQUARE}usemtl m\nf 1 2 3")
    assert mesh.triangle_colours is not None
    assert mesh.notes == {}


def test_libraries_are_named_with_the_mesh_whether_they_are_there_or_not(path):
    (path.parent / "b.mtl").write_text("newmtl m\nKd 1 1 0\n")
    mesh = read(path, f"mtllib a b.mtl\nmtllib ../c.mtl\n{SQUARE}f 1 2 3")
    assert mesh.beside == tuple(str(path.parent / name) for name in ("a", "a b.mtl", "b.mtl"))


def test_a_missing_library_is_tolerated_and_counted(path):
    mesh = read(path, f"mtllib none.mtl\n{SQUARE}usemtl m\nf 1 2 3")
    assert mesh.triangle_colours is None
    assert mesh.notes == {"material_files_missing": 1, "materials_without_colour": 1}


@pytest.mark.parametrize(
    "library",
    ["../secret.mtl", "sub/../../secret.mtl", "{outside}/secret.mtl", "file://{outside}/secret.mtl",
     "..\\secret.mtl", "\\\\server\\secret.mtl", "C:\\secret.mtl", "link.mtl", "linked/secret.mtl",
     "secret.mtl/../../secret.mtl"],
)  # fmt: skip
def test_no_library_outside_the_inputs_folder_is_ever_opened(tmp_path, library):
    folder = tmp_path / "in"
    folder.mkdir()
    secret = tmp_path / "secret.mtl"
    secret.write_text("newmtl m\nKd 1 0 0\n")
    (folder / "link.mtl").symlink_to(secret)
    (folder / "linked").symlink_to(tmp_path)
    opened: list[str] = []
    watching = [True]

    def hook(event: str, args: tuple) -> None:
        if watching[0] and event == "open" and isinstance(args[0], str | os.PathLike):
            opened.append(os.path.realpath(args[0]))

    sys.addaudithook(hook)
    text = f"mtllib {library.format(outside=tmp_path)}\n{SQUARE}usemtl m\nf 1 2 3"
    mesh = read(folder / "a.obj", text)
    watching[0] = False
    assert os.path.realpath(secret) not in opened
    assert mesh.triangle_colours is None
    assert mesh.notes["material_files_outside"] == 1


def test_names_that_the_system_refuses_are_outside(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name in (b"a\0b", b"x" * 5000 + b"/y", b"loop/a.mtl"):
        found = mtl.inside(tmp_path, name)
        assert found is None or not found.is_relative_to("/etc")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("v 1 2\nf 1 1 1", "line 1: a vertex or normal has fewer than three coordinates"),
        ("v 1 2 x\n", "line 1: 'x' is not a number"),
        (SQUARE + "\nf 1 2 -5\n", "line 6: face 0 has the vertex '-5', 4 stand before it"),
        (SQUARE + "f 1 2 0\n", "line 5: face 0 has the vertex '0', 4 stand before it"),
        (SQUARE + "f 1 2 2.5\n", "line 5: face 0 has the vertex '2.5', 4 stand before it"),
        (SQUARE + "f 1 2 3\nf 1 2 9\n", "face 1: has the vertex 9, the file has 4"),
        (SQUARE + "f 1 2 99999999999999999999\n", "face 0: has the vertex"),
        ("v 0 0 \0\n", "line 1: holds a zero byte"),
        ("# nothing\n", "has no faces; "),
        (SQUARE + "l 1 2\n", "has no faces, only 1 points, lines"),
    ],
)
def test_errors_are_one_line_with_file_place_and_remedy(path, text, said):
    with pytest.raises(InputError) as caught:
        read(path, text)
    assert str(caught.value).startswith(f"{path}: {said}")
    assert "\n" not in str(caught.value)
    assert "; " in str(caught.value)


def test_a_byte_order_mark_and_latin_1_comments_are_no_hindrance(path):
    text = b"\xef\xbb\xbf# Ger\xe4te\n" + SQUARE.encode() + b"o B\xfcste\nf 1 2 3"
    assert triangles(read(path, text)) == [[0, 1, 2]]


@given(
    st.lists(st.tuples(*[st.floats(allow_nan=False)] * 3), min_size=3, max_size=20),
    st.data(),
    st.integers(1, 6),
)
def test_blocks_of_any_size_give_pythons_floats_and_the_same_fans(
    tmp_path_factory, points, data, size
):
    ids = st.integers(1, len(points))
    faces = data.draw(st.lists(st.lists(ids, min_size=3, max_size=12), min_size=1, max_size=9))
    signed = [[i if k % 2 else i - len(points) - 1 for k, i in enumerate(f)] for f in faces]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points]
    lines += ["f " + " ".join(map(str, f)) for f in signed]
    path = tmp_path_factory.mktemp("obj") / "a.obj"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text_blocks, "BLOCK", 32 * size)
        patch.setattr(obj, "ROWS", size)
        patch.setattr(obj, "SLOW", 8 * size)
        mesh = read(path, "\n".join(lines))
        positions = mesh.positions.map()
    np.testing.assert_array_equal(positions, np.array(points))
    fans = [[f[0] - 1, f[i] - 1, f[i + 1] - 1] for f in faces for i in range(1, len(f) - 1)]
    assert triangles(mesh) == fans
