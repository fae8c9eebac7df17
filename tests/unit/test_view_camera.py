"""tools/view_gl/camera: nothing in sight is culled, no voxel larger than said; orbits, fits."""

from dataclasses import replace
from math import inf, radians, sqrt, tan

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gstream_tools.view_gl.camera import FAR_OVER_NEAR, Camera, View, fit

SIZE = 64.0  # of the grid, in finest voxels
GRID = np.array([[0.0] * 3, [SIZE] * 3])
UNIT = np.eye(3, 4)

coordinates = st.floats(-200, 200, width=32)
places = st.tuples(coordinates, coordinates, coordinates)
ups = st.sampled_from([(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 2.0, -3.0), (0.0, 0.0, 1e-12)])
seeds = st.integers(0, 2**32 - 1)


@st.composite
def cameras(draw):
    height = draw(st.sampled_from([0.0, 0.0, 0.01, 30.0, 1e4]))
    fov = draw(st.one_of(st.floats(1, 170), st.sampled_from([0.01, 1.0, 170.0])))
    return Camera(draw(places), draw(places), draw(ups), fov, height)


@st.composite
def matrices(draw):
    """Grid to world: turned, scaled by axis, moved; now and then sheared."""
    rng = np.random.default_rng(draw(seeds))
    turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    linear = turned * draw(st.sampled_from([(1, 1, 1), (1, 0.1, 5), (1e-3, 1e-3, 1e-3)]))
    if draw(st.booleans()):
        linear = linear @ (np.eye(3) + np.triu(rng.uniform(-1, 1, (3, 3)), 1))
    return np.column_stack((linear, rng.uniform(-50, 50, 3)))


sizes = st.tuples(st.integers(1, 4000), st.integers(1, 4000))


def boxes(seed, count=100):
    """Boxes in the grid, of sizes from a hundredth of a voxel to all of it."""
    rng = np.random.default_rng(seed)
    extent = SIZE * 10.0 ** rng.uniform(-4, 0, (count, 1)) * rng.uniform(0.1, 1, (count, 3))
    low = rng.uniform(0, 1, (count, 3)) * (SIZE - extent)
    return low, low + extent


def corners(low, high):
    """(8, ..., 3)"""
    return np.stack([np.where([i & 1, i >> 1 & 1, i >> 2], high, low) for i in range(8)])


def on_screen(camera, size, matrix, points):
    """Where grid points are drawn: x and y from -1 to 1, and depth; from the camera's own words."""
    ahead = np.subtract(camera.target, camera.position)
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, camera.up)
    right /= np.linalg.norm(right)
    offset = points @ matrix[:, :3].T + matrix[:, 3] - camera.position
    depth = offset @ ahead
    above = np.full_like(depth, camera.height / 2)
    if camera.height == 0:
        above = np.where(depth > 0, depth, np.nan) * tan(radians(camera.fov) / 2)
    x = offset @ right / (above * size[0] / size[1])
    return x, offset @ np.cross(right, ahead) / above, depth


def well_aimed(camera):
    """Can `on_screen` say where the camera looks?"""
    ahead = np.subtract(camera.target, camera.position)
    length = np.linalg.norm(ahead)
    return length > 0.1 and np.linalg.norm(np.cross(ahead / length, camera.up)) > 1e-3 * (
        np.linalg.norm(camera.up)
    )


@given(cameras(), sizes, matrices(), seeds)
def test_no_box_with_a_point_in_the_viewport_is_culled(camera, size, matrix, seed):
    assume(well_aimed(camera))
    view = View.of(camera, size, matrix, GRID)
    low, high = boxes(seed)
    inner = np.random.default_rng(seed).uniform(low, high, (20, *low.shape))
    points = np.concatenate((corners(low, high), inner))
    x, y, depth = on_screen(camera, size, matrix, points)
    furthest = on_screen(camera, size, matrix, corners(*GRID))[2].max()
    near = -inf if camera.height else furthest / FAR_OVER_NEAR * 1.01
    shown = (np.abs(x) < 1 - 1e-6) & (np.abs(y) < 1 - 1e-6) & (depth > near)
    assert view.seen(low, high)[shown.any(axis=0)].all()


@pytest.mark.parametrize(("height", "half"), [(0.0, 3.0), (4.0, 2.0)])  # of the picture, at z = 0
@pytest.mark.parametrize("axis", [0, 1])
def test_a_box_beside_the_viewport_is_culled(axis, height, half):
    camera = Camera((0, 0, 3), (0, 0, 0), (0, 1, 0), fov=90.0, height=height)
    view = View.of(camera, (100, 100), UNIT, np.array([[-9.0] * 3, [9.0] * 3]))
    low = np.zeros((6, 3))
    low[:, axis] = [-half - 1.001, -half - 1, -half, half - 1, half, half + 0.001]
    assert view.seen(low, low + 1).tolist() == [False, True, True, True, True, False]


