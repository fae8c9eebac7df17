"""Meshes as their own surface: distances by all pairs, inside by known shapes, closed by hand."""

import numpy as np
import pytest

from gstream.errors import UsageError
from gstream.job import IngestSettings
from gstream.report.truth import mesh
from gstream.report.truth.mesh import scene_of_mesh, scene_of_stream
from gstream.report.truth.scenes import SCENES, write_ply
from gstream.run import commands
from gstream.run.commands import RunOptions

CORNER = np.array([[[0, 0, 0], [4, 0, 0], [0, 4, 0]]], float)
TETRAHEDRON = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
FOUR = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)


def of_corners(corners):
    corners = np.asarray(corners, float)
    return scene_of_mesh("soup", corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def feature_distances(at, triangle):
    """Distances from a point to what a triangle is made of: three corners, three sides, the face.

    A foot outside its side or face is left out: then a corner or a side is nearer.
    """
    for i in range(3):
        yield np.linalg.norm(at - triangle[i])
    for parts in ([0, 1], [1, 2], [2, 0], [0, 1, 2]):
        base, ways = triangle[parts[0]], (triangle[parts[1:]] - triangle[parts[0]]).T
        shares = np.linalg.lstsq(ways, at - base, rcond=None)[0]
        if (shares >= 0).all() and shares.sum() <= 1:
            yield np.linalg.norm(base + ways @ shares - at)


@pytest.mark.parametrize(
    ("at", "distance"),
    [
        ((1, 1, -2), 2),  # the face
        ((1, 1, 0), 0),
        ((2, -3, 4), 5),  # a side
        ((3, 3, 0), 2**0.5),  # the long side
        ((-3, -4, 12), 13),  # a corner
        ((7, -4, 0), 5),
    ],
)
def test_the_distance_of_a_triangle_is_that_of_its_nearest_part(at, distance):
    found, normal = of_corners(CORNER).nearest(np.array([at], float))
    assert found == pytest.approx([distance], abs=1e-15)
    assert normal.tolist() == [[0, 0, 1]]


def test_the_nearest_triangle_is_that_of_all_pairs_whatever_their_sizes():
    random = np.random.default_rng(11)
    sizes = 2.0 ** random.uniform(-9, 2, (120, 1, 1))
    corners = random.normal(0, 1, (120, 1, 3)) + sizes * random.normal(0, 1, (120, 3, 3))
    at = np.concatenate([random.normal(0, 2, (30, 3)), corners[:10].mean(axis=1), corners[:5, 0]])
    every = np.array([[min(feature_distances(p, t)) for t in corners] for p in at])
    distance, normal = of_corners(corners).nearest(at)
    np.testing.assert_allclose(distance, every.min(axis=1), atol=1e-9)
    owner = every.argmin(axis=1)
    true = np.cross(*(corners[owner, i] - corners[owner, 0] for i in (1, 2)))
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    np.testing.assert_allclose(normal[:40], true[:40], atol=1e-9)


def test_a_mesh_is_closed_if_every_edge_goes_both_ways_wherever_its_vertices_are_stored():
    assert scene_of_mesh("four", FOUR, np.array(TETRAHEDRON)).closed
    assert of_corners(FOUR[TETRAHEDRON]).closed
    assert len(of_corners(FOUR[TETRAHEDRON]).points) == 4
    flipped = [TETRAHEDRON[0][::-1], *TETRAHEDRON[1:]]
    for triangles in (TETRAHEDRON[1:], flipped):
        scene = scene_of_mesh("four", FOUR, np.array(triangles))
        assert not scene.closed
        assert scene.inside is None


def test_a_vertex_at_minus_zero_is_the_one_at_zero():
    corners = FOUR[TETRAHEDRON]
    corners[0][corners[0] == 0] = -0.0
    assert of_corners(corners).closed


def test_area_and_samples_are_the_mesh_s_and_triangles_without_area_do_no_harm():
    corners = np.concatenate([CORNER, CORNER + np.array([0, 0, 9]), [[[1, 1, 5]] * 3]])
    scene = of_corners(corners)
    assert scene.area == 16
    assert scene.floor == 0
    assert (scene.samples[:, 2] == 9).mean() == 0.5
    assert scene.nearest(scene.samples)[0].max() < 1e-14
    assert scene.nearest(np.array([[1.0, 1, 5]]))[0] == [4]
    # evenly: each quarter of the long sides' square has its part of a triangle
    low = scene.samples[scene.samples[:, 2] == 0]
    assert ((low[:, 0] < 2) & (low[:, 1] < 2)).mean() == pytest.approx(0.5, abs=0.01)


def test_inside_is_the_room_s_own_at_centres_on_its_faces():
    room = SCENES["room"](64)
    judged = scene_of_mesh("room", room.points, room.triangles)
    size = 1025 / 1024 / 64
    centres = (np.indices((64, 64, 64)).reshape(3, -1).T + 0.5) * size - 2.0**-11
    tied = (room.nearest(centres)[0] == 0).sum()
    assert tied > 500
    np.testing.assert_array_equal(judged.inside(centres), room.inside(centres))


@pytest.mark.parametrize("name", ["torus", "filaments"])
def test_inside_is_the_surface_s_own_away_from_it(name):
    scene = SCENES[name](64)
    judged = scene_of_mesh(name, scene.points, scene.triangles)
    _, normal = scene.nearest(scene.samples)
    at = np.concatenate([scene.samples + step * normal for step in (-1e-3, 1e-3)])
    found = judged.inside(at)
    assert found[: len(at) // 2].all()
    assert not found[len(at) // 2 :].any()
    assert judged.inside(at[:0]).shape == (0,)


def stream_of(scene, folder):
    write_ply(scene, folder / "mesh.ply")
    settings = IngestSettings(inputs=(str(folder / "mesh.ply"),))
    commands.ingest(settings, str(folder / "mesh.gst"), RunOptions(workers=0)).run()
    return folder / "mesh.gst"


def test_a_stream_s_scene_has_its_triangles(tmp_path):
    room = SCENES["room"](64)
    scene = scene_of_stream("mine", stream_of(room, tmp_path))
    assert (scene.name, scene.closed, len(scene.triangles)) == ("mine", True, 96)
    assert scene.area == pytest.approx(room.area, rel=1e-12)
    corners = (s.points[s.triangles].reshape(-1, 9) for s in (scene, room))
    np.testing.assert_array_equal(*(np.unique(part, axis=0) for part in corners))


def test_a_stream_with_too_many_triangles_is_refused(tmp_path, monkeypatch):
    path = stream_of(SCENES["room"](64), tmp_path)
    monkeypatch.setattr(mesh, "MAX_TRIANGLES", 95)
    with pytest.raises(UsageError, match=r"96 triangles, .* at most 95; give a part of the mesh"):
        scene_of_stream("mine", path)


@pytest.mark.parametrize("triangles", [[], [[(1, 2, 3), (2, 3, 4), (3, 4, 5)]]])
def test_a_mesh_without_area_is_refused(triangles):
    with pytest.raises(UsageError, match="no triangle has an area; give a mesh with a surface"):
        of_corners(np.reshape(triangles, (-1, 3, 3)))
