"""One command of gstream on one mesh, measured: its own report, and CPU and memory from outside."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gstream.job import VoxelizeSettings
from gstream.run.estimate import disk_of_stream
from tests.bench.figures import per
from tests.bench.process import Cost, expect

ALONE, WORKERS = "in one process", "with workers"
STAGE_FIGURES = (
    "stage",
    "units",
    "seconds",
    "warm_seconds",
    "unit_seconds",
    "cpu_seconds",
    "read_bytes",
    "written_bytes",
    "disk_read_bytes",
    "disk_written_bytes",
    "peak_memory",
)


@dataclass(frozen=True, slots=True)
class Place:
    """Where the runs are made, and with what."""

    folder: Path
    sep: str
    workers: int
    memory: str

    @property
    def options(self) -> tuple[str | Path, ...]:
        limits = ("--workers", str(self.workers), "--memory", self.memory, "--tmp", self.folder)
        return (*limits, "--force", "--restart", "--quiet")  # an earlier run may have failed


@dataclass(frozen=True, slots=True)
class Run:
    """What one command took; bytes and seconds."""

    mesh: str
    command: str  # ingest | voxelize
    resolution: int | None  # voxels per axis
    edge: float | None  # mean edge in voxels, where the resolution was chosen for one
    triangles: int
    voxels: int  # of level 0
    workers: int
    cpu_s: float  # user and system, all processes, from start to end
    wall_s: float
    peak_bytes: int  # largest sum of Pss_Anon + Pss_Shmem over the tree
    input_bytes: int
    scratch_bytes: int  # written, of all stages
    output_bytes: int
    estimated_bytes: int | None  # of scratch and output together, told before the start
    read_bytes: int  # by calls, from disk or cache, programs and kernels included
    written_bytes: int
    disk_read_bytes: int
    disk_written_bytes: int
    stages: tuple[dict[str, Any], ...]  # STAGE_FIGURES of the run's report

    @property
    def start(self) -> str:
        """What had to be started: worker processes are spared where each stage has one unit."""
        spread = self.workers and any(stage["units"] > 1 for stage in self.stages)
        return f"{self.command} {WORKERS if spread else ALONE}"

    @property
    def estimate(self) -> float | None:
        """What was estimated over what was used."""
        if self.estimated_bytes is None:
            return None
        return per(self.estimated_bytes, self.scratch_bytes + self.output_bytes)

    @property
    def shares(self) -> dict[str, float]:
        """Of all CPU time: each stage's, and of starting processes and loading kernels."""
        found = {stage["stage"]: stage["cpu_seconds"] / self.cpu_s for stage in self.stages}
        return {"start": max(0.0, 1 - sum(found.values())), **found}


def ingest(place: Place, name: str, mesh: Path, stream: Path) -> Run:
    report = place.folder / "report.json"
    cost = expect("ingest", mesh, "-o", stream, *place.options, "--report", report)
    return _run(name, "ingest", mesh, report, cost)


def voxelize(
    place: Place,
    name: str,
    stream: Path,
    resolution: int,
    edge: float | None = None,
    cell: int = 256,
) -> Run:
    """Voxelize a stream; the block file is removed."""
    report, output = place.folder / "report.json", place.folder / "scene.gsb"
    settings = VoxelizeSettings(resolution=resolution, sep=place.sep, cell=cell)
    need = disk_of_stream(str(stream), settings)
    asked = ("--resolution", str(resolution), "--sep", place.sep, "--cell", str(cell))
    cost = expect("voxelize", stream, "-o", output, *asked, "--report", report, *place.options)
    output.unlink()
    estimated = need.scratch + need.output
    return _run(name, "voxelize", stream, report, cost, resolution, edge, estimated)


def _run(
    name: str,
    command: str,
    source: Path,
    report: Path,
    cost: Cost,
    resolution: int | None = None,
    edge: float | None = None,
    estimated: int | None = None,
) -> Run:
    found = json.loads(report.read_text())
    held, output = found["file"], found["output_bytes"]
    return Run(
        mesh=name,
        command=command,
        resolution=resolution,
        edge=edge,
        triangles=held["ledger"]["triangles"] if resolution else held["triangles"],
        voxels=held["ledger"]["voxels"][0] if resolution else 0,
        workers=found["workers"],
        cpu_s=cost.cpu_s,
        wall_s=cost.wall_s,
        peak_bytes=cost.peak_bytes,
        input_bytes=source.stat().st_size,
        scratch_bytes=sum(stage["written_bytes"] for stage in found["stages"]) - output,
        output_bytes=output,
        estimated_bytes=estimated,
        read_bytes=found["read_bytes"],
        written_bytes=found["written_bytes"],
        disk_read_bytes=found["disk_read_bytes"],
        disk_written_bytes=found["disk_written_bytes"],
        stages=tuple({key: stage[key] for key in STAGE_FIGURES} for stage in found["stages"]),
    )