def test_a_box_behind_the_camera_is_culled_in_perspective_and_seen_in_parallel():
    box = np.array([[-9.0] * 3, [9.0] * 3])
    low = np.array([[-0.5, -0.5, 5.0]])
    camera = Camera((0, 0, 3), (0, 0, 0), (0, 1, 0))
    assert not View.of(camera, (100, 100), UNIT, box).seen(low, low + 1).any()
    assert View.of(replace(camera, height=4.0), (100, 100), UNIT, box).seen(low, low + 1).all()


@given(cameras(), sizes, matrices(), seeds)
def test_no_edge_of_a_voxel_is_longer_on_the_screen_than_said(camera, size, matrix, seed):
    assume(well_aimed(camera))
    view = View.of(camera, size, matrix, GRID)
    low, high = boxes(seed)
    rng = np.random.default_rng(seed)
    edge = (high - low).min(axis=1) * rng.uniform(0.01, 1, len(low))
    bound = view.voxel_pixels(low, high, edge)
    for axis in range(3):
        step = np.eye(3)[axis] * edge[:, None]
        for free in (*corners(np.zeros(3), np.ones(3)), *rng.uniform(0, 1, (4, 3))):
            start = low + free * (high - low - step)
            points = start + np.linspace(0, 1, 33)[:, None, None] * step
            x, y, _ = on_screen(camera, size, matrix, points)
            inside = (np.abs(x) <= 1) & (np.abs(y) <= 1)
            pieces = np.hypot(np.diff(x, axis=0) * size[0] / 2, np.diff(y, axis=0) * size[1] / 2)
            length = np.where(inside[1:] & inside[:-1], pieces, 0).sum(axis=0)
            assert (length <= bound * (1 + 1e-6) + 1e-6).all()


def test_a_voxel_ahead_is_as_large_as_geometry_says():
    low, high = np.array([[-1.0, -1, -1]]), np.array([[1.0, 1, 0]])
    box, edge = np.array([[-9.0] * 3, [9.0] * 3]), np.array([0.5])
    camera = Camera((0, 0, 10), (0, 0, 0), (0, 1, 0), fov=90.0)
    # At depth 10 the picture's 100 pixels are 20 units; the box is seen 0.1 aside, along two axes.
    view = View.of(camera, (100, 100), UNIT, box)
    assert view.voxel_pixels(low, high, edge) == pytest.approx([2.5 * sqrt(1.02)])
    view = View.of(replace(camera, height=20.0), (100, 100), UNIT, box)
    assert view.voxel_pixels(low, high, edge) == pytest.approx([2.5])


@given(cameras(), sizes, matrices(), seeds)
def test_a_box_that_reaches_the_eyes_plane_has_no_bound(camera, size, matrix, seed):
    camera = replace(camera, height=0.0)
    assume(well_aimed(camera))
    low, high = boxes(seed)
    edge = np.ones(len(low))
    bound = View.of(camera, size, matrix, GRID).voxel_pixels(low, high, edge)
    depth = on_screen(camera, size, matrix, corners(low, high))[2].min(axis=0)
    clear = np.abs(depth) > 1e-6
    assert (np.isinf(bound) == (depth <= 0))[clear].all()


@given(cameras(), st.tuples(st.integers(0, 2), st.integers(0, 2)), matrices(), seeds)
def test_degenerate_pictures_and_cameras_give_finite_numbers(camera, size, matrix, seed):
    low, high = boxes(seed)
    for at in (
        camera,
        replace(camera, target=camera.position),
        replace(camera, position=(32,) * 3),
    ):
        for box in (GRID, np.zeros((2, 3))):
            view = View.of(at, size, matrix, box)
            assert np.isfinite(view.clip).all()
            assert np.isfinite(view.eye).all()
            assert np.isfinite(view.local(np.zeros(3, np.int64))).all()
            assert not np.isnan(view.voxel_pixels(low, high, low[:, 0])).any()
            assert np.isfinite(view.distance(low, high)).all()
            view.seen(low, high)


@given(places, places, st.tuples(*[st.floats(-1, 1)] * 3))
def test_the_axes_are_orthonormal_whatever_up_is(position, target, up):
    back = np.subtract(position, target)
    for vector in (up, np.multiply(up, 1e-9), back, back + np.multiply(up, 1e-7)):
        axes = Camera(position, target, tuple(vector)).axes()
        assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-9)
        assert np.linalg.det(axes) == pytest.approx(1)


