"""Millions of voxel tests: for each mode and tie rule, kernel and oracle agree voxel by voxel.

Per mode and tie rule the long part compares 7,311,360 voxels of windows of 8^3 and 16^3, all kinds
of scenes.py alike. Most are far from their triangle, which is quickly decided. Of the rest, 109,972
voxels are met by it with one-sided ties and 124,508 with closed ones; 489,970 and 528,405 are met
or touch one that is.
"""

from collections import Counter

import numpy as np
import pytest
from exact import oracle, scenes
from numpy.typing import NDArray

from gstream.kernels.voxelize import Rules, compact, fragments

# snap bits, low corner of the window, its edge, triangles of each kind in the long part. Up to 16
# snap bits small triangles go in packets.
SETTINGS = (
    (1, (-5, 0, 3), 16, 28),
    (4, (0, 0, 0), 16, 28),
    (8, (100, -3, 40), 16, 28),
    (12, (16_300, 9, -70), 16, 28),
    (16, (40, -8, 0), 8, 28),
    (17, (0, 0, 0), 8, 28),
)
Bools = NDArray[np.bool_]


def found(triangles: NDArray[np.int64], rules: Rules, low: scenes.Vector, edge: int) -> Bools:
    """[triangle, met or target met, x, y, z]: what the kernels say, all triangles at once."""
    marked = np.zeros((len(triangles), 2, edge, edge, edge), bool)
    corners = triangles - (np.array(low) << rules.snap_bits)
    for owners, keys, hits in fragments(corners, rules, (edge, edge, edge)):
        x, y, z = compact(keys).T
        marked[owners, 0, x, y, z] = True
        marked[owners, 1, x, y, z] = hits
    return marked


def dense(voxels: set[scenes.Vector], low: scenes.Vector, edge: int) -> Bools:
    grid = np.zeros((edge,) * 3, bool)
    if voxels:
        grid[tuple((np.array(sorted(voxels)) - low).T)] = True
    return grid


def widened(grid: Bools) -> Bools:
    """Every voxel with its 26 neighbours."""
    for axis in range(3):
        front = np.moveaxis(grid, axis, 0)
        wide = front.copy()
        wide[1:] |= front[:-1]
        wide[:-1] |= front[1:]
        grid = np.moveaxis(wide, 0, axis)
    return grid


@pytest.mark.parametrize("part", [7, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("ties", oracle.TIES)
def test_millions_of_voxels_are_set_as_the_oracle_sets_them(ties, part):
    """0 mismatches; the quick part takes one triangle in 7: 1,044,480 voxels."""
    tests: Counter[str] = Counter()
    met = near = 0
    for kind in scenes.KINDS:
        for snap_bits, low, edge, count in SETTINGS:
            triangles = scenes.soup(kind, 21, count // part, snap_bits, low, edge)
            truths = [oracle.voxels_of(t, snap_bits, low, edge, ties) for t in triangles]
            whole = np.array([dense(t["conservative"], low, edge) for t in truths])
            met += int(np.count_nonzero(whole))
            near += sum(int(np.count_nonzero(widened(grid))) for grid in whole)
            for sep in oracle.SEPARATIONS:
                wanted = np.array([dense(t[sep], low, edge) for t in truths])
                marked = found(triangles, Rules(snap_bits, sep, ties == "closed", False), low, edge)
                wrong = (marked[:, 0] != whole) | (marked[:, 1] != wanted)
                assert not wrong.any(), (kind, snap_bits, sep, triangles[wrong.any((1, 2, 3))])
                tests[sep] += wrong.size
    assert set(tests.values()) == {7_311_360 // part}
    assert met > 90_000 // part
    assert near > 4 * met
