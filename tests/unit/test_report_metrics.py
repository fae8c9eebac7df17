"""The metrics of the accuracy report, each against a case counted by hand."""

import numpy as np
import pytest

from gstream.report.metrics import (
    Content,
    angles,
    cover_distance,
    differing_bytes,
    differing_voxels,
    errors_of,
)
from gstream.report.scenes import Scene

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
