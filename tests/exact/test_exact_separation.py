"""Closed meshes: no path of unset voxels passes the surface, and areas add up to the mesh.

The local form is stronger than a flood fill: two adjacent unset voxels lie on the same side. Their
sides come from the exact planes of convex meshes; bumpy spheres are flooded.
"""

from itertools import product
from random import Random

import numpy as np
import pytest
from exact import oracle, scenes
from exact.flood import NEAR6, PATHS, dense, flooded, inside, leaks

from gstream.kernels.voxelize import voxelize_triangles

SNAP_BITS, EDGE = 4, 16
UNIT = 1 << SNAP_BITS
HALF = UNIT // 2


def convex_meshes():
    c, d = 8 * UNIT, 8 * UNIT + HALF
    for centre, radius in product(
        ((c, c, c), (d, d, d), (c, d, c)), (5 * UNIT, 5 * UNIT + HALF, 67)
    ):
        yield scenes.octahedron(centre, radius)
    for low, high in product((2 * UNIT, 2 * UNIT + HALF, 37), (11 * UNIT, 11 * UNIT + HALF, 190)):
        yield scenes.box((low, low, low + UNIT), (high, high + HALF, high))
    for reach, height in product((4 * UNIT, 4 * UNIT + HALF), (3 * UNIT, 3 * UNIT + HALF)):
        yield scenes.turned_box((c, c, c), reach, height)
        yield scenes.turned_box((d, c, d), reach, height)
    random = Random(8)
    for step in (UNIT, HALF, 1):
        for _ in range(25):
            yield scenes.tetrahedron(random, EDGE * UNIT - 2 * step, step) + step


@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize("sep", oracle.SEPARATIONS)
def test_unset_neighbours_are_on_the_same_side_of_a_closed_mesh(sep, ties):
    for mesh in convex_meshes():
        voxels = voxelize_triangles(mesh, SNAP_BITS, (0, 0, 0), EDGE, sep, ties)
        surface, side = dense(voxels.voxel[voxels.hit], EDGE), inside(mesh, SNAP_BITS, EDGE, ties)
        assert leaks(surface, side, PATHS[sep]) == 0, mesh.tolist()


@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize("sep", oracle.SEPARATIONS)
def test_no_path_from_outside_reaches_the_middle_of_a_bumpy_sphere(sep, ties):
    for steps, snap in product((2, 6, 14), (1, HALF, UNIT)):
        for middle in (8 * UNIT, 8 * UNIT + HALF):
            mesh = scenes.sphere(steps, 5.7 * UNIT, (middle,) * 3, snap, 0.2)
            voxels = voxelize_triangles(mesh, SNAP_BITS, (0, 0, 0), EDGE, sep, ties)
            surface = dense(voxels.voxel[voxels.hit], EDGE)
            assert not surface[8, 8, 8]
            reached = flooded(surface, PATHS[sep])
            assert reached[15, 15, 15]
            assert not reached[8, 8, 8], (steps, snap, middle)


def test_removing_any_voxel_of_a_6_separating_plane_opens_it():
    """TP-09: the set of a lattice-coplanar square is minimal, and so one voxel thick."""
    square = np.array([[[0, 0, 8], [16, 0, 8], [16, 16, 8]], [[0, 0, 8], [16, 16, 8], [0, 16, 8]]])
    voxels = voxelize_triangles(square * UNIT, SNAP_BITS, (0, 0, 0), EDGE, "6", "one-sided")
    surface = dense(voxels.voxel[voxels.hit], EDGE)
    assert surface.sum() == EDGE * EDGE
    assert surface[:, :, 8].all()
    for at in ((0, 0, 8), (7, 9, 8), (15, 15, 8)):
        opened = surface.copy()
        opened[at] = False
        assert flooded(opened, NEAR6)[8, 8, 12]
    assert not flooded(surface, NEAR6)[8, 8, 12]


def closed_meshes():
    yield from convex_meshes()
    for steps in (3, 12):
        yield scenes.sphere(steps, 5.7 * UNIT, (8 * UNIT + 3,) * 3, 1, 0.2)


def test_the_areas_of_a_closed_mesh_add_up_and_its_area_vectors_cancel():
    """One-sided ties give a point of the surface to one voxel; a fragment rounds by one unit."""
    for mesh in closed_meshes():
        voxels = voxelize_triangles(mesh, SNAP_BITS, (0, 0, 0), EDGE, "conservative", "one-sided")
        whole = sum(float(oracle.area_in_units(t, SNAP_BITS, 1)) for t in mesh)
        error = abs(int(voxels.area.sum()) - whole)
        assert error <= 1e-6 * whole
        assert error <= voxels.fragments + 1e-9 * whole
        rest = np.abs(voxels.vector.sum(axis=0)) / 2**12
        assert np.all(rest <= voxels.fragments + 1e-9 * whole), mesh.tolist()


def test_a_fine_mesh_loses_no_area_to_rounding():
    """Many triangles per voxel: the one unit that each fragment has at least stays below 1e-6."""
    mesh = scenes.sphere(40, 7.0 * 4096, (8 * 4096 + 11,) * 3, 1, 0.1)
    voxels = voxelize_triangles(mesh, 12, (0, 0, 0), EDGE, "6", "one-sided")
    whole = sum(float(oracle.area_in_units(t, 12, 1)) for t in mesh)
    assert abs(int(voxels.area.sum()) - whole) <= 1e-6 * whole
    rest = np.abs(voxels.vector.sum(axis=0)) / 2**12
    assert np.all(rest <= 1e-9 * whole + 8 * voxels.fragments**0.5)  # roundings are independent


@pytest.mark.parametrize("ties", oracle.TIES)
def test_halving_the_conservative_set_is_the_set_of_half_the_resolution(ties):
    """A voxel of twice the size is met iff one of its eight is: holds for pure point sets."""
    for mesh in closed_meshes():
        fine = voxelize_triangles(mesh, SNAP_BITS, (0, 0, 0), EDGE, "conservative", ties)
        coarse = voxelize_triangles(mesh, SNAP_BITS + 1, (0, 0, 0), 8, "conservative", ties)
        assert np.array_equal(np.unique(fine.voxel // 2, axis=0), np.unique(coarse.voxel, axis=0))
