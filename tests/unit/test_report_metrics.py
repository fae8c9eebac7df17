"""The metrics of the accuracy report, each against a case counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from gstream.job import IngestSettings, VoxelizeSettings
from gstream.read import open_block_file
from gstream.report.truth.mesh import scene_of_mesh
from gstream.report.truth.metrics import (
    Content,
    angles,
    corners_of,
    cover_distance,
    differing_bytes,
    differing_voxels,
    errors_of,
    leaks,
    misclassified,
    read_content,
)
from gstream.report.truth.oracle import exact_voxels
from gstream.report.truth.scenes import SCENES, Scene, write_ply
from gstream.report.truth.shapes import BOX_CORNERS, BOX_TRIANGLES
from gstream.run import commands
from gstream.run.commands import RunOptions

SEPARATIONS = ("6", "26", "conservative")
COLOURS = [(200, 0, 0, 255), (0, 0, 200, 255)]
UNIT = np.eye(3, 4)  # voxels of a unit, from the origin on
HALF = np.array([[0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 0.5, 0]])  # voxels of half a unit


def content(positions, normals, weight):
    n = len(positions)
    return Content(
        np.array(positions, np.int64),
        np.array(normals, np.float64),
        np.ones(n, np.uint8),
        np.array(weight, np.uint32),
    )


def floor_at(height):
    """The square 0..2 x 0..2 at z = height."""

    def nearest(at):
        return np.abs(at[:, 2] - height), np.tile([0.0, 0.0, 1.0], (len(at), 1))

    samples = np.array([[0.25, 0.25, height], [1.75, 0.25, height]])
    return Scene("floor", np.empty((0, 3)), np.empty((0, 3), np.int64), nearest, samples, 4.0)


def test_errors_of_two_voxels_on_a_floor():
    # centres at z = 0.25 and 0.75, the floor at 0.25: 0 and 1 voxel away; the first sample is the
    # first voxel's centre, the second one 3 voxels from any: beyond the search
    held = content([(0, 0, 0), (0, 0, 1)], [(0, 0, 1), (0, 1, 0)], [1 << 20, 3 << 20])
    errors = errors_of(held, HALF, floor_at(0.25), 0.5)
    assert errors.distance_rms == pytest.approx(np.sqrt(0.5))
    assert errors.distance_max == pytest.approx(1.0)
    assert errors.cover_max == 2.5
    assert (errors.normal_mean, errors.normal_max) == (45.0, 90.0)
    assert errors.area == pytest.approx(0.75)  # 4 faces of 1/4 are 1 of 4


def test_distances_are_in_the_unit_given():
    held = content([(0, 0, 1)], [(0, 0, 1)], [1])
    assert errors_of(held, HALF, floor_at(0.25), 0.25).distance_max == pytest.approx(2.0)


def test_angles_tell_small_ones_and_count_no_direction_as_90():
    turned = np.radians(1e-4)
    found = np.array([[np.cos(turned), np.sin(turned), 0], [-1, 0, 0], [0, 0, 0]])
    np.testing.assert_allclose(angles(found, np.tile([1.0, 0, 0], (3, 1))), [1e-4, 180, 90])


def test_cover_distance_agrees_with_all_pairs():
    rng = np.random.default_rng(5)
    positions = np.unique(rng.integers(0, 12, (200, 3)), axis=0)
    points = rng.random((300, 3)) * 12
    every = np.linalg.norm(points[:, None] - (positions + 0.5), axis=2).min(axis=1)
    np.testing.assert_allclose(cover_distance(positions, points), np.minimum(every, 2.5))


def test_a_planted_difference_is_counted_once_whatever_it_is():
    one = content([(0, 0, 0), (1, 0, 0), (2, 0, 0)], np.eye(3), [5, 6, 7])
    assert differing_voxels(one, one) == 0
    other = content([(0, 0, 0), (1, 0, 0), (2, 0, 0)], np.eye(3), [5, 6, 8])
    assert differing_voxels(one, other) == 1
    moved = content([(0, 0, 0), (1, 0, 0), (2, 0, 1)], np.eye(3), [5, 6, 7])
    assert differing_voxels(one, moved) == 2
    assert differing_bytes(b"abcd", b"abXdef") == 3


def test_a_planted_colour_is_one_difference():
    one = content([(0, 0, 0), (1, 0, 0)], np.eye(3)[:2], [5, 6])
    red, blue = (replace(one, colour=np.array([[9, 9, 9, 255], c], np.uint8)) for c in COLOURS)
    assert differing_voxels(red, red) == 0
    assert differing_voxels(red, blue) == 1


def test_misclassified_voxels_are_those_of_one_set_alone():
    exact = np.array([(0, 0, 0), (1, 0, 0), (5, 5, 5)])
    assert misclassified(exact[::-1], exact) == 0
    assert misclassified(np.array([(1, 0, 0), (0, 1, 0), (0, 0, 0), (5, 5, 6)]), exact) == 3


def test_colour_errors_are_codes_of_the_nearest_colour():
    # half of the light is code 187.516; the second voxel is 2.5 codes off in one channel of three
    scene = replace(floor_at(0.25), colour=lambda at: np.full((len(at), 3), 0.5))
    codes = np.full((2, 4), 187.516)
    held = content([(0, 0, 0), (1, 0, 0)], [(0, 0, 1)] * 2, [1, 1])
    codes[1, 1] += 2.5
    errors = errors_of(replace(held, colour=codes), HALF, scene, 0.5)
    assert errors.colour_mean == pytest.approx(2.5 / 6, abs=1e-3)
    assert errors.colour_max == pytest.approx(2.5, abs=1e-3)
    for bare in (held, floor_at(0.25)), (replace(held, colour=codes), floor_at(0.25)):
        errors = errors_of(bare[0], HALF, bare[1], 0.5)
        assert errors.colour_mean is errors.colour_max is None


def box(low, high):
    return scene_of_mesh("box", np.where(BOX_CORNERS, high, low).astype(float), BOX_TRIANGLES)


def octahedron(centre, radius):
    points = radius * np.concatenate([np.eye(3), -np.eye(3)]) + centre
    faces = [(x, y, z) for x in (0, 3) for y in (1, 4) for z in (2, 5)]
    faces = [face[:: 1 if sum(face) % 2 else -1] for face in faces]  # 3 = 0 + 1 + 2 is outward
    return scene_of_mesh("octahedron", points, np.array(faces))


def leaks_of_all_pairs(positions, inside, size, adjacent):
    """As leaks, of a dense grid: every voxel with every later one."""
    unset = np.ones((size,) * 3, bool)
    unset[tuple(np.asarray(positions).T)] = False
    places = np.argwhere(unset)
    side = inside(places)
    gap = np.abs(places[:, None] - places)
    near = (gap.max(axis=2) == 1) & (gap.sum(axis=2) <= adjacent)
    return int((near & (side[:, None] != side)).sum() // 2)


def test_a_hole_in_a_box_leaks_at_each_pair_across_it():
    # the wall's plane goes through the centres of its voxels: they count as inside or outside, and
    # a hole of one voxel then meets one neighbour, 9 where corners count, on the other side
    scene = box((1.5, 1.5, 1.5), (6.5, 6.5, 6.5))
    for sep, expected in (("6", 1), ("26", 9)):
        whole = exact_voxels(corners_of(scene, UNIT), sep, (0, 0, 0), (8, 8, 8))
        assert leaks(whole, scene, UNIT, (8, 8, 8), sep) == 0
        holed = whole[(whole != (4, 4, 6)).any(axis=1)]
        assert leaks(holed, scene, UNIT, (8, 8, 8), sep) == expected


def tetrahedron():
    """Every other corner of a cube: the edges go through centres."""
    points = np.array([(1.5, 1.5, 1.5), (8.5, 8.5, 1.5), (8.5, 1.5, 8.5), (1.5, 8.5, 8.5)])
    faces = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)])
    return scene_of_mesh("tetrahedron", points, faces)


TIED = [
    octahedron((5, 5, 5), 4),
    octahedron((5, 5.5, 5), 3.5),
    box((2, 3, 1), (7.5, 7, 9)),
    tetrahedron(),
]


@pytest.mark.parametrize("sep", SEPARATIONS)
@pytest.mark.parametrize("scene", TIED, ids=["octahedron", "another", "box", "tetrahedron"])
def test_leaks_of_half_a_surface_on_ties_are_those_of_all_pairs(scene, sep):
    exact = exact_voxels(corners_of(scene, UNIT), sep, (0, 0, 0), (10, 10, 10))
    assert leaks(exact, scene, UNIT, (10, 10, 10), sep) == 0
    kept = exact[np.random.default_rng(2).random(len(exact)) < 0.5]
    expected = leaks_of_all_pairs(
        kept, lambda at: scene.inside(at + 0.5), 10, 1 if sep == "6" else 3
    )
    assert leaks(kept, scene, UNIT, (10, 10, 10), sep) == expected > 50
    assert leaks(exact[:0], scene, UNIT, (10, 10, 10), sep) > expected


def test_leaks_are_not_measured_of_an_open_surface():
    assert leaks(np.zeros((0, 3), np.int64), SCENES["planes"](8), UNIT, (8, 8, 8), "6") is None


@pytest.mark.parametrize("name", ["planes", "room"])
def test_a_file_read_back_has_the_exact_voxels_and_colours_near_the_scene_s(name, tmp_path):
    scene = SCENES[name](64)
    write_ply(scene, tmp_path / "scene.ply")
    settings = IngestSettings(inputs=(str(tmp_path / "scene.ply"),))
    stream, output = str(tmp_path / "scene.gst"), str(tmp_path / "scene.gsb")
    commands.ingest(settings, stream, RunOptions(workers=0)).run()
    voxels = VoxelizeSettings(resolution=64, keep_weights=True)
    commands.voxelize(stream, voxels, output, RunOptions(workers=0)).run()
    with open_block_file(output) as file:
        held, matrix = read_content(file), file.matrix
    snapped = np.floor(corners_of(scene, matrix) * 4096 + 0.5) / 4096
    exact = exact_voxels(snapped, "6", (0, 0, 0), (64, 64, 64))
    assert misclassified(held.positions, exact) == 0
    errors = errors_of(held, matrix, scene, matrix[0, 0])
    if name == "room":
        assert leaks(held.positions, scene, matrix, (64, 64, 64), "6") == 0
        assert errors.colour_mean is None
        assert errors.distance_max == 0.5
    else:
        # rounding a colour to codes is 0.25 off in the mean and 0.5 at most
        assert 0.25 <= errors.colour_mean < 0.35
        assert errors.colour_max < 4