def test_a_camera_that_looks_down_has_the_given_up_above():
    axes = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0)).axes()
    assert axes == pytest.approx(np.eye(3))


turns = st.lists(st.tuples(st.floats(-400, 400), st.floats(-400, 400)), max_size=8)


@given(places, places, ups, turns)
def test_an_orbit_keeps_its_distance_and_does_not_go_over_the_pole(position, target, up, turns):
    offset = np.subtract(position, target)
    assume(np.linalg.norm(offset) > 1e-3)
    camera = Camera(position, target, up)
    for azimuth, elevation in turns:
        camera = camera.orbit(azimuth, elevation)
        assert camera.target == target
        now = np.subtract(camera.position, target)
        assert np.linalg.norm(now) == pytest.approx(np.linalg.norm(offset))
        height = now @ up / np.linalg.norm(up) / np.linalg.norm(now)
        assert abs(height) <= np.sin(radians(89)) + 1e-6
        assert camera.axes()[1] @ up > 0


def test_an_orbit_moves_the_camera_to_its_right_and_up():
    camera = Camera((1, 0, 0), (0, 0, 0))
    assert camera.axes()[0] == pytest.approx((0, 1, 0))
    assert camera.orbit(90, 0).position == pytest.approx((0, 1, 0))
    assert camera.orbit(0, 45).position == pytest.approx((sqrt(0.5), 0, sqrt(0.5)))
    assert camera.orbit(0, 400).orbit(0, -89).position == pytest.approx((1, 0, 0))
    assert Camera((0, 0, 1), (0, 0, 0)).orbit(0, -60).position[2] == pytest.approx(0.5)


def test_zoom_and_move_do_what_they_say():
    camera = Camera((4, 0, 0), (0, 0, 0), height=6.0)
    assert camera.zoom(2).position == (2, 0, 0)
    assert camera.zoom(2).height == 3
    moved = camera.move(1, 2, 3)
    assert moved.position == pytest.approx((1, 1, 2))
    assert moved.target == pytest.approx((-3, 1, 2))


@given(
    st.floats(0.01, 100), st.floats(1, 170), places, ups,
    st.tuples(*[st.floats(0, 1000)] * 3), st.tuples(*[st.sampled_from([0.0, -5e5, 4e6])] * 3),
)  # fmt: skip
def test_a_fitted_camera_shows_the_whole_box(aspect, fov, direction, up, extent, origin):
    assume(np.linalg.norm(direction) > 0.01)
    assume(max(extent) > 0.1)
    box = np.array([origin, np.add(origin, extent)])
    camera = fit(box, np.array(direction), np.array(up), aspect, fov)
    size = (max(round(1000 * aspect), 1), 1000)
    clip = View.of(camera, size, UNIT, box).clip
    points = corners(*box)
    shown = np.column_stack((points, np.ones(8))) @ clip.T
    assert (shown[:, 3] > 0).all()
    assert (np.abs(shown[:, :3]) <= shown[:, 3:] * (1 + 1e-6)).all()


@pytest.mark.parametrize("aspect", [0.3, 1.0, 3.0])
def test_a_fitted_box_fills_the_picture(aspect):
    box = np.array([[0.0] * 3, [2.0, 3.0, 1.0]])
    camera = fit(box, np.array([3.0, 2.0, 1.0]), np.array([0.0, 0.0, 1.0]), aspect)
    x, y, _ = on_screen(camera, (aspect, 1), UNIT, corners(*box))
    assert 0.85 < max(np.abs(x).max(), np.abs(y).max()) < 1


def test_single_precision_suffices_relative_to_an_origin_near_the_eye():
    grid = np.array([[0.0] * 3, [65536.0] * 3])
    camera = Camera((65000.3, 64000.7, 63000.1), (65010.0, 64010.0, 63010.0), fov=60.0)
    view = View.of(camera, (2000, 1000), UNIT, grid)
    origin = np.array([65000, 64000, 63000])
    points = origin + np.random.default_rng(0).integers(1, 100, (1000, 3))
    exact = np.column_stack((points, np.ones(1000))) @ view.clip.T
    local = np.column_stack((points - origin, np.ones(1000))).astype(np.float32)
    drawn = (local @ view.local(origin)).astype(float)
    ahead = exact[:, 3] > 1
    error = drawn[ahead, :2] / drawn[ahead, 3:] - exact[ahead, :2] / exact[ahead, 3:]
    assert ahead.sum() > 500
    assert np.abs(error).max() < 1e-4  # a tenth of a pixel
