"""Simplify: the levels above those that voxelize made, each from stored values of the one below.

Constant memory: one block and its unfinished ancestors at a time (thesis 3.3.2). A unit makes the
lower levels of a run of subtrees; the few levels above those are made serially at the end.
"""

import json
from collections.abc import Sequence
from functools import partial

import numpy as np

from gstream.formats.cells import SCENE, Scene
from gstream.formats.columns import COLUMN_IDS, Block, ColumnSpec, Record, decode_column
from gstream.formats.directory import Rows, pile_dtype
from gstream.formats.pile import PileWriter, read_pile_rows
from gstream.formats.rows import block_range, names_json, rows_from_bytes
from gstream.job import Job, Summary, Unit
from gstream.kernels import filters as fast
from gstream.run.publish import Scratch
from gstream.stages import levels
from gstream.stages.levels import LevelPile, coarsest_level, job_columns

NAME = "6-simplify"
SOURCE = "5-merge"
ROWS, PILES, LEVEL_ROWS = "blocks.rows", "piles.json", "levels.rows"
SUBTREE_LEVELS = 3  # a unit's subtrees have up to 8^3 blocks of the highest level that is there
UNIT_BLOCKS = 1024


def plan(job: Job) -> list[Unit]:
    """Runs of whole subtrees, of UNIT_BLOCKS blocks to start from or a little more."""
    with Scratch(job) as scratch:
        scene = _scene(scratch)
        columns = job_columns(job.voxelizing, scene)
        rows = rows_from_bytes(scratch.read(f"{SOURCE}/{ROWS}"), columns)
    base = int(rows["level"].max(initial=0))
    depth = min(SUBTREE_LEVELS, coarsest_level(job.voxelizing, scene) - base)
    first = int(np.searchsorted(rows["level"], base))
    if depth == 0 or first == len(rows):
        return []
    roots = rows["key"] >> np.uint64(3 * depth)
    ends = np.flatnonzero(np.append(roots[1:] != roots[:-1], True)) + 1
    units: list[Unit] = []
    for end in map(int, ends[ends > first]):
        if end - first >= UNIT_BLOCKS or end == len(rows):
            data = (first, end)
            units.append(Unit(NAME, f"{len(units):06}", float(end - first), 0, first, data))
            first = end
    return units


def work(job: Job, unit: Unit) -> None:
    """Make the lower levels of a run of subtrees."""
    first, last = unit.data
    name = f"{NAME}/{unit.name}.gsp"
    with Scratch(job) as scratch:
        columns = job_columns(job.voxelizing, _scene(scratch))
        row_bytes = pile_dtype(columns).itemsize
        data = scratch.read(f"{SOURCE}/{ROWS}", first * row_bytes, (last - first) * row_bytes)
        piles = json.loads(scratch.read(f"{SOURCE}/{PILES}"))
        rows = rows_from_bytes(data, columns)
        counts = _make_levels(job, scratch, name, rows, piles, SUBTREE_LEVELS)
        scratch.mark_done(unit, counts, (name,))


def finish(job: Job) -> Summary:
    """Make the levels above the subtrees, one after another, and publish the rows of all levels."""
    units, counts = plan(job), {"blocks": 0, "voxels": 0}
    with Scratch(job) as scratch:
        scene = _scene(scratch)
        last = coarsest_level(job.voxelizing, scene)
        names = [f"{NAME}/{unit.name}.gsp" for unit in units]
        done = scratch.finished(units)
        parts = [_pile_rows(scratch, name, number) for number, name in enumerate(names)]
        rows = np.concatenate([np.empty(0, pile_dtype(job_columns(job.voxelizing, scene))), *parts])
        reached = int(rows["level"].max(initial=0))
        if 0 < reached < last:
            roots = np.sort(rows[rows["level"] == reached], order="key")
            top = f"{NAME}/top.gsp"
            done.append(_make_levels(job, scratch, top, roots, names, last))
            rows = np.concatenate([rows, _pile_rows(scratch, top, len(names))])
            names.append(top)
        with scratch.write(f"{NAME}/{LEVEL_ROWS}") as file:
            file.write(rows.tobytes())
        with scratch.write(f"{NAME}/{PILES}") as file:
            file.write(names_json(names))
    counts = {key: sum(part[key] for part in done) for key in counts}
    return Summary(NAME, {**counts, "levels": last + 1})


def warm() -> None:
    """Compile the kernels of this stage."""
    levels.warm()


def _make_levels(
    job: Job, scratch: Scratch, name: str, rows: Rows, piles: Sequence[str], more: int
) -> dict[str, int]:
    """Write a pile of up to `more` levels above `rows`, sorted blocks of one level; its counts."""
    scene, settings = _scene(scratch), job.voxelizing
    columns = job_columns(settings, scene)
    base = int(rows["level"][0])
    top = min(base + more, coarsest_level(settings, scene))
    with scratch.write(name) as file, PileWriter(file, columns) as pile:
        above = LevelPile(pile, settings, scene, top)
        for row in rows:
            block = _read(scratch, piles[int(row["pile"])], row, columns, above.log2_edge)
            above.climb(int(row["key"]), base, block)
        above.close()
    return {"blocks": above.blocks, "voxels": above.voxels}


def _read(
    scratch: Scratch, name: str, row: np.void, columns: Sequence[ColumnSpec], log2_edge: int
) -> Block:
    offset, length = block_range(row, columns)
    data = memoryview(scratch.read(name, offset, length))
    arrays = {}
    for column in columns:
        if column.id not in COLUMN_IDS:
            continue
        stored = row[column.name]
        fields = ("codec", "filter", "constant", "raw")
        record = Record(*(int(stored[field]) for field in fields))
        at = int(stored["offset"]) - offset if stored["stored"] else 0
        arrays[column.name] = decode_column(
            column, record, data[at : at + int(stored["stored"])], int(row["count"]),
            log2_edge, filters=fast, path=name, at=int(stored["offset"]),
        )  # fmt: skip
    return Block(
        arrays["occupancy"], arrays["mask"], arrays.get("normal"),
        arrays.get("colour"), arrays.get("weight"),
    )  # fmt: skip


def _scene(scratch: Scratch) -> Scene:
    return Scene.from_json(scratch.read(f"{SOURCE}/{SCENE}"))


def _pile_rows(scratch: Scratch, name: str, number: int) -> Rows:
    rows = read_pile_rows(partial(scratch.read, name), scratch.size(name), name)
    rows["pile"] = number
    return rows
