"""What a job may take: the memory plan and the disk estimate. Arithmetic only.

The memory promise is for the whole process tree: base cost of the parent and of each worker
(interpreter, numpy, numba and compiled kernels, measured), and the rest shared by the workers.
"""

from dataclasses import dataclass

from gstream.errors import RefusedError

MIB = 1 << 20
PARENT_BYTES = 288 * MIB  # measured: 260 MiB having compiled all kernels, 71 with a cache
WORKER_BYTES = 96 * MIB  # measured 71 MiB: the parent has compiled before
LEAST_UNIT_BYTES = 256 * MIB  # a unit of presort: half a million triangles and their records


@dataclass(frozen=True, slots=True)
class MemoryPlan:
    """How many workers fit, and how much one unit may take."""

    workers: int  # 0 = this process
    worker_memory: int  # bytes


def plan_memory(memory: int, workers: int, unit_bytes: int = LEAST_UNIT_BYTES) -> MemoryPlan:
    """As many of `workers` as fit into `memory` bytes, with `unit_bytes` or more for each unit.

    errors : RefusedError when not even the parent alone fits
    """
    for count in range(workers, 0, -1):
        share = (memory - PARENT_BYTES) // count - WORKER_BYTES
        if share >= unit_bytes:
            return MemoryPlan(count, share)
    if memory - PARENT_BYTES >= unit_bytes:
        return MemoryPlan(0, memory - PARENT_BYTES)
    least = -(-(PARENT_BYTES + unit_bytes) // MIB)
    raise RefusedError(
        f"--memory {memory // MIB}MiB is too little: this job needs {least} MiB in one process",
        f"give --memory {least}MiB or more",
    )


@dataclass(frozen=True, slots=True)
class DiskNeed:
    """Bytes that a job is expected to write, at least; known before it starts only as estimates."""

    scratch: int
    output: int


SPILL_FACTOR = {True: 6, False: 1}  # gzipped meshes unpack to 3-6 times their size
CELL_BYTES_PER_STREAM_BYTE = 2  # uncompressed, and repeated along cell borders
SURFACE_VOXELS = 1.0  # level-0 voxels per resolution^2, for a plane; most scans have more
PILE_BYTES_PER_VOXEL = 24  # measured 4 to 7, of the 2 to 6 resolution^2 that closed surfaces have
FILE_BYTES_PER_VOXEL = 6


def disk_of_ingest(sizes: tuple[tuple[int, bool], ...]) -> DiskNeed:
    """sizes: (bytes, needs spilling: text or gzip) of each input."""
    spill = sum(size * SPILL_FACTOR[True] for size, spills in sizes if spills)
    stream = sum(size * (SPILL_FACTOR[spills] if spills else 1) for size, spills in sizes)
    return DiskNeed(scratch=spill, output=stream // 2)


def disk_of_voxelize(stream_bytes: int, resolution: int) -> DiskNeed:
    """stream_bytes: size of the geometry stream; resolution: voxels per axis."""
    voxels = int(SURFACE_VOXELS * resolution * resolution)
    scratch = stream_bytes * CELL_BYTES_PER_STREAM_BYTE + voxels * PILE_BYTES_PER_VOXEL
    return DiskNeed(scratch=scratch, output=voxels * FILE_BYTES_PER_VOXEL)


def check_disk(what: str, folder: str, need: int, free: int) -> None:
    """errors : RefusedError when `free` bytes at `folder` are fewer than `need`."""
    if need > free:
        raise RefusedError(
            f"{folder}: {what} needs about {-(-need // MIB)} MiB, and {free // MIB} MiB are free",
            "free some space, or give another folder (--tmp for scratch, -o for the output)",
        )
