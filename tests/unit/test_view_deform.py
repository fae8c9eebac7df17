"""tools/view_gl/deform: the deformation is the scene's, and its boxes and bounds hold."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gstream_tools.scene import scene_of
from gstream_tools.view_gl.deform import Deformation

SIZE = 64.0
NONE, SHEAR, WAVE = range(3)
seeds = st.integers(0, 2**32 - 1)


@st.composite
def deformed(draw):
    """A deformation of a turned, scaled grid; what it does to grid points by spec/scene.md."""
    rng = np.random.default_rng(draw(seeds))
    turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    scale = draw(st.sampled_from([1.0, 0.01, (1.0, 0.2, 3.0)]))
    linear, move = turned * scale, rng.uniform(-50, 50, 3)
    box = np.sort(rng.uniform(-20, 60, (2, 3)), axis=0)
    kind = draw(st.sampled_from([NONE, SHEAR, WAVE]))
    if kind == SHEAR:
        matrix = np.eye(3) + rng.uniform(-1, 1, (3, 3)) * draw(st.sampled_from([0.1, 1.0]))
        assume(np.linalg.det(matrix) > 0.01)
        dynamic = {"deform": "shear", "matrix": matrix.tolist()}
    else:
        size = SIZE * np.max(scale)
        dynamic = {
            "deform": "wave", "axis": draw(st.sampled_from("xyz")),
            "along": draw(st.sampled_from("xyz")), "amplitude": size * rng.uniform(0, 0.2),
            "wavelength": size * rng.uniform(0.1, 2), "phase": rng.uniform(-360, 360),
        }  # fmt: skip
    scene = scene_of({"dynamic": dynamic})

    def place(points):
        world = points @ linear.T + move
        middle = (box[0] + box[1]) / 2
        if kind == SHEAR:
            world = middle + (world - middle) @ np.array(dynamic["matrix"]).T
        if kind == WAVE:
            along = (world - middle)[..., "xyz".index(dynamic["along"])]
            turns = along / dynamic["wavelength"] + dynamic["phase"] / 360
            axis = np.eye(3)["xyz".index(dynamic["axis"])]
            world = world + axis * dynamic["amplitude"] * np.sin(2 * np.pi * turns)[..., None]
        return (world - move) @ np.linalg.inv(linear).T

    return Deformation.of(scene, kind, np.column_stack((linear, move)), box), place


def boxes(seed, count=50):
    rng = np.random.default_rng(seed)
    low, high = np.sort(rng.integers(0, int(SIZE) + 1, (2, count, 3)), axis=0).astype(float)
    return low, high, rng.uniform(low, high, (50, count, 3))


@given(deformed(), seeds)
def test_boxes_hold_all_that_was_in_them(made, seed):
    deformation, place = made
    low, high, points = boxes(seed)
    points = np.concatenate((points, low[None], high[None]))
    around = deformation.boxes(low, high)
    moved = place(points)
    assert (moved >= around[0] - 1e-9).all()
    assert (moved <= around[1] + 1e-9).all()


@given(seeds, st.floats(-1e6, 1e6))
def test_without_a_deformation_boxes_stay_to_the_bit(seed, pivot):
    low, high, _ = boxes(seed)
    nothing = np.zeros(3)
    still = Deformation(np.full(3, pivot), np.zeros((3, 3)), nothing, nothing + 0.3, 0.1)
    assert [b.tolist() for b in still.boxes(low, high)] == [low.tolist(), high.tolist()]
    assert still.stretch == 1
    assert still.slack(8.0) == 0


@given(deformed(), seeds)
def test_no_length_grows_more_than_the_stretch(made, seed):
    deformation, place = made
    rng = np.random.default_rng(seed)
    start = rng.uniform(0, SIZE, (300, 3))
    step = rng.normal(size=(300, 3)) * 10.0 ** rng.uniform(-3, 1, (300, 1))
    before = np.linalg.norm(step, axis=1)
    after = np.linalg.norm(place(start + step) - place(start), axis=1)
    assert (after <= before * deformation.stretch * (1 + 1e-6) + 1e-9).all()


@given(deformed(), seeds, st.sampled_from([1.0, 8.0, 32.0]))
def test_a_cubes_points_are_within_the_slack_of_what_its_corners_span(made, seed, edge):
    deformation, place = made
    rng = np.random.default_rng(seed)
    low, part = rng.uniform(0, SIZE, (100, 3)), rng.uniform(0, 1, (100, 3))
    mean = np.zeros((100, 3))  # of the moved corners, by how near the point is to each
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, part, 1 - part).prod(axis=1)[:, None]
        mean += weight * place(low + np.multiply(corner, edge))
    apart = np.linalg.norm(place(low + part * edge) - mean, axis=1)
    assert (apart <= deformation.slack(edge) * (1 + 1e-6) + 1e-9).all()


@given(deformed(), seeds, st.tuples(*[st.integers(-100, 100)] * 3))
def test_uniforms_move_points_relative_to_the_origin_as_the_scene_says(made, seed, origin):
    deformation, place = made
    found = deformation.uniforms(np.array(origin))
    points = np.random.default_rng(seed).uniform(0, SIZE, (100, 3)) - origin
    # As common.glsl has it; the columns of a mat3 lie one after another.
    shear = np.frombuffer(found["shear"], np.float32).reshape(3, 3).T
    away = points - found["pivot"]
    wave = np.sin(away @ found["waves"] + found["phase"])[:, None] * found["wave"]
    moved = points + away @ shear.T + wave + origin
    assert moved == pytest.approx(place(points + origin), rel=1e-5, abs=1e-3)
