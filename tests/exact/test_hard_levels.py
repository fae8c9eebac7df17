"""Hard cases of blocks and levels: odd grids, borders of blocks, full blocks, single voxels."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from e2e.meshes import sphere, write_ply
from numpy.typing import NDArray

import gstream
from gstream.formats import filters as plain
from gstream.formats.columns import Block, column_specs, decode_column, encode_block
from gstream.formats.lodrule import COLOUR_TABLES
from gstream.formats.morton import decode_morton
from gstream.kernels import filters as fast
from gstream.kernels.lod import reduce_runs
from gstream.kernels.morton import tight_bounds


def build(folder: Path, points: Any, triangles: Any, **settings: Any) -> Path:
    mesh = write_ply(folder / "mesh.ply", np.asarray(points, float), np.asarray(triangles))
    more = {"block": 8, "workers": 0, "force": True, **settings}
    gstream.build(mesh, folder / "out.gsb", **more)
    assert gstream.check(folder / "out.gsb").ok
    return folder / "out.gsb"


def voxels_of(file, level: int) -> NDArray[np.int64]:
    held = [view.positions() for view in file.blocks(level)]
    return np.concatenate(held).astype(np.int64) if held else np.empty((0, 3), np.int64)


@pytest.mark.parametrize("resolution", [1, 2, 3, 7, 8, 9, 17, 33, 63, 65])
def test_levels_of_any_resolution_are_the_halves_of_the_one_below(tmp_path, resolution):
    """H-SM-3, H-SM-4, H-SM-7. Odd grids too, down to one block; one voxel at a place."""
    path = build(tmp_path, *sphere(12), resolution=resolution, sep="26")
    with gstream.open(path) as file:
        edge, written = resolution, file.metadata["ledger"]["voxels"]
        assert file.levels == max(1, int(np.ceil(np.log2(-(-resolution // 8)))) + 1)
        below = voxels_of(file, 0)
        for level in range(file.levels):
            here = voxels_of(file, level)
            assert len(np.unique(here, axis=0)) == len(here) == written[level]
            assert here.min() >= 0
            assert here.max() < edge
            if level:
                halves = np.unique(below // 2, axis=0)
                np.testing.assert_array_equal(np.unique(here, axis=0), halves)
            below, edge = here, -(-edge // 2)
        assert len(list(file.blocks(file.levels - 1))) == 1


def test_eight_voxels_around_a_corner_of_blocks_climb_without_doubling(tmp_path):
    """H-SM-4. Voxels 7 and 8 of each axis, the last and the first of eight blocks."""
    places = [(x, y, z) for x in (7, 8) for y in (7, 8) for z in (7, 8)]
    places += [(0, 0, 0), (31, 31, 31)]
    triangles = np.repeat(np.arange(10)[:, None], 3, axis=1)
    points = np.array(places) + 0.5
    path = build(tmp_path, points, triangles, voxel_size=1.0, sep="conservative")
    with gstream.open(path) as file:
        assert [len(list(file.blocks(level))) for level in range(file.levels)] == [9, 2, 1]
        for level in range(file.levels):
            wanted = {(x >> level, y >> level, z >> level) for x, y, z in places}
            assert sorted(map(tuple, voxels_of(file, level).tolist())) == sorted(wanted)


LAST = 8**8 - 1
FULL = pytest.param(np.arange(8**8), marks=pytest.mark.long, id="full")


@pytest.mark.parametrize(
    "codes", [[0], [LAST], [0, LAST], np.arange(LAST - 70_000, LAST + 1), FULL]
)
def test_blocks_of_256_hold_their_first_their_last_and_all_of_their_voxels(codes):
    """H-SM-1. Up to 16.7 million voxels and coordinates of 255."""
    morton = np.array(codes, np.uint32)
    n = len(morton)
    ramp = np.arange(n, dtype=np.uint32)
    block = Block(morton, (1 + ramp % 63).astype(np.uint8), weight=ramp + np.uint32(1))
    encoded = encode_block(block, 8, block.names(), 11, "fast", filters=fast)
    for name, column in encoded.items():
        spec = column_specs(11)[name]
        wanted = morton if name == "occupancy" else getattr(block, name)
        for filters in (fast, plain) if n < 10 else (fast,):
            got = decode_column(
                spec, column, column.data, n, 8, filters=filters, path="a.gsb", at=0
            )
            assert np.array_equal(got, wanted)
    none = np.empty((0, 2), np.uint16), np.empty((0, 4), np.uint8)
    up = reduce_runs(morton, block.mask, *none, block.weight, 11, True, COLOUR_TABLES)
    assert np.array_equal(up[0], np.unique(morton >> 3))
    assert np.array_equal(up[1], np.bitwise_or.reduceat(block.mask, starts_of(morton)))
    low, high = tight_bounds(morton)
    places = decode_morton(morton)
    assert (list(low), list(high)) == (places.min(0).tolist(), places.max(0).tolist())


def starts_of(morton: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Where the runs of children of one parent begin."""
    return np.flatnonzero(np.diff(morton >> 3, prepend=np.uint32(LAST)))
