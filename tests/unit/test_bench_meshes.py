"""The generated sphere is what the benchmarks say it is."""

from pathlib import Path

import numpy as np
import pytest

from tests.bench.meshes import Sphere, write_sphere, write_triangle


@pytest.mark.parametrize("triangles", [1, 100, 1000, 20_000])
def test_the_sphere_is_closed_and_faces_outward(triangles: int) -> None:
    sphere = Sphere.of_triangles(triangles)
    vertices, faces = sphere.vertices(0, sphere.m + 1), sphere.faces(0, sphere.m)
    assert len(vertices) == sphere.vertex_count == faces.max() + 1
    assert len(faces) == sphere.triangle_count
    edges = np.concatenate([faces[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    once = np.unique(edges, axis=0)
    assert len(once) == len(edges)  # each directed edge once,
    np.testing.assert_array_equal(np.unique(once[:, ::-1], axis=0), once)  # and its reverse
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 > 1


@pytest.mark.parametrize(("asked", "got"), [(1_000_000, 1_002_528), (10_000_000, 9_999_392)])
def test_the_triangle_count_is_near_the_one_asked_for(asked: int, got: int) -> None:
    assert Sphere.of_triangles(asked).triangle_count == got


def test_the_file_is_the_header_the_vertices_and_the_faces(tmp_path: Path) -> None:
    sphere = write_sphere(tmp_path / "a.ply", 20_000)
    head, _, body = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    assert b"element vertex %d\n" % sphere.vertex_count in head
    assert b"element face %d\n" % sphere.triangle_count in head
    assert len(body) == 12 * sphere.vertex_count + 13 * sphere.triangle_count
    write_sphere(tmp_path / "b.ply", 20_000)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_the_huge_triangle_lies_along_no_axis(tmp_path: Path) -> None:
    write_triangle(tmp_path / "t.ply")
    body = (tmp_path / "t.ply").read_bytes().partition(b"end_header\n")[2]
    corners = np.frombuffer(body, "<f4", 9).reshape(3, 3)
    assert (np.cross(corners[1] - corners[0], corners[2] - corners[0]) != 0).all()
    assert (np.ptp(corners, axis=0) > 0.8).all()
