"""Merge: the piles of all cells to one list of blocks, level by level in Morton order.

Finished blocks are not moved: merging orders their rows, and refuses two blocks of one key.
"""

import json
from dataclasses import replace
from functools import partial

import numpy as np

from gstream.errors import StoppedError
from gstream.formats.cells import SCENE, Scene
from gstream.formats.pile import read_pile_rows
from gstream.formats.rows import names_json
from gstream.job import Job, Summary, Unit
from gstream.run.publish import Scratch

NAME = "5-merge"
SOURCE, PRESORTED = "4-voxelize", "3-presort"
ROWS, PILES = "blocks.rows", "piles.json"


def plan(job: Job) -> list[Unit]:
    """One unit: the order is global."""
    return [Unit(NAME, "rows")]


def work(job: Job, unit: Unit) -> None:
    """Read every pile's index and publish the merged rows."""
    with Scratch(job) as scratch:
        names = [f"{SOURCE}/{path.name}" for path in sorted(scratch.path(SOURCE).glob("*.gsp"))]
        parts = []
        for number, name in enumerate(names):
            rows = read_pile_rows(partial(scratch.read, name), scratch.size(name), name)
            rows["pile"] = number
            parts.append(rows)
        merged = np.concatenate(parts)
        merged = merged[np.lexsort((merged["key"], merged["level"]))]
        place = merged[["level", "key"]]
        twice = np.flatnonzero(place[1:] == place[:-1])
        if len(twice):
            raise StoppedError(
                f"two finished blocks of level {place[twice[0]]['level']} have the key "
                f"{place[twice[0]]['key']}",
                f"delete {job.folder} and run again",
            )
        with scratch.write(f"{NAME}/{ROWS}") as file:
            file.write(merged.tobytes())
        with scratch.write(f"{NAME}/{PILES}") as file:
            file.write(names_json(names))
        with scratch.write(f"{NAME}/{SCENE}") as file:
            file.write(_scene_with_ledger(scratch).to_json().encode())
        counts = {"piles": len(names), "blocks": len(merged), "voxels": int(merged["count"].sum())}
        scratch.mark_done(unit, counts, (f"{NAME}/{ROWS}", f"{NAME}/{PILES}", f"{NAME}/{SCENE}"))


def _scene_with_ledger(scratch: Scratch) -> Scene:
    """The scene with the counts of presort and of all voxelize units."""
    scene = Scene.from_json(scratch.read(f"{PRESORTED}/{SCENE}"))
    totals = dict(scene.counts)
    for path in sorted(scratch.path(SOURCE).glob("*.done")):
        for key, value in json.loads(scratch.read(f"{SOURCE}/{path.name}"))["counts"].items():
            if key != "voxels":
                totals[key] = totals.get(key, 0) + value
    fates = sum(totals[key] for key in ("non_finite", "outside", "assigned", "unassigned"))
    if totals["triangles"] != fates:
        raise RuntimeError(f"{totals['triangles']} triangles were read, {fates} accounted for")
    return replace(scene, counts=totals)


def finish(job: Job) -> Summary:
    """The counts of the one unit."""
    with Scratch(job) as scratch:
        counts = scratch.finished(plan(job))[0]
    return Summary(NAME, counts)
