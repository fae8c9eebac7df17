"""PLY in every coding: each test writes the bytes itself and compares with what it meant."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gstream.errors import InputError
from gstream.readers import needs_spill, number_source, open_mesh, record_walk, text_blocks
from gstream.readers.mesh import Mesh

CODINGS = ("ascii", "binary_little_endian", "binary_big_endian")
CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I",
         "float": "f", "double": "d"}  # fmt: skip
XYZ = "property float x\nproperty float y\nproperty float z\n"
SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def write_ply(path: Path, coding: str, elements: list, end: str = "\n") -> Path:
    """elements: (name, [(property, type) or (property, count type, type)], rows)."""
    head = ["ply", f"format {coding} 1.0", "comment made by a test"]
    body = b""
    for name, properties, rows in elements:
        head.append(f"element {name} {len(rows)}")
        for label, *types in properties:
            head.append(f"property {'list ' if len(types) > 1 else ''}{' '.join(types)} {label}")
        for row in rows:
            body += _row(coding, properties, row)
    path.write_bytes(end.join([*head, "end_header", ""]).encode() + body)
    return path


def _row(coding: str, properties: list, row: tuple) -> bytes:
    flat = []
    for (_, *types), value in zip(properties, row, strict=True):
        items = [(types[0], len(value)), *((types[1], v) for v in value)] if len(types) > 1 else [
            (types[0], value)
        ]  # fmt: skip
        flat += items
    if coding == "ascii":
        return (" ".join(f"{v!r}" for _, v in flat) + "\n").encode()
    order = "<" if "little" in coding else ">"
    return b"".join(struct.pack(order + CODES[kind], v) for kind, v in flat)


def read(path: Path, folder: Path | None = None) -> Mesh:
    folder = folder or path.parent / "scratch"
    return open_mesh(path, lambda label: folder / f"{path.name}-{label}")


def vertex(kind: str = "float", rows=SQUARE) -> tuple:
    return ("vertex", [(axis, kind) for axis in "xyz"], rows)


def face(rows, count: str = "uchar", kind: str = "int", name: str = "face") -> tuple:
    return (name, [("vertex_indices", count, kind)], [(ids,) for ids in rows])


def triangles(mesh: Mesh) -> list:
    assert mesh.triangles is not None
    array = mesh.triangles.map()
    assert array.shape == (mesh.triangle_count, 3)
    return array.tolist()


@pytest.mark.parametrize("coding", CODINGS)
@pytest.mark.parametrize("kind", ["float", "double"])
def test_triangles_and_positions_are_those_written(tmp_path, coding, kind):
    path = write_ply(tmp_path / "a.ply", coding, [vertex(kind), face([(0, 1, 2), (0, 2, 3)])])
    mesh = read(path)
    assert triangles(mesh) == [[0, 1, 2], [0, 2, 3]]
    assert mesh.positions.map().tolist() == [list(map(float, p)) for p in SQUARE]
    assert mesh.positions.map().dtype.itemsize == (4 if kind == "float" else 8)
    assert (mesh.faces, mesh.skipped_faces, mesh.vertex_count) == (2, 0, 4)


@pytest.mark.parametrize("coding", CODINGS[1:])
def test_a_binary_file_of_triangles_is_mapped_and_writes_no_scratch(tmp_path, coding):
    path = write_ply(tmp_path / "a.ply", coding, [vertex(), face([(0, 1, 2)] * 9)])
    assert not needs_spill(path)
    read(path, tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("coding", CODINGS)
def test_polygons_become_fans_and_small_faces_are_counted(tmp_path, coding):
    faces = [(0, 1, 2, 3), (0, 1), (3, 2, 1), (1,), (), (0, 1, 1)]
    mesh = read(write_ply(tmp_path / "a.ply", coding, [vertex(), face(faces)]))
    assert triangles(mesh) == [[0, 1, 2], [0, 2, 3], [3, 2, 1], [0, 1, 1]]
    assert (mesh.faces, mesh.skipped_faces) == (6, 3)


@pytest.mark.parametrize("coding", CODINGS)
def test_strips_alternate_their_winding_and_restart_at_minus_one(tmp_path, coding):
    strips = face([(0, 1, 2, 3, -1, 3, 2, 1)], "int", name="tristrips")
    mesh = read(write_ply(tmp_path / "a.ply", coding, [vertex(), strips]))
    assert triangles(mesh) == [[0, 1, 2], [2, 1, 3], [3, 2, 1]]


@pytest.mark.parametrize("coding", CODINGS)
def test_other_elements_and_properties_before_between_and_after_are_passed_over(tmp_path, coding):
    elements = [
        ("camera", [("view", "float"), ("names", "ushort", "double")],
         [(1.5, (1.0, 2.0)), (2.5, ())]),
        ("vertex",
         [("q", "double"), ("x", "float"), ("y", "float"), ("t", "short"), ("z", "float")],
         [(0.25, *p[:2], -7, p[2]) for p in SQUARE]),
        ("range_grid", [("vertex_indices", "uchar", "int")], [((3,),), ((),)]),
        ("face", [("flags", "uchar"), ("uv", "uchar", "float"), ("vertex_index", "uint", "ushort")],
         [(9, (0.5, 0.5), (0, 1, 2)), (8, (), (0, 2, 3))]),
        ("edge", [("vertex1", "int"), ("vertex2", "int")], [(0, 1)]),
    ]  # fmt: skip
    mesh = read(write_ply(tmp_path / "a.ply", coding, elements))
    assert triangles(mesh) == [[0, 1, 2], [0, 2, 3]]
    assert mesh.positions.map().tolist() == [list(map(float, p)) for p in SQUARE]
    assert mesh.skipped_faces == 1


@pytest.mark.parametrize("coding", CODINGS)
@pytest.mark.parametrize(
    ("labels", "kind", "values", "codes"),
    [
        (("red", "green", "blue"), "uchar", (1, 2, 3), (1, 2, 3)),
        (("diffuse_red", "diffuse_green", "diffuse_blue"), "uchar", (1, 2, 3), (1, 2, 3)),
        (("red", "green", "blue", "alpha"), "uchar", (1, 2, 3, 4), (1, 2, 3, 4)),
        (("r", "g", "b", "a"), "float", (0.0, 0.5, 1.0, 2.0), (0, 128, 255, 255)),
        (("red", "green", "blue"), "ushort", (0, 257, 65535), (0, 1, 255)),
    ],
)
def test_vertex_and_face_colours_in_their_usual_spellings(
    tmp_path, coding, labels, kind, values, codes
):
    properties = [(label, kind) for label in labels]
    elements = [
        ("vertex", [*vertex()[1], *properties], [(*p, *values) for p in SQUARE]),
        ("face", [("vertex_indices", "uchar", "int"), *properties], [((0, 1, 2, 3), *values)]),
    ]
    mesh = read(write_ply(tmp_path / "a.ply", coding, elements))
    assert mesh.colours is not None
    assert mesh.triangle_colours is not None
    colours, painted = mesh.colours.map(), mesh.triangle_colours.map()
    assert colours.dtype == painted.dtype == np.uint8
    assert colours[:, :3].tolist() == [list(codes[:3])] * 4
    assert painted.tolist() == [list((*codes, 255)[:4])] * 2


@pytest.mark.parametrize("coding", CODINGS)
@pytest.mark.parametrize("labels", [("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z")])
@pytest.mark.parametrize("kind", ["float", "double"])
def test_vertex_normals_in_both_spellings(tmp_path, coding, labels, kind):
    properties = [*vertex()[1], *((label, kind) for label in labels)]
    rows = [(*p, 0.5, -0.25, 1.0) for p in SQUARE]
    elements = [("vertex", properties, rows), face([(0, 1, 2)])]
    mesh = read(write_ply(tmp_path / "a.ply", coding, elements))
    assert mesh.normals is not None
    assert mesh.normals.map().tolist() == [[0.5, -0.25, 1.0]] * 4
    assert mesh.normals.map().dtype.itemsize == 4


@pytest.mark.parametrize("coding", CODINGS)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_headers_may_end_their_lines_in_any_way(tmp_path, coding, end):
    path = write_ply(tmp_path / "a.ply", coding, [vertex(), face([(0, 1, 2)])], end)
    assert triangles(read(path)) == [[0, 1, 2]]


def test_ascii_floats_are_rounded_to_the_type_that_the_header_declares(tmp_path):
    path = tmp_path / "a.ply"
    body = "0.1 0.2 0.3\n1 0 0\n0 1 0\n3 0 1 2\n"
    for kind, dtype in (("float", "<f4"), ("double", "<f8")):
        head = f"ply\nformat ascii 1.0\nelement vertex 3\n{XYZ.replace('float', kind)}"
        tail = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        path.write_text(head + tail + body)
        first = read(path).positions.map()[0]
        assert first.tolist() == np.array([0.1, 0.2, 0.3], dtype).tolist()


@given(
    st.lists(st.lists(st.integers(0, 9), max_size=9), min_size=1, max_size=12).filter(
        lambda faces: any(len(f) >= 3 for f in faces)
    ),
    st.sampled_from(CODINGS),
    st.integers(1, 7),
)
def test_blocks_of_any_size_give_the_same_mesh(tmp_path_factory, faces, coding, size):
    folder = tmp_path_factory.mktemp("blocks")
    rows = [(i * 0.5, -i, i / 7, i) for i in range(10)]
    elements = [
        ("vertex", [*vertex()[1], ("nothing", "double")], rows),
        ("face",
         [("vertex_indices", "uchar", "int"), *((c, "uchar") for c in ("red", "green", "blue"))],
         [(f, i, i, 7) for i, f in enumerate(faces)]),
    ]  # fmt: skip
    path = write_ply(folder / "a.ply", coding, elements)
    whole = read(path, folder / "whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text_blocks, "BLOCK", 64 * size)
        patch.setattr(number_source, "BYTES", 16 * size)
        patch.setattr(number_source, "BATCH", 3 * size)
        patch.setattr(record_walk, "BATCH", 3 * size)
        parts = read(path, folder / "parts")
    expected = [[f[0], f[i], f[i + 1]] for f in faces for i in range(1, len(f) - 1)]
    painted = [[i, i, 7, 255] for i, f in enumerate(faces) for _ in range(len(f) - 2)]
    for mesh in (whole, parts):
        assert triangles(mesh) == expected
        assert mesh.skipped_faces == sum(len(f) < 3 for f in faces)
        assert mesh.positions.map().tolist() == [list(np.float32(r[:3]).tolist()) for r in rows]
        assert mesh.triangle_colours is not None
        assert mesh.triangle_colours.map().tolist() == painted


def _refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read(path)
    said = str(caught.value)
    assert "\n" not in said
    assert said.startswith(str(path))
    return said.removeprefix(f"{path}: ")


@pytest.mark.parametrize("coding", CODINGS)
def test_an_id_out_of_range_names_the_face_and_the_vertex_count(tmp_path, coding):
    faces = face([(0, 1, 2), (0, 1, 2, 4)])
    said = _refused(write_ply(tmp_path / "a.ply", coding, [vertex(), faces]))
    assert "face 1 has the vertex" in said
    assert "there are 4" in said


@pytest.mark.parametrize("coding", CODINGS)
def test_a_file_cut_anywhere_is_refused_with_its_place(tmp_path, coding):
    elements = [vertex(), face([(0, 1, 2, 3), (0, 1, 2)])]
    data = write_ply(tmp_path / "a.ply", coding, elements).read_bytes()
    body = data.index(b"end_header\n") + len(b"end_header\n")
    for size in range(body, len(data) - 2):
        (tmp_path / "a.ply").write_bytes(data[:size])
        said = _refused(tmp_path / "a.ply")
        assert said.startswith(("byte ", "line "))
        assert "ends inside" in said


@pytest.mark.parametrize("coding", CODINGS)
def test_a_promise_of_2_to_the_60_vertices_is_refused_before_anything_is_allocated(
    tmp_path, coding
):
    path = write_ply(tmp_path / "a.ply", coding, [vertex(), face([(0, 1, 2)])])
    path.write_bytes(path.read_bytes().replace(b"vertex 4", b"vertex %d" % 2**60))
    assert "ends inside element vertex" in _refused(path)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("1 zwei 3", "line 10: 'zwei' is not a number"),
        ("1 0x10 3", "line 10: '0x10' is not a number"),
        ("1 2 3 4", "line 10: vertex 1 has more values than the header gives it"),
    ],
)
def test_a_bad_line_of_text_is_named(tmp_path, line, said):
    head = f"ply\nformat ascii 1.0\nelement vertex 2\n{XYZ}element face 1\n"
    text = head + f"property list uchar int vertex_indices\nend_header\n0 0 0\n{line}\n3 0 1 0\n"
    (tmp_path / "a.ply").write_text(text.replace("end_header\n0", "end_header\n0"))
    assert _refused(tmp_path / "a.ply").startswith(said.replace("line 10", "line 11"))


def test_a_scan_without_faces_is_refused(tmp_path):
    grid = ("range_grid", [("vertex_indices", "uchar", "int")], [((0,),)])
    assert "has no faces" in _refused(write_ply(tmp_path / "a.ply", "ascii", [vertex(), grid]))
    assert "has no faces" in _refused(write_ply(tmp_path / "b.ply", "ascii", [vertex(), face([])]))
    pair = face([(0, 1)])
    assert "has no faces, only 1 " in _refused(
        write_ply(tmp_path / "c.ply", "ascii", [vertex(), pair])
    )


@pytest.mark.parametrize(
    "broken",
    [
        b"ply\n",
        b"ply\nformat ascii 1.0\nend_heade",
        b"ply\nformat ascii\nend_header\n",
        b"ply\nformat ascii 1.0\nelement vertex -1\nend_header\n",
        b"ply\nformat ascii 1.0\nproperty float x\nend_header\n",
        b"ply\nformat ascii 1.0\nelement face 1\nproperty list uchar string x\nend_header\n",
        b"ply\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n",
    ],
)
def test_a_broken_header_names_its_line(tmp_path, broken):
    (tmp_path / "a.ply").write_bytes(broken)
    assert _refused(tmp_path / "a.ply").startswith(("line ", "header: "))
