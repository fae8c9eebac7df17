"""Source triangles stand in for finest blocks whose voxels are larger than a pixel."""

import numpy as np
import pytest

from gl import scenes
from gl.test_pictures import coarsened
from gstream_tools.scene import SceneError
from gstream_tools.view_gl import frame

SIZE = (120, 90)
HYBRID = {"hybrid": {"enabled": True}}


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A closed mesh of coarse voxels, with its triangles."""
    folder = tmp_path_factory.mktemp("hybrid")
    settings = {"resolution": 48, "block": 8, "keep_geometry": True}
    return scenes.build(folder, "torus", scenes.torus(), **settings)


def cameras(file, count, seed, zoom=1.6):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return [scenes.camera_from(file, direction, SIZE, zoom) for direction in directions]


def test_a_close_view_covers_the_pixels_of_the_source_mesh(context, model):
    renderer = scenes.renderer(context, model.path, SIZE, **HYBRID)
    silhouette = scenes.Silhouette(context, model, renderer.file, SIZE)
    voxels = scenes.renderer(context, model.path, SIZE)
    for camera in cameras(renderer.file, 10, seed=1):
        assert renderer.converge(camera, frames=30).converged
        assert voxels.converge(camera, frames=30).converged
        mesh = silhouette(camera)
        wrong = (renderer.picture()[..., 3] > 0) != mesh
        # Vertices were snapped to 2^-12 of a voxel: a pixel's middle may be on the other side.
        assert wrong.sum() <= 0.001 * mesh.sum()
        assert ((voxels.picture()[..., 3] > 0) != mesh).sum() > 20 * max(wrong.sum(), 1)
    renderer.close()
    voxels.close()


def test_triangles_beside_voxels_of_any_level_leave_no_hole(context, model, monkeypatch):
    renderer = scenes.renderer(context, model.path, SIZE, **HYBRID)
    silhouette = scenes.Silhouette(context, model, renderer.file, SIZE)
    found, both = [], 0
    for i, camera in enumerate(cameras(renderer.file, 40, seed=2, zoom=1.0)):
        renderer.converge(camera, frames=30)
        with monkeypatch.context() as patch:
            patch.setattr(frame, "walk", coarsened(i))
            renderer.frame(camera)
        found.append(scenes.holes(renderer.picture(), silhouette(camera)))
        both += len(renderer.last_cut.undersampled) < len(renderer.last_cut.drawn)
    renderer.close()
    assert found == [0] * 40
    assert both > 10


def test_streamed_triangles_end_in_the_picture_of_the_synchronous_mode(context, model):
    at_once = scenes.renderer(context, model.path, SIZE, **HYBRID)
    budget = {"io": "async", "upload_per_frame": 65536}
    streamed = scenes.renderer(context, model.path, SIZE, budget=budget, **HYBRID)
    for camera in cameras(at_once.file, 3, seed=3):
        at_once.converge(camera, frames=30)
        assert streamed.converge(camera, frames=3000).converged
        assert np.array_equal(streamed.picture(), at_once.picture())
    at_once.close()
    streamed.close()


def test_triangles_that_do_not_fit_leave_voxels_and_no_hole(context, model):
    renderer = scenes.renderer(context, model.path, SIZE, lod={"pixel_error": 0.5}, **HYBRID)
    renderer._source.triangles.pool.capacity = 1500
    silhouette = scenes.Silhouette(context, model, renderer.file, SIZE)
    for camera in cameras(renderer.file, 5, seed=4, zoom=0.7):
        for _ in range(10):
            renderer.frame(camera)
        there = renderer._source.drawable(renderer.last_cut.undersampled)
        assert 0 < there.sum() < len(there)
        assert scenes.holes(renderer.picture(), silhouette(camera)) == 0
    renderer.close()


def test_from_afar_no_triangle_is_read(context, model):
    renderer = scenes.renderer(context, model.path, (24, 18), **HYBRID)
    renderer.converge(scenes.camera_from(renderer.file, (1, 1, 1), (24, 18)))
    assert not renderer._source.triangles.pool.blocks()
    renderer.close()


def test_blocks_are_voxels_where_stencils_cut(context, model):
    dynamic = {"stencil": [{"centre": [1, 0, 0], "radius": 0.3}]}
    hybrid = scenes.renderer(context, model.path, SIZE, dynamic=dynamic, **HYBRID)
    plain = scenes.renderer(context, model.path, SIZE, dynamic=dynamic)
    camera = cameras(hybrid.file, 1, seed=5)[0]
    hybrid.converge(camera, frames=30)
    plain.converge(camera, frames=30)
    assert np.array_equal(hybrid.picture(), plain.picture())
    hybrid.close()
    plain.close()


def test_reconstruction_of_triangles_is_refused_by_name(context, model):
    with pytest.raises(SceneError, match=r"camera\.sraa: source triangles have no numbers"):
        scenes.renderer(context, model.path, SIZE, camera={"samples": 4, "sraa": True}, **HYBRID)
