"""The built-in scenes: the mesh, its surface, and the colours agree, and ties are where planned."""

import numpy as np
import pytest

from gstream.grid import grid_of_resolution
from gstream.report.truth.scene import codes_of_linear, linear_of_codes
from gstream.report.truth.scenes import SCENES

CLOSED = [name for name in SCENES if SCENES[name](4).closed]


def grid_about(scene, resolution):
    low, high = (tuple(map(float, f(scene.points, axis=0))) for f in (np.min, np.max))
    return grid_of_resolution(low, high, resolution, (low, high))


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_s_mesh_lies_on_its_surface_faces_out_and_has_its_area(name):
    scene = SCENES[name](64)
    a, b, c = scene.points[scene.triangles].transpose(1, 0, 2)
    doubled = np.cross(b - a, c - a)
    assert np.linalg.norm(doubled, axis=1).sum() / 2 == pytest.approx(scene.area, rel=2e-3)
    distance, normal = scene.nearest((a + b + c) / 3)
    assert distance.max() <= scene.floor + 1e-12
    assert ((doubled * normal).sum(axis=1) > 0).all()
    assert scene.nearest(scene.points)[0].max() < 1e-12
    assert scene.nearest(scene.samples)[0].max() < 1e-12
    extent = np.ptp(scene.points, axis=0).max()
    assert scene.floor <= 0.025 * extent / 64


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_s_distance_agrees_with_its_samples(name):
    scene = SCENES[name](16)
    at = np.random.default_rng(3).uniform(scene.points.min(), scene.points.max(), (40, 3))
    found = np.linalg.norm(at[:, None] - scene.samples, axis=2).min(axis=1)
    distance = scene.nearest(at)[0]
    assert (distance <= found + 1e-12).all()
    np.testing.assert_allclose(distance, found, atol=0.12)


@pytest.mark.parametrize("name", CLOSED)
def test_each_edge_of_a_closed_scene_has_a_triangle_on_either_side(name):
    scene = SCENES[name](16)
    assert len(np.unique(scene.points, axis=0)) == len(scene.points)
    ends = np.stack([scene.triangles, np.roll(scene.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    np.testing.assert_array_equal(np.unique(ends, axis=0), np.unique(ends[:, ::-1], axis=0))
    assert len(np.unique(ends, axis=0)) == len(ends)


@pytest.mark.parametrize("name", CLOSED)
def test_inside_changes_across_the_surface_along_its_normal(name):
    scene = SCENES[name](64)
    corners = scene.points[scene.triangles]
    middle = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    step = 1e-3 * normal / np.linalg.norm(normal, axis=1, keepdims=True)
    assert scene.inside(middle - step).all()
    assert not scene.inside(middle + step).any()


def test_the_room_s_faces_lie_between_voxels_and_in_their_middles():
    scene = SCENES["room"](256)
    between, through = {}, {}
    for resolution in (64, 128, 256, 512):
        grid = grid_about(scene, resolution)
        assert grid.origin == (-(2.0**-11),) * 3
        at = (scene.points - grid.origin) / grid.voxel_size
        between[resolution] = int((at % 1 == 0).sum())
        through[resolution] = int((at % 1 == 0.5).sum())
    assert all(count >= 8 for count in through.values())
    assert all(count >= 72 for count in between.values())


def test_a_centre_on_the_room_s_low_face_is_outside_and_on_its_high_face_inside():
    scene = SCENES["room"](256)
    low, high = scene.points[2 * 8], scene.points[2 * 8 + 7]  # of a wall
    middle = (low + high) / 2
    for axis in range(3):
        at = np.stack([middle, middle])
        at[:, axis] = low[axis], high[axis]
        assert scene.inside(at).tolist() == [False, True]


def test_threads_keep_apart():
    scene = SCENES["filaments"](16)
    rings = scene.points.reshape(6, -1, 36, 3).mean(axis=2)
    for i in range(6):
        for other in rings[i + 1 :]:
            gap = np.linalg.norm(rings[i][:, None] - other, axis=2)
            assert gap.min() > 0.05


def test_a_plane_s_colours_are_those_of_its_vertices_and_linear_between():
    scene = SCENES["planes"](64)
    a, b, c = scene.points[scene.triangles].transpose(1, 0, 2)
    light = [linear_of_codes(scene.vertex_colours)[corner] for corner in scene.triangles.T]
    np.testing.assert_allclose(scene.colour(a), light[0], atol=1e-12)
    mixed = 0.2 * light[0] + 0.5 * light[1] + 0.3 * light[2]
    np.testing.assert_allclose(scene.colour(0.2 * a + 0.5 * b + 0.3 * c), mixed, atol=1e-12)


def test_srgb_codes_are_those_of_the_standard():
    # IEC 61966-2-1: the linear part ends at 0.04045; half of the light is code 187.5
    assert linear_of_codes(np.array([0, 10, 255], np.uint8)) == pytest.approx(
        [0, 10 / 255 / 12.92, 1]
    )
    assert codes_of_linear(np.array([0.5])) == pytest.approx([187.516], abs=1e-3)
    codes = np.arange(256, dtype=np.uint8)
    np.testing.assert_allclose(codes_of_linear(linear_of_codes(codes)), codes, atol=1e-2)
