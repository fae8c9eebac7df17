"""Two ways to the same fragments: small triangles in packets, and voxel by voxel."""

import numpy as np
import pytest

from gstream.kernels import voxelize
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


def no_packets(corners, rules, order, shapes):
    """In the place of `arrange`: every triangle goes voxel by voxel."""
    order[:] = np.arange(len(order))
    return 0


@pytest.mark.parametrize("channels", [0, 4])
@pytest.mark.parametrize("sep", ["conservative", "6"])
@pytest.mark.parametrize("kind", ["free", "half lattice", "lattice"])
def test_packets_give_the_fragments_of_voxel_by_voxel(monkeypatch, kind, sep, channels):
    for snap_bits in SNAP_BITS:
        corners = soup(kind, snap_bits, seed=snap_bits)
        values = np.random.default_rng(5).uniform(0, 1, (COUNT, 3, channels))
        job = (corners, snap_bits, (0, 0, 0), 64, sep, "one-sided", values)
        packed = voxelize_triangles(*job)
        with monkeypatch.context() as patch:
            patch.setattr(voxelize, "arrange", no_packets)
            single = voxelize_triangles(*job)
        assert packed.fragments == single.fragments
        for name in ("voxel", "hit", "mask", "assigned"):
            np.testing.assert_array_equal(getattr(packed, name), getattr(single, name), name)
        # a unit for each fragment of a voxel, of which the densest here have some dozen
        for name in ("area", "vector", "colour"):
            difference = np.abs(getattr(packed, name) - getattr(single, name))
            unit = 4096 if name == "vector" else 1
            assert difference.max(initial=0) <= 64 * unit, name


def test_most_small_triangles_go_in_packets():
    order, shapes = np.empty(COUNT, np.int32), np.empty(COUNT, np.int16)
    small = voxelize.arrange(soup("free", 12, 1), (12, 6, False, False), order, shapes)
    assert small > 0.8 * COUNT
    assert sorted(order) == list(range(COUNT))
