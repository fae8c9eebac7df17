"""Sorting into cells: a small triangle is in each cell that its box touches, corner by corner."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gstream.kernels.presort import SEGMENT_VERTICES, classify, gather, unpack
from gstream.kernels.voxelize import SPREAD, compact
from gstream.stages.presort import Mesh, _small_segments

K, CELL_BITS, RESOLUTION = 4, 3, 32  # cells of 8 voxels of 16 snap units, 4 along each axis
CELL = 1 << (K + CELL_BITS)


def mesh_of(vertices, triangles):
    triangles = np.array(triangles, np.uint32).reshape(-1, 3)
    return Mesh(np.array(vertices, np.int32), triangles, np.zeros((len(triangles), 3, 0), "u4"))


def classified(mesh, rules):
    """Kinds, keys and counts of a mesh's triangles."""
    kinds, keys = np.zeros(len(mesh.triangles), np.uint8), np.zeros(len(mesh.triangles), np.uint32)
    counts = np.zeros(64, np.int64)
    classify(mesh.vertices, mesh.triangles, rules, SPREAD, kinds, keys, counts)
    return kinds, keys, counts


def stored(mesh, closed=False):
    """(cell, number, corners) of every triangle of every segment, read back; segments."""
    rules = (K, CELL_BITS, RESOLUTION, closed)
    kinds, keys, counts = classified(mesh, rules)
    found, segments = Counter(), 0
    for cell, owners, packed, indices in _small_segments(mesh, kinds, keys, counts, rules):
        points = np.empty((len(packed), 3), np.int64)
        unpack(packed.copy(), CELL // 2, np.zeros(3, np.int64), points)
        points += compact(np.array([cell], np.uint32))[0].astype(np.int64) * CELL
        corners = np.empty((len(indices), 3, 3), np.int64)
        gather(indices.copy(), points, corners)
        found.update((cell, n, c.tobytes()) for n, c in zip(owners.tolist(), corners, strict=True))
        segments += 1
    return found, segments


def wanted(mesh, closed):
    """The same, triangle by triangle and cell by cell, from the words of the rule."""
    found = Counter()
    for number, ids in enumerate(mesh.triangles):
        corners = mesh.vertices[ids].astype(np.int64)
        low, high = corners.min(axis=0), corners.max(axis=0)
        if ((high - low) >= CELL // 2).any():
            continue
        for cell in range(64):
            corner = compact(np.array([cell], np.uint32))[0].astype(np.int64) * CELL
            # With closed ties, a voxel is met that a corner touches from above.
            above = low <= corner + CELL if closed else low < corner + CELL
            if (above & (high >= corner)).all():
                found[cell, number, corners.tobytes()] += 1
    return found


@given(
    st.lists(st.tuples(*[st.integers(-40, 4 * CELL + 40)] * 3), min_size=3, max_size=20),
    st.lists(st.tuples(*[st.integers(0, 19)] * 3), min_size=1, max_size=30),
    st.booleans(),
)
def test_a_small_triangle_is_in_just_the_cells_that_its_box_touches(vertices, triangles, closed):
    mesh = mesh_of(vertices, np.array(triangles) % len(vertices))
    assert stored(mesh, closed)[0] == wanted(mesh, closed)


@pytest.mark.parametrize("vertices", [SEGMENT_VERTICES, SEGMENT_VERTICES + 3, 3 * SEGMENT_VERTICES])
def test_a_cell_with_more_vertices_than_indices_can_name_has_several_segments(vertices):
    count = vertices // 3 * 3
    points = np.random.default_rng(vertices).integers(0, CELL // 2, (count, 3))
    found, segments = stored(mesh_of(points, np.arange(count)))
    assert sum(found.values()) == count // 3
    assert set(found.values()) == {1}
    assert segments == -(-count // (SEGMENT_VERTICES // 3 * 3))


def test_vertices_that_triangles_share_are_stored_once():
    side = 41
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(side * side)], axis=1)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    squares = np.stack([corner, corner + 1, corner + side + 1, corner + side], axis=1)
    mesh = mesh_of(points, np.concatenate([squares[:, :3], squares[:, [0, 2, 3]]]))
    rules = (K, CELL_BITS, RESOLUTION, False)
    kinds, keys, counts = classified(mesh, rules)
    [(_, owners, packed, _)] = _small_segments(mesh, kinds, keys, counts, rules)
    assert (len(owners), len(packed)) == (2 * (side - 1) ** 2, side * side)
