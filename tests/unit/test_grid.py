"""Grids: how finely vertices snap, and which grids are refused."""

import pytest

from gstream.errors import UsageError
from gstream.grid import Box, grid_of

UNIT: Box = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    ("resolution", "snap_bits"),
    [(1, 12), (16_384, 12), (16_385, 11), (32_768, 11), (32_769, 10), (65_536, 10)],
)
def test_vertices_snap_as_finely_as_26_bits_allow(resolution, snap_bits):
    assert grid_of(resolution, None, UNIT).snap_bits == snap_bits


def test_the_snap_bits_asked_for_are_taken():
    assert [grid_of(64, None, UNIT, None, k).snap_bits for k in (1, 7, 12)] == [1, 7, 12]


@pytest.mark.parametrize(
    ("resolution", "asked", "most"), [(64, 13, 12), (65_536, 11, 10), (64, 0, 12)]
)
def test_snap_bits_over_the_budget_are_refused_with_the_limit(resolution, asked, most):
    with pytest.raises(UsageError, match=rf"--snap-bits {asked} .* give 1 to {most}\b"):
        grid_of(resolution, None, UNIT, None, asked)


def test_a_scene_beyond_its_bounds_leaves_fewer_snap_bits():
    wide: Box = ((0.0, 0.0, 0.0), (40.0, 1.0, 1.0))  # 40 960 voxels: 16 bits
    assert grid_of(1024, None, wide, UNIT).snap_bits == 10
    with pytest.raises(UsageError, match="give 1 to 10"):
        grid_of(1024, None, wide, UNIT, 12)


def test_a_voxel_size_that_needs_too_many_voxels_is_refused_with_the_least_size():
    with pytest.raises(
        UsageError, match=r"needs 100001 voxels per axis, above 65536.*1\.52593e-05"
    ):
        grid_of(None, 1e-5, UNIT)
