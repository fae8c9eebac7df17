"""What triangles will take, foreseen from areas and extents: against NumPy, and by hand."""

import numpy as np
import pytest

from gstream.kernels.foresee import foresee

CELL = 8.0


def foreseen(points, triangles, thin):
    sums = np.zeros(4)
    foresee(points, np.array(triangles, np.uint16), CELL, thin, sums)
    return sums


@pytest.mark.parametrize("thin", [False, True])
def test_random_triangles_give_the_sums_that_numpy_gives(thin):
    rng = np.random.default_rng(5)
    points = rng.uniform(-1, 1, (300, 3)) * rng.choice([1, 3, 9], (300, 1))
    triangles = rng.integers(0, 300, (2000, 3))
    corners = points[triangles]
    seen = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])) / 2
    voxels = seen.max(axis=1) if thin else seen.sum(axis=1)
    extent = np.ptp(corners, axis=1)
    small = (extent < CELL / 2).all(axis=1)
    several = (1 + extent / CELL).prod(axis=1)
    reached = seen.sum(axis=1) / CELL**2 + extent.sum(axis=1) / CELL + 1
    wanted = [voxels[small], voxels[~small], several[small], reached[~small]]
    assert 0 < small.sum() < len(small)
    assert foreseen(points, triangles, thin) == pytest.approx([part.sum() for part in wanted])


def test_a_diagonal_square_has_its_shadows_voxels_thin_and_both_shadows_otherwise():
    points = np.array([[0, 0, 0], [2, 0, 2], [2, 3, 2], [0, 3, 0]], float)
    square = [[0, 1, 2], [0, 2, 3]]
    assert foreseen(points, square, True)[:2].tolist() == [6, 0]
    assert foreseen(points, square, False)[:2].tolist() == [12, 0]
