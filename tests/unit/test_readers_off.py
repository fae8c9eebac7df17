"""OFF: text and binary, with every prefix and colour that Geomview's manual has."""

import struct
from pathlib import Path

import pytest

from gstream.errors import InputError
from gstream.readers import open_mesh
from gstream.readers.mesh import Mesh

SQUARE = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
PLACES = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
FANS = [[0, 1, 2], [0, 2, 3]]
WHITE = [255] * 4


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.off"


def read(path: Path, content: str | bytes) -> Mesh:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return open_mesh(path, lambda label: path.parent / "scratch" / f"{path.name}-{label}")


def triangles(mesh: Mesh) -> list:
    assert mesh.triangles is not None
    return mesh.triangles.map().tolist()


@pytest.mark.parametrize(
    "text",
    [
        f"OFF\n4 1 0\n{SQUARE}4 0 1 2 3\n",
        f"OFF 4 1 0\n\n{SQUARE}\n4 0 1 2 3",
        f"4 1 4\n{SQUARE}4 0 1 2 3\n",
        f"# by a test\n  OFF # magic\n# counts\n4 1\n{SQUARE}#\n4 0 1 2 3#last\n",
        f"OFF\r\n4 1 0\r\n{SQUARE}4 0 1 2 3\r\n".replace("\n", "\r\n").replace("\r\r", "\r"),
        f"OFF\n4 1 0\n{SQUARE}4 0 1 2 3\n".replace("\n", "\r"),
        f"OFF\n4 1 0\n{SQUARE}4 0\n1 2\n3\n",
    ],
)
def test_counts_comments_and_line_ends_may_stand_in_any_usual_way(path, text):
    mesh = read(path, text)
    assert triangles(mesh) == FANS
    assert mesh.positions.map().tolist() == PLACES
    assert (mesh.faces, mesh.skipped_faces, dict(mesh.notes)) == (1, 0, {})
    assert mesh.colours is mesh.triangle_colours is mesh.normals is None


def _rows(extra: str) -> str:
    return "".join(f"{line} {extra}\n" for line in SQUARE.splitlines())


@pytest.mark.parametrize(
    ("magic", "extra", "code"),
    [
        ("COFF", "255 128 0 7", [255, 128, 0, 7]),
        ("COFF", "255 128 0", [255, 128, 0, 255]),
        ("COFF", "1.0 0.5 0 0.0", [255, 128, 0, 0]),
        ("COFF", "1 1 1 1", [1, 1, 1, 1]),
        ("COFF", "255.0 128.0 0 255", [255, 128, 0, 255]),
        ("STCOFF", "255 128 0 7 0.5 0.5", [255, 128, 0, 7]),
        ("CNOFF", "0 0 1 255 128 0 7", [255, 128, 0, 7]),
        ("STCNOFF", "0 0 1 255 128 0 7 0.5 1", [255, 128, 0, 7]),
    ],
)
def test_vertex_colours_are_integers_to_255_or_reals_to_1(path, magic, extra, code):
    mesh = read(path, f"{magic}\n4 1 0\n{_rows(extra)}4 0 1 2 3\n")
    assert mesh.colours is not None
    assert mesh.colours.map().tolist() == [code] * 4
    assert (mesh.normals is not None) == ("N" in magic)
    assert mesh.positions.map().tolist() == PLACES


def test_vertex_normals_are_read(path):
    mesh = read(path, f"NOFF\n4 1 0\n{_rows('0 -0.5 1')}4 0 1 2 3\n")
    assert mesh.normals is not None
    assert mesh.normals.map().tolist() == [[0, -0.5, 1]] * 4


def test_values_that_no_prefix_announces_are_noted(path):
    mesh = read(path, f"OFF\n4 1 0\n{_rows('7 8')}4 0 1 2 3\n")
    assert mesh.notes == {"vertices_with_values_beyond_the_header": 4}


def test_face_colours_are_optional_on_every_face(path):
    faces = "3 0 1 2\n4 0 1 2 3 255 0 9\n3 0 1 2 0.5 0.0 1.0 0.0\n3 0 1 2 17\n2 0 1 1 1 1\n"
    mesh = read(path, f"OFF\n4 5 0\n{SQUARE}{faces}")
    assert mesh.triangle_colours is not None
    red, half = [255, 0, 9, 255], [128, 0, 255, 0]
    assert mesh.triangle_colours.map().tolist() == [WHITE, red, red, half, WHITE]
    assert (mesh.faces, mesh.skipped_faces) == (5, 1)


@pytest.mark.parametrize("order", [">", "<"])
@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("magic", [b"OFF", b"NOFF", b"COFF"])
def test_binary_in_both_orders_with_and_without_colour_counts(path, order, counted, magic):
    extra = {b"OFF": [], b"NOFF": [0, 0, 1], b"COFF": [1, 0.5, 0, 0]}[magic]
    data = magic + b" BINARY\n" + struct.pack(order + "3i", 4, 2, 0)
    for place in PLACES:
        data += struct.pack(f"{order}{3 + len(extra)}f", *place, *extra)
    for ids in FANS:
        data += struct.pack(order + "4i", 3, *ids)
        if counted:
            data += struct.pack(order + "i3f", 3, 1, 0, 0.5)
    mesh = read(path, data)
    assert triangles(mesh) == FANS
    assert mesh.positions.map().tolist() == PLACES
    if magic == b"COFF":
        assert mesh.colours is not None
        assert mesh.colours.map().tolist() == [[255, 128, 0, 0]] * 4
    if magic == b"NOFF":
        assert mesh.normals is not None
        assert mesh.normals.map().tolist() == [[0, 0, 1]] * 4
    if counted:
        assert mesh.triangle_colours is not None
        assert mesh.triangle_colours.map().tolist() == [[255, 0, 128, 255]] * 2
    for size in range(len(data) - 40, len(data)):
        with pytest.raises(InputError):
            read(path, data[:size])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"OFF\n4 1 0\n{SQUARE}3 0 1 4\n", "line 7: face 0 has the vertex '4', there are 4"),
        (f"OFF\n4 1 0\n{SQUARE}3 0 1 -1\n", "line 7: face 0 has the vertex '-1', there are 4"),
        (f"OFF\n4 1 0\n{SQUARE}-3 0 1 2\n", "line 7: face 0 has a list of '-3' entries"),
        (f"OFF\n4 2 0\n{SQUARE}3 0 1 2\n", "line 7: the file ends inside face 1 of 2"),
        ("OFF\n4 1 0\n0.00 0.00 0.00\n1 0 zero\n", "line 4: 'zero' is not a number"),
        (
            "OFF\n1152921504606846976 1 0\n0 0 0\n",
            "line 2: the header promises 1152921504606846976",
        ),
        ("OFF\n4.5 1 0\n", "line 2: 4.5 vertices and 1 faces are no counts"),
        ("OFF\n", "line 1: the file ends inside the header"),
        (f"4OFF\n4 1 0\n{SQUARE}", "line 1: has vertices in more than 3 dimensions"),
        (f"OFF\n4 0 0\n{SQUARE}", "has no faces"),
    ],
)
def test_errors_are_one_line_with_file_place_and_remedy(path, text, said):
    with pytest.raises(InputError) as caught:
        read(path, text)
    assert str(caught.value).startswith(f"{path}: {said}")
    assert "\n" not in str(caught.value)
    assert "; " in str(caught.value)
