"""Reading the sums of a box: the kept voxels in Morton order, and the areas."""

import numpy as np
import pytest

from gstream.kernels.accumulate import AREA, HIT, TILE_VOXELS
from gstream.kernels.select import collect, sum_areas


@pytest.fixture
def box():
    """tile_slots, tiles, flags, sums of 300 voxels in 5 of 16 tiles, one of which stayed empty."""
    rng = np.random.default_rng(3)
    tile_slots = np.full(16, -1, np.int32)
    tile_slots[[1, 4, 5, 9, 15]] = [3, 0, 4, 1, 2]
    tiles = np.full((6, TILE_VOXELS), -1, np.int32)
    places = rng.choice(4 * TILE_VOXELS, 300, replace=False)
    tiles[places // TILE_VOXELS, places % TILE_VOXELS] = rng.permutation(300)
    flags = rng.integers(0, 2 * HIT, 300).astype(np.uint8)
    return tile_slots, tiles, flags, rng.integers(1, 1 << 40, (300, 4))


@pytest.mark.parametrize("wanted", [0, HIT])
@pytest.mark.parametrize(("first", "last"), [(0, 16), (4, 10), (2, 4)])
def test_voxels_come_in_morton_order_without_those_not_wanted(box, first, last, wanted):
    tile_slots, tiles, flags, _ = box
    rows_of_codes = np.where(tile_slots[:, None] < 0, -1, tiles[tile_slots])[first:last].ravel()
    codes = np.flatnonzero(rows_of_codes >= 0)
    codes = codes[flags[rows_of_codes[codes]] & wanted == wanted]
    found = collect(tile_slots[first:last], tiles, flags, wanted)
    np.testing.assert_array_equal(found[0], rows_of_codes[codes])
    np.testing.assert_array_equal(found[1], codes)


def test_areas_are_of_all_voxels_and_of_those_without_a_hit(box):
    _, _, flags, sums = box
    pruned = sums[flags & HIT == 0, AREA].sum()
    assert sum_areas(sums, flags) == (sums[:, AREA].sum(), pruned)
