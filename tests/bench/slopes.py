"""How CPU time grows over a ladder: with triangles at one edge or resolution, and with voxels."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tests.bench.figures import PowerLaw, power_law
from tests.bench.runs import ALONE, Run

TRIANGLES, VOXELS = "triangles", "voxels"
SPHERE = "sphere"  # first word of the name of the meshes that differ in triangles alone


@dataclass(frozen=True, slots=True)
class Slope:
    """The power law of some runs' CPU seconds."""

    what: str
    unit: str  # TRIANGLES | VOXELS
    runs: int
    smallest: int
    largest: int
    law: PowerLaw
    net: PowerLaw | None  # less what the start takes, which hides the law of small meshes


def slopes(runs: Sequence[Run], starts: Mapping[str, float]) -> Iterator[Slope]:
    """Every law that at least two sizes show.

    starts : CPU seconds that each `Run.start` takes on next to nothing
    """
    spheres = [run for run in runs if run.mesh.startswith(SPHERE)]
    edges = [run for run in spheres if run.edge]
    chosen = [run for run in spheres if run.resolution and not run.edge]
    families = [("ingest", TRIANGLES, [run for run in spheres if run.command == "ingest"])]
    families += [
        (f"voxelize, edge {edge:g}", TRIANGLES, some)
        for edge, some in _grouped(edges, lambda run: run.edge)
    ]
    families += [
        (f"voxelize, {resolution}^3", TRIANGLES, some)
        for resolution, some in _grouped(chosen, lambda run: run.resolution)
    ]
    families += [
        (f"voxelize {mesh}", VOXELS, some)
        for mesh, some in _grouped([run for run in runs if run.resolution], lambda run: run.mesh)
    ]
    for what, unit, some in families:
        sizes = [run.triangles if unit == TRIANGLES else run.voxels for run in some]
        law = power_law(zip(sizes, (run.cpu_s for run in some), strict=True))
        if law is not None:
            net = power_law(zip(sizes, (_net(run, starts) for run in some), strict=True))
            yield Slope(what, unit, len(some), min(sizes), max(sizes), law, net)


def _net(run: Run, starts: Mapping[str, float]) -> float:
    """CPU seconds less the start's; a tiny ingest is one unit, so its workers are not known."""
    return run.cpu_s - starts.get(run.start, starts.get(f"{run.command} {ALONE}", 0.0))


def _grouped(runs: Sequence[Run], key: Callable[[Run], Any]) -> list[tuple[Any, list[Run]]]:
    """Runs of equal keys, in order of the runs."""
    keys = dict.fromkeys(map(key, runs))
    return [(wanted, [run for run in runs if key(run) == wanted]) for wanted in keys]
