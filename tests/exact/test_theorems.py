"""What holds for all meshes alike: modes within modes, levels that separate, areas that add up."""

from collections.abc import Iterator
from random import Random

import numpy as np
import pytest
from exact import oracle, scenes
from exact.flood import PATHS, dense, flooded, inside, leaks
from numpy.typing import NDArray

from gstream.formats.lodrule import COLOUR_TABLES
from gstream.formats.morton import decode_morton, encode_morton
from gstream.kernels.lod import reduce_runs
from gstream.kernels.voxelize import Voxels, voxelize_triangles

FIELDS = ("voxel", "hit", "area", "vector", "mask", "colour")
EDGE = 64
each_mode = pytest.mark.parametrize(
    ("sep", "ties"), [(sep, ties) for sep in oracle.SEPARATIONS for ties in oracle.TIES]
)


def mixed(seed: int, snap_bits: int, edge: int) -> NDArray[np.int64]:
    """Up to 20 triangles of random kinds in and around the box 0 .. edge."""
    random = Random(seed)
    kinds = random.choices(list(scenes.KINDS), k=random.randint(1, 20))
    soups = [scenes.soup(kind, seed, 1, snap_bits, (0, 0, 0), edge) for kind in kinds]
    return np.concatenate(soups)


@pytest.mark.parametrize("ties", oracle.TIES)
def test_the_sets_of_6_and_26_are_within_the_conservative_one(ties):
    for seed in range(40):
        soup = mixed(seed, 7, 16)
        sets = {}
        for sep in oracle.SEPARATIONS:
            voxels = voxelize_triangles(soup, 7, (0, 0, 0), 16, sep, ties)
            sets[sep] = {tuple(v) for v in voxels.voxel[voxels.hit].tolist()}
        assert sets["6"] <= sets["conservative"], seed
        assert sets["26"] <= sets["conservative"], seed
        assert len(sets["6"]) < len(sets["26"]) or len(soup) < 20, seed


def rows(parts: list[Voxels]) -> list[NDArray[np.int64]]:
    """The fields of all parts, by voxel."""
    voxel = np.concatenate([part.voxel for part in parts])
    order = np.lexsort(voxel.T)
    return [np.concatenate([getattr(part, field) for part in parts])[order] for field in FIELDS]


