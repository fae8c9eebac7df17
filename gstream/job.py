"""What one job is: frozen settings, units of work, and the folder that holds its state.

A job never knows how it is run. Everything here pickles, so that a worker process gets it whole.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class IngestSettings:
    """`gstream ingest`: how other people's meshes become chunks."""

    inputs: tuple[str, ...]
    order: str = "file"  # file | spatial | smallest, the better of both
    lz4: str = "fast"  # fast | hc
    chunk_triangles: int = 65_536
    bounds: tuple[float, float, float, float, float, float] | None = (
        None  # declared box, world units
    )
    metadata: Mapping[str, str | None] = field(
        default_factory=dict
    )  # units, up, crs: only what was given


@dataclass(frozen=True, slots=True)
class VoxelizeSettings:
    """`gstream voxelize`: all that may change a byte of the file, and the cell, which may not."""

    sep: str = "6"  # 6 | 26 | conservative
    ties: str = "one-sided"  # one-sided | closed
    resolution: int | None = (
        None  # voxels per axis; exactly one of resolution and voxel_size is given
    )
    voxel_size: float | None = None  # world units
    snap_bits: int | None = None  # vertices snap to voxel / 2^k; None = as many as the grid allows
    block: int = 64  # voxels per block edge: a power of two, 8 to 256
    lod: bool = True
    keep_weights: bool = False
    keep_geometry: bool = False  # the source triangles, with the finest blocks
    columns: tuple[str, ...] | None = None  # of normal and colour; None = all that the source has
    required: tuple[str, ...] = ()  # of `columns`: what the source must have
    faces: str = "front"  # front | both
    normals: str = "geometric"  # geometric | input
    normal_bits: int = 11
    lz4: str = "fast"  # fast | hc
    cell: int = 256  # voxels per cell edge; no influence on the bytes

    def stores(self, column: str) -> bool:
        """Whether the column is wanted, if the source has it."""
        return self.columns is None or column in self.columns


@dataclass(frozen=True, slots=True)
class Job:
    """One run from inputs to one output file."""

    folder: str  # scratch of this job: stages' files and done markers
    output: str
    stream: str  # path of the geometry stream that voxelize reads; may lie in `folder`
    ingest: IngestSettings | None = None
    voxelize: VoxelizeSettings | None = None
    workers: int = 0  # 0 = this process
    memory: int = 2 << 30  # bytes for the whole process tree
    worker_memory: int = 1 << 30  # bytes one unit may take, set by the plan

    @property
    def voxelizing(self) -> VoxelizeSettings:
        """The voxelize settings of a job that has them; ValueError for one that only ingests."""
        if self.voxelize is None:
            raise ValueError("the job has no voxelize settings")
        return self.voxelize


@dataclass(frozen=True, slots=True)
class Unit:
    """One idempotent piece of a stage's work: the thing a worker steals."""

    stage: str  # the stage's NAME
    name: str  # unique within the stage, safe in a file name
    cost: float = 1.0  # estimated work, comparable within the stage
    memory: int = 0  # estimated peak bytes
    place: int = 0  # spatial neighbourhood: close numbers are close in space
    data: tuple[Any, ...] = ()  # integers and strings that `work` needs


@dataclass(frozen=True, slots=True)
class Summary:
    """What a finished stage counted: sums over its units, and anything `finish` adds."""

    stage: str
    counts: Mapping[str, int | float | str]


def scratch_name(stage: str, file: str) -> str:
    """The name of a stage's scratch file inside the job's folder."""
    return str(Path(stage) / file)
