"""Levels from blocks in memory: the rows and columns of the plain rule, whoever makes them."""

import io

import numpy as np
import pytest
from small_block_files import pile_bytes, random_scene

from gstream.formats.cells import Scene
from gstream.formats.pile import PileWriter, read_pile_rows
from gstream.grid import Grid
from gstream.job import VoxelizeSettings
from gstream.stages.levels import LevelPile, coarsest_level, job_columns

BOX = ((0.0,) * 3, (50.0,) * 3)
SCENE = Scene(Grid(50, 1.0, (0.0,) * 3, 12), 5, True, False, BOX, {}, {})
ALL = ("occupancy", "mask", "normal", "colour", "weight")


def rows_of(data: bytes):
    rows = read_pile_rows(lambda at, n: data[at : at + n], len(data))
    return rows[np.lexsort((rows["key"], rows["level"]))]


def made(blocks, base, top, settings):
    """Rows of a pile to which the blocks of level `base` were written."""
    file = io.BytesIO()
    with PileWriter(file, job_columns(settings, SCENE)) as pile:
        levels = LevelPile(pile, settings, SCENE, top)
        for key, block in blocks:
            levels.write(key, base, block)
        levels.close()
    rows = rows_of(file.getvalue())
    assert levels.blocks == len(rows)
    assert levels.voxels == rows["count"].sum()
    return rows


@pytest.mark.parametrize("keep_weights", [False, True])
@pytest.mark.parametrize("top", [0, 1, 2, 3])
def test_levels_up_to_any_are_those_of_the_plain_rule(top, keep_weights):
    settings = VoxelizeSettings(resolution=50, block=8, keep_weights=keep_weights)
    scene = random_scene(resolution=50, voxels=3000, seed=top)
    assert coarsest_level(settings, SCENE) == 3
    finest = [(key, block) for (level, key), block in scene.blocks.items() if level == 0]
    rows = made(finest, 0, top, settings)
    wanted = rows_of(pile_bytes(scene))
    wanted = wanted[wanted["level"] <= top]
    for name in ("key", "level", "count", "low", "high", "children"):
        np.testing.assert_array_equal(rows[name], wanted[name])
    for name in ALL[:-1]:
        np.testing.assert_array_equal(rows["hash"][name], wanted["hash"][name])
    needed = keep_weights | ((rows["level"] == top) & (top < 3))
    wanted_raw = wanted["weight"]["raw"] * needed
    np.testing.assert_array_equal(rows["weight"]["raw"], wanted_raw)


def test_without_levels_of_detail_every_weight_is_stored():
    settings = VoxelizeSettings(resolution=50, block=8, lod=False)
    scene = random_scene(resolution=50, lod=False)
    rows = made([(key, block) for (_, key), block in scene.blocks.items()], 0, 0, settings)
    assert coarsest_level(settings, SCENE) == 0
    assert (rows["weight"]["raw"] > 0).all()