@each_mode
@pytest.mark.parametrize("channels", [0, 4])
def test_turning_corners_shuffling_and_cutting_boxes_change_no_bit(sep, ties, channels):
    """480 small meshes over the cases of this test; a box of 8 to 64 is cut in up to 64."""
    for seed in range(40):
        random, rng = Random(seed), np.random.default_rng(seed)
        edge, snap_bits = random.choice([8, 16, 32, 64]), random.choice([1, 5, 9, 12])
        soup = mixed(seed, snap_bits, edge)
        values = rng.uniform(0, 65_535, (len(soup), 3, channels))
        whole = voxelize_triangles(soup, snap_bits, (0, 0, 0), edge, sep, ties, values)
        order, turns = rng.permutation(len(soup)), rng.integers(0, 3, len(soup))
        corner = (np.arange(3) + turns[:, None]) % 3
        turned = soup[order[:, None], corner[order]], values[order[:, None], corner[order]]
        size = max(8, edge // random.choice([1, 2, 4]))
        lows = np.stack(np.meshgrid(*[np.arange(0, edge, size)] * 3), -1).reshape(-1, 3)
        parts = [
            voxelize_triangles(turned[0], snap_bits, tuple(low), size, sep, ties, turned[1])
            for low in lows.tolist()
        ]
        for field, a, b in zip(FIELDS, rows(parts), rows([whole]), strict=True):
            np.testing.assert_array_equal(a, b, f"{field} {seed}")
        assigned = np.any([part.assigned for part in parts], axis=0)
        assert np.array_equal(assigned, whole.assigned[order])
        assert sum(part.fragments for part in parts) == whole.fragments


def convex_meshes() -> Iterator[NDArray[np.int64]]:
    """Ties everywhere, none, and at random, in a grid of 64^3 with 3 snap bits."""
    for middle in (32 * 8, 32 * 8 + 4, 32 * 8 + 3):
        yield scenes.octahedron((middle,) * 3, 24 * 8)
        yield scenes.box((middle - 160, middle - 97, middle - 64), (middle + 160,) * 3)
        yield scenes.turned_box((middle,) * 3, 23 * 8, 12 * 8 + 4)
    random = Random(3)
    for step in (8, 4, 1):
        for _ in range(4):
            yield scenes.tetrahedron(random, EDGE * 8 - 2 * step, step) + step


def parents(voxels: NDArray[np.int64]) -> NDArray[np.int64]:
    """Voxels of the next level, by the rule that the program uses."""
    codes = np.sort(encode_morton(voxels))
    none = np.empty((0, 2), np.uint16), np.empty((0, 4), np.uint8), np.empty(0, np.uint32)
    mask = np.ones(len(codes), np.uint8)
    morton = reduce_runs(codes, mask, *none, 11, False, COLOUR_TABLES)[0]
    return decode_morton(morton.astype(np.uint64)).astype(np.int64)


@each_mode
def test_levels_of_a_separating_set_still_separate(sep, ties):
    """A free path of a level is a free path of the one below: eight children of it are unset."""
    for mesh in convex_meshes():
        found = voxelize_triangles(mesh, 3, (0, 0, 0), EDGE, sep, ties)
        voxels, side = found.voxel[found.hit], inside(mesh, 3, EDGE, ties)
        edge = EDGE
        while edge >= 8:
            surface = dense(voxels, edge)
            assert leaks(surface, side, PATHS[sep]) == 0, (edge, mesh.tolist())
            voxels, edge = parents(voxels), edge // 2
            assert len(np.unique(voxels, axis=0)) == len(voxels)
            # The eight children of an unset voxel are unset neighbours, so any tells its side.
            side = side[::2, ::2, ::2]


@pytest.mark.parametrize("sep", ["6", "26"])
def test_kept_and_pruned_areas_add_up_to_the_mesh_and_closed_vectors_to_nothing(sep):
    """Large triangles, whose fragments' rounding to 2^-26 is below the bounds of the theorem."""
    meshes = [
        scenes.sphere(steps, 28.0 * 4096, (32 * 4096 + 5,) * 3, 1, wobble)
        for steps, wobble in ((1, 0.0), (2, 0.1), (5, 0.1))
    ]
    for mesh in meshes:
        whole = sum(float(oracle.area_in_units(t, 12, 1)) for t in mesh)
        parts = [
            voxelize_triangles(mesh, 12, (x, y, z), 32, sep, "one-sided")
            for x in (0, 32) for y in (0, 32) for z in (0, 32)
        ]  # fmt: skip
        kept = sum(int(part.area[part.hit].sum()) for part in parts)
        pruned = sum(int(part.area[~part.hit].sum()) for part in parts)
        assert abs(kept + pruned - whole) <= 1e-6 * whole
        assert (pruned > 0.01 * whole) == (sep == "6")  # 26 prunes next to nothing
        rest = np.sum([part.vector.sum(axis=0) for part in parts], axis=0) / 2**12
        assert np.abs(rest).max() <= 1e-9 * whole, (rest, whole)


def solid(kind: str, edge: int, snap_bits: int) -> NDArray[np.int64]:
    unit = 1 << snap_bits
    middle, reach = (edge // 2 * unit,) * 3, (edge // 2 - 8) * unit
    if kind == "displaced sphere":
        return scenes.sphere(edge // 4, 0.4 * edge * unit, middle, 1, 0.15)
    if kind == "octahedron":
        return scenes.octahedron(middle, reach)
    if kind == "box":
        return scenes.box((8 * unit,) * 3, ((edge - 8) * unit,) * 3)
    return scenes.turned_box(middle, reach, edge // 4 * unit)


@pytest.mark.parametrize("edge", [64, pytest.param(512, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", ["displaced sphere", "octahedron", "box", "turned box"])
@each_mode
def test_no_flood_from_outside_enters_a_solid(kind, sep, ties, edge):
    snap_bits = 8
    mesh, size = solid(kind, edge, snap_bits), min(edge, 256)
    surface = np.zeros((edge,) * 3, bool)
    for low in np.ndindex((edge // size,) * 3):
        box_low = tuple(c * size for c in low)
        found = voxelize_triangles(mesh, snap_bits, box_low, size, sep, ties)
        surface[tuple(found.voxel[found.hit].T)] = True
    reached = flooded(surface, PATHS[sep])
    assert reached[-1, -1, -1]
    core = (slice(edge // 2 - edge // 16, edge // 2 + edge // 16),) * 3
    assert not surface[core].any()
    assert not reached[core].any()
