"""Two ways to the same fragments: all voxels of a small box at once, and voxel by voxel.

Triangles with channels go voxel by voxel, so a channel of zeros is enough to ask the other way.
"""

import numpy as np
import pytest
from exact import oracle

from gstream.kernels.voxelize import voxelize_triangles

SNAP_BITS = (2, 8, 12)
COUNT = 400


def soup(kind: str, snap_bits: int, seed: int) -> np.ndarray:
    """(COUNT, 3, 3) i8 corners of triangles of 0 to 12 voxels in a box of 64^3."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(8, 56, (COUNT, 1, 3))
    edge = 10.0 ** rng.uniform(-2, 0.9, (COUNT, 1, 1))
    corners = centre + rng.normal(size=(COUNT, 3, 3)) * edge
    units = np.floor(corners * 2**snap_bits + 0.5).astype(np.int64)
    step = {"free": 1, "half lattice": 2 ** (snap_bits - 1), "lattice": 2**snap_bits}[kind]
    return units // step * step


@pytest.mark.parametrize("sep", ["conservative", "6", "26"])
@pytest.mark.parametrize("ties", oracle.TIES)
@pytest.mark.parametrize("kind", ["free", "half lattice", "lattice"])
def test_a_small_box_at_once_gives_the_fragments_of_voxel_by_voxel(kind, ties, sep):
    for snap_bits in SNAP_BITS:
        corners = soup(kind, snap_bits, seed=snap_bits)
        low, edge = (0, 0, 0), 64
        once = voxelize_triangles(corners, snap_bits, low, edge, sep, ties)
        zeros = np.zeros((COUNT, 3, 1))
        single = voxelize_triangles(corners, snap_bits, low, edge, sep, ties, zeros)
        assert once.fragments == single.fragments
        for name in ("voxel", "hit", "mask", "assigned"):
            np.testing.assert_array_equal(getattr(once, name), getattr(single, name), name)
        # a unit for each fragment of a voxel, of which the densest here have some dozen
        for name in ("area", "vector"):
            assert np.abs(getattr(once, name) - getattr(single, name)).max() <= 64, name
