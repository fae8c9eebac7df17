"""Triangles as large as the scene, in boxes of 256^3: the kernel against the oracle in windows.

Covers the budget's ends: 16384^3 with 12 snap bits and 65536^3 with 10, coordinates up to 2^26.
"""

from random import Random

import numpy as np
import pytest
from exact import oracle, scenes

from gstream.kernels.voxelize import voxelize_triangles

GRIDS = ((16_384, 12), (65_536, 10))
BOX_EDGE, WINDOW_EDGE = 256, 8


def as_set(rows) -> set[tuple[int, int, int]]:
    return {(x, y, z) for x, y, z in rows.tolist()}


def windows(kind: str, resolution: int, snap_bits: int, count: int = 2):
    """Triangle, low corner of a 256^3 box, low corner of an 8^3 window around a spot on it."""
    random = Random(f"{kind} {resolution}")
    for triangle in scenes.spanning(kind, 4, count, resolution, snap_bits):
        for spot in scenes.places_on(triangle, random, snap_bits):
            x, y, z = (c - random.randint(0, WINDOW_EDGE - 1) for c in spot)
            ends = (0, BOX_EDGE - WINDOW_EDGE, random.randrange(BOX_EDGE - WINDOW_EDGE))
            a, b, c = (random.choice(ends) for _ in range(3))
            yield triangle, (x - a, y - b, z - c), (x, y, z)


@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize(("resolution", "snap_bits"), GRIDS)
@pytest.mark.parametrize("kind", scenes.SPANNING)
def test_windows_on_a_spanning_triangle_hold_the_exact_voxels(kind, resolution, snap_bits, ties):
    checked = 0
    for triangle, box_low, low in windows(kind, resolution, snap_bits):
        truth = oracle.voxels_of(triangle, snap_bits, low, WINDOW_EDGE, ties)
        shares = oracle.area_fractions(triangle, snap_bits, low, WINDOW_EDGE)
        checked += len(truth["conservative"])
        for sep in ("6", "26"):
            voxels = voxelize_triangles(triangle[None], snap_bits, box_low, BOX_EDGE, sep, ties)
            within = np.all(
                (voxels.voxel >= low) & (voxels.voxel < np.array(low) + WINDOW_EDGE), axis=1
            )
            rows = [(x, y, z) for x, y, z in voxels.voxel[within].tolist()]
            hits = voxels.hit[within].tolist()
            where = (triangle.tolist(), snap_bits, low, box_low)
            assert set(rows) == truth["conservative"], where
            assert {v for v, hit in zip(rows, hits, strict=True) if hit} == truth[sep], where
            for voxel, area in zip(rows, voxels.area[within].tolist(), strict=True):
                share = shares.get(voxel, 0)
                exact = float(oracle.area_in_units(triangle, snap_bits, share))
                assert abs(area - max(exact, 1)) <= 1 + 1e-9 * exact, (*where, voxel)
    assert checked > 50


@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize(("resolution", "snap_bits"), GRIDS)
def test_windows_where_products_leave_64_bits_hold_the_exact_voxels(resolution, snap_bits, ties):
    random, checked, edge, box_edge = Random(6), 0, 4, 64
    for kind in ("generic", "lattice", "corner to corner"):
        for triangle in scenes.spanning(kind, 8, 4, resolution, snap_bits):
            for spot in scenes.places_at_wraps(triangle, random, snap_bits, 4):
                low = tuple(c - random.randrange(edge) for c in spot)
                box_low = tuple(c - random.randrange(box_edge - edge + 1) for c in low)
                truth = oracle.voxels_of(triangle, snap_bits, low, edge, ties)
                checked += len(truth["conservative"])
                for sep in ("6", "26"):
                    voxels = voxelize_triangles(
                        triangle[None], snap_bits, box_low, box_edge, sep, ties
                    )
                    near = np.all(
                        (voxels.voxel >= low) & (voxels.voxel < np.array(low) + edge), axis=1
                    )
                    where = (triangle.tolist(), snap_bits, low, box_low)
                    assert as_set(voxels.voxel[near]) == truth["conservative"], where
                    assert as_set(voxels.voxel[near & voxels.hit]) == truth[sep], where
    assert checked > 150


@pytest.mark.parametrize(("resolution", "snap_bits"), GRIDS)
def test_there_is_no_second_surface_where_the_plane_value_is_zero_modulo_2_to_the_64(
    resolution, snap_bits
):
    random, checked = Random(9), 0
    for triangle in scenes.spanning("generic", 12, 80, resolution, snap_bits):
        normal = oracle.normal_of(triangle)
        axis = max(range(3), key=lambda c: abs(normal[c]))
        step = 2**64 // abs(normal[axis])  # voxels from the plane to its ghost
        lowest, highest = (triangle[:, axis].min(), triangle[:, axis].max())
        for spot in scenes.places_on(triangle, random, snap_bits):
            for ghost in (spot[axis] - step, spot[axis] + step):
                low = [c - 4 for c in spot]
                low[axis] = ghost - 4
                if not lowest < (ghost << snap_bits) < highest:
                    continue
                window = (low[0], low[1], low[2])
                truth = oracle.voxels_of(triangle, snap_bits, window, 8, "closed")
                voxels = voxelize_triangles(triangle[None], snap_bits, window, 8, "6", "closed")
                assert as_set(voxels.voxel) == truth["conservative"], (triangle.tolist(), window)
                checked += not truth["conservative"]
    assert checked > resolution >> 14


@pytest.mark.parametrize("sep", oracle.SEPARATIONS)
@pytest.mark.parametrize("ties", oracle.TIES)
def test_the_spanning_triangle_that_signed_overflow_once_emptied_is_whole(ties, sep):
    triangle = np.array(
        [
            [18042524, 25573959, 37524125],
            [32994148, 64247750, 43146500],
            [49644248, 4073526, 44499814],
        ]
    )
    low, box_low = (40977, 28581, 42728), (40977, 28329, 42610)
    voxels = voxelize_triangles(triangle[None], 10, box_low, BOX_EDGE, sep, ties)
    near = np.all((voxels.voxel >= low) & (voxels.voxel < np.array(low) + 4), axis=1)
    truth = oracle.voxels_of(triangle, 10, low, 4, ties)
    assert as_set(voxels.voxel[near & voxels.hit]) == truth[sep]
    assert len(truth["conservative"]) == 10


@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize(("resolution", "snap_bits"), GRIDS)
@pytest.mark.parametrize("kind", scenes.SPANNING)
def test_a_spanning_triangle_is_the_same_through_boxes_of_256_and_of_128(
    kind, resolution, snap_bits, ties
):
    for triangle, low, _ in list(windows(kind, resolution, snap_bits))[::4]:
        whole = voxelize_triangles(triangle[None], snap_bits, low, 256, "6", ties)
        parts = []
        for z in (0, 128):
            for y in (0, 128):
                for x in (0, 128):
                    corner = (low[0] + x, low[1] + y, low[2] + z)
                    parts.append(
                        voxelize_triangles(triangle[None], snap_bits, corner, 128, "6", ties)
                    )
        for field in ("voxel", "hit", "area", "vector", "mask"):
            joined = np.concatenate([getattr(part, field) for part in parts])
            assert np.array_equal(joined, getattr(whole, field)), (field, triangle.tolist(), low)
