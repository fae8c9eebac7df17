"""STL, binary whatever its header says, and ASCII with any line ends."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gstream.errors import InputError
from gstream.readers import needs_spill, open_mesh, stl_text, text_blocks
from gstream.readers.mesh import Mesh

CORNERS = [[(0.0, 0.0, 0.0), (1.0, 0.5, 0.0), (0.0, 1.0, -2.25)], [(9.0, 8.0, 7.0)] * 3]


def read(path: Path) -> Mesh:
    return open_mesh(path, lambda label: path.parent / "scratch" / f"{path.name}-{label}")


def binary(head: bytes, facets: list, tail: bytes = b"") -> bytes:
    body = b"".join(
        struct.pack("<12fH", 0, 0, 1, *(c for corner in facet for c in corner), 0xABCD)
        for facet in facets
    )
    return head.ljust(80, b" ")[:80] + struct.pack("<I", len(facets)) + body + tail


def ascii_stl(facets: list, end: str = "\n", name: str = "a vertex") -> bytes:
    lines = [f"solid {name}"]
    for facet in facets:
        lines += ["  facet normal 0 0 1", "    outer loop"]
        lines += [f"      vertex {x!r} {y!r} {z!r}" for x, y, z in facet]
        lines += ["    endloop", "  endfacet"]
    return end.join([*lines, f"endsolid {name}", ""]).encode()


@pytest.mark.parametrize("head", [b"", b"solid but binary", b"solid \0", b"COLOR=abcd"])
@pytest.mark.parametrize("tail", [b"", b"\0\0 trailing"])
def test_binary_is_mapped_as_a_soup_whatever_stands_in_its_header(tmp_path, head, tail):
    path = tmp_path / "a.stl"
    path.write_bytes(binary(head, CORNERS * 30, tail))
    if head.startswith(b"solid b") and tail:
        tail = b""
        path.write_bytes(binary(head, CORNERS * 30))
    assert not needs_spill(path)
    mesh = read(path)
    assert mesh.triangles is None
    assert mesh.triangle_count == mesh.faces == 60
    assert mesh.vertex_count == 180
    assert mesh.positions.map().tolist() == [[list(c) for c in f] for f in CORNERS * 30]
    assert mesh.notes == ({"trailing_bytes": len(tail)} if tail else {})


def test_a_cut_binary_file_names_the_byte_and_the_triangle(tmp_path):
    path = tmp_path / "a.stl"
    path.write_bytes(binary(b"x", CORNERS)[:150])
    with pytest.raises(InputError, match=r"a.stl: byte 150: .* promises 2 .* ends in number 1"):
        read(path)


def test_a_binary_file_of_no_triangles_has_no_faces(tmp_path):
    path = tmp_path / "a.stl"
    path.write_bytes(binary(b"x", []))
    with pytest.raises(InputError, match="has no faces"):
        read(path)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_ascii_reads_every_solid_with_any_line_ends(tmp_path, end):
    path = tmp_path / "a.stl"
    path.write_bytes(ascii_stl(CORNERS, end) + ascii_stl([], end) + ascii_stl(CORNERS[:1], end, ""))
    assert needs_spill(path)
    mesh = read(path)
    assert mesh.positions.map().tolist() == [[list(c) for c in f] for f in [*CORNERS, CORNERS[0]]]
    assert mesh.triangles is None
    assert mesh.faces == 3


def test_ascii_keywords_have_any_case_and_ends_may_be_followed_by_words(tmp_path):
    path = tmp_path / "a.stl"
    text = (
        ascii_stl(CORNERS)
        .upper()
        .replace(b"ENDFACET", b"ENDFACET done")
        .replace(b"SOLID A", b"SOLID")
    )
    path.write_bytes(text.replace(b"ENDLOOP", b"EndLoop of 3"))
    assert read(path).triangle_count == 2


@given(
    st.lists(
        st.lists(st.tuples(*[st.floats(width=32)] * 3), min_size=3, max_size=3),
        min_size=1,
        max_size=9,
    ),
    st.integers(1, 5),
)
def test_ascii_blocks_of_any_size_give_pythons_floats(tmp_path_factory, facets, size):
    path = tmp_path_factory.mktemp("stl") / "a.stl"
    path.write_bytes(ascii_stl(facets))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text_blocks, "BLOCK", 100 * size)
        patch.setattr(stl_text, "FACETS", size)
        positions = read(path).positions.map()
    np.testing.assert_array_equal(positions, np.array(facets))


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (b"vertex 0.0 0.0 0.0", b"vertex 0.0 x 0.0", "line 4: 'x' is not a coordinate"),
        (b"vertex 0.0 0.0 0.0", b"", "line 8: 'endfacet' stands where"),
        (b"outer loop", b"outer lop", "line 3: 'lop' is no word of an ASCII STL"),
        (b"endloop", b"vertex 1 2 3\nendloop", "line 7: 'vertex' stands where"),
    ],
)
def test_ascii_errors_name_the_line(tmp_path, before, after, said):
    path = tmp_path / "a.stl"
    path.write_bytes(ascii_stl(CORNERS).replace(before, after, 1))
    with pytest.raises(InputError) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: {said}")


def test_ascii_cut_anywhere_is_refused_also_between_facets(tmp_path):
    data = ascii_stl(CORNERS)
    path = tmp_path / "a.stl"
    for size in range(data.index(b"facet normal"), data.rindex(b"endsolid") + 7):
        path.write_bytes(data[:size])
        with pytest.raises(InputError, match=r"a.stl: line \d+: "):
            read(path)


def test_text_that_is_no_stl_is_refused(tmp_path):
    path = tmp_path / "a.stl"
    path.write_text("<!DOCTYPE html>" + "not here " * 20)
    with pytest.raises(InputError, match="is text without the word 'solid'"):
        read(path)
