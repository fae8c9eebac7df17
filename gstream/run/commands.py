"""What each command is: its stages, what is checked before it starts, and the job it becomes.

The Python API and the command line meet here; neither knows a stage by name.
"""

import importlib
import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, cast

from gstream import __version__
from gstream.errors import RefusedError, StoppedError, UsageError
from gstream.formats.pieces import TRIANGLE, VERTEX
from gstream.grid import MAX_RESOLUTION, check_snap_bits
from gstream.job import IngestSettings, Job, VoxelizeSettings
from gstream.read import open_block_file
from gstream.run.budget import DiskNeed, check_disk, disk_of_ingest, disk_of_voxelize, plan_memory
from gstream.run.fingerprint import fingerprint
from gstream.run.jobs import read_record, size_of
from gstream.run.journal import Identity, folder_name, job_folder
from gstream.run.paths import check_paths, scratch_place
from gstream.run.pipeline import RunReport, Stage, run_job
from gstream.run.progress import (
    End,
    Failed,
    Note,
    Progress,
    Start,
    Stopped,
    silent,
)
from gstream.run.publish import is_finished, sync_folder
from gstream.run.wanted import wanted_of_meshes, wanted_of_stream
from gstream.run.worker import RESUME, disk_errors
from gstream.scene import Resolution, read_scene

INGEST = ("spill", "ingest")
VOXELIZE = ("presort", "voxelize", "merge", "simplify", "pack")
RELEVEL = ("unpack", "simplify", "pack")
BLOCK_EDGES = (8, 16, 32, 64, 128, 256)


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How to run a job: nothing here changes a byte of its output."""

    workers: int | None = None  # None = one per processor, 0 = this process
    memory: int = 2 << 30  # bytes for the whole process tree
    tmp: str | None = None  # folder for scratch; None = $TMPDIR, else the output's folder
    force: bool = False  # replace an existing output
    paranoid: bool = False  # fingerprint all of every input; read what an earlier run has done
    restart: bool = False  # drop what an earlier run has done


@dataclass(frozen=True, slots=True)
class Request:
    """One command, checked: its inputs can be read and its output can be written."""

    stages: tuple[str, ...]
    inputs: tuple[str, ...]
    output: str
    options: RunOptions
    ingest: IngestSettings | None = None
    voxelize: VoxelizeSettings | None = None
    called: Resolution | None = None  # what the scene calls for, where there is one

    @property
    def tmp(self) -> str:
        return scratch_place(self.output, self.options.tmp)

    @property
    def folder(self) -> Path:
        """Of the job: named by its output."""
        return Path(self.tmp).absolute() / folder_name(self.output)

    @property
    def workers(self) -> int:
        wanted = self.options.workers
        return (os.cpu_count() or 1) if wanted is None else wanted

    def identity(self) -> Identity:
        """What a job that is resumed must agree with; reads samples of all inputs."""
        whole = self.options.paranoid
        ingest = asdict(self.ingest) if self.ingest else {}
        ingest.pop("inputs", None)
        voxelize = asdict(self.voxelize) if self.voxelize else {}
        settings = json.dumps({"ingest": ingest, "voxelize": voxelize})
        return Identity(
            stages=self.stages,
            settings=json.loads(settings),
            inputs=tuple((os.path.abspath(path), fingerprint(path, whole)) for path in self.inputs),
            output=os.path.abspath(self.output),
            version=__version__,
        )

    def disk(self) -> tuple[DiskNeed, ...]:
        """What ingest and what voxelize will write, as far as can be told before the start."""
        stream = sum(os.path.getsize(path) for path in self.inputs)
        needs = []
        if self.ingest is not None:
            needs.append(disk_of_ingest(tuple(map(_size_and_spill, self.inputs))))
            stream = needs[0].output
        if self.voxelize is not None and self.stages == VOXELIZE:
            from gstream.run.estimate import disk_of_stream  # numba with it: not for --help

            needs.append(disk_of_stream(self.inputs[0], self.voxelize))
        elif self.voxelize is not None:
            needs.append(disk_of_voxelize(stream, self.voxelize.resolution or 0))
        return tuple(needs)

    def run(self, progress: Progress | None = None) -> RunReport:
        """Run the job from where it is.

        errors : RefusedError when it does not fit; StoppedError when it can be resumed; InputError
            and CorruptFileError for its inputs
        """
        tell = progress or silent
        try:
            report = self._run(tell)
        except StoppedError as error:
            tell(Stopped(str(error)))
            raise
        except BaseException as error:
            tell(Failed(type(error).__name__, str(error)))
            raise
        cpu = report.usage.cpu_seconds
        tell(End(report.output, report.output_bytes, report.seconds, cpu, report.peak_memory))
        return report

    def _run(self, tell: Progress) -> RunReport:
        output = os.path.abspath(self.output)
        if not self._finished():
            needs = self.disk()
            tell(Note(f"disk: {_expected(needs)}"))
            self._check_disk(needs, size_of(self.folder))
        place = Job(str(self.folder), output, self._stream())
        options = {
            "workers": self.workers,
            "memory": self.options.memory,
            "force": self.options.force,
            "paranoid": self.options.paranoid,
        }
        identity, restart = self.identity(), self.options.restart
        with (
            disk_errors(place, "the job's folder"),
            job_folder(self.folder, identity, self.options.memory, options, restart) as held,
            disk_errors(place, "the pipeline"),
        ):
            verb = "resuming" if held.resumed else "working"
            tell(Note(f"{verb} in {held.path} with {_count(held.workers)}"))
            workers, memory = held.workers, self.options.memory
            tell(Start(identity.as_dict(), str(held.path), workers, memory, held.resumed))
            job = replace(
                place,
                ingest=self.ingest,
                voxelize=self.voxelize,
                workers=held.plan.workers,
                memory=memory,
                worker_memory=held.plan.worker_memory,
            )
            modules = [importlib.import_module(f"gstream.stages.{name}") for name in self.stages]
            stages = cast(Sequence[Stage], modules)
            if self._finished():
                sync_folder(os.path.dirname(output))
                stages = ()
            ended = partial(self._look_again, stages, tell)
            return run_job(job, stages, tell, workers, self.options.paranoid, ended)

    def _finished(self) -> bool:
        """Whether the output is there, made by an earlier run of this job that was stopped then."""
        output = os.path.abspath(self.output)
        return not self.options.restart and is_finished(self.folder, output)

    def _look_again(self, stages: Sequence[Stage], tell: Progress, ended: Stage) -> None:
        """When ingest ends in a job that goes on: tell better what voxelizing its stream takes.

        errors : StoppedError when it does not fit
        """
        if self.ingest is None or self.voxelize is None or ended is not stages[len(INGEST) - 1]:
            return
        from gstream.run.estimate import disk_of_stream

        needs = [disk_of_stream(self._stream(), self.voxelize)]
        tell(Note(f"disk: {_expected(needs)}, beside the stream"))
        held = sum(size_of(self.folder / stage.NAME) for stage in stages[len(INGEST) :])
        try:
            self._check_disk(needs, held)
        except RefusedError as error:
            raise StoppedError(error.said, f"{error.remedy}, then {RESUME}") from error

    def describe(self) -> Iterable[str]:
        """The plan and its estimates, for --dry-run; nothing is written."""
        plan = plan_memory(self.options.memory, self.workers)
        for path in self.inputs:
            yield f"input    {path}  {_mib(os.path.getsize(path))}"
        yield f"output   {self.output}"
        yield f"stages   {' '.join(self.stages)}"
        yield f"memory   {_mib(self.options.memory)}: {_count(plan.workers)}, " + (
            f"{_mib(plan.worker_memory)} for each unit"
        )
        yield f"scratch  {self.folder}"
        needs = self.disk()
        yield f"disk     {_expected(needs)}"
        self._check_disk(needs, size_of(self.folder))

    def _check_disk(self, needs: Sequence[DiskNeed], held: int) -> None:
        """held : bytes of what an earlier run of the job has written.

        errors : RefusedError when there is less than needed
        """
        folder = os.path.dirname(os.path.abspath(self.output))
        scratch = sum(n.scratch for n in needs) + sum(n.output for n in needs[:-1])
        scratch -= held
        output = needs[-1].output if needs else 0
        free = shutil.disk_usage(self.tmp).free
        if os.stat(self.tmp).st_dev == os.stat(folder).st_dev:
            check_disk("scratch with the output", self.tmp, scratch + output, free)
        else:
            check_disk("scratch", self.tmp, scratch, free)
            check_disk("the output", folder, output, shutil.disk_usage(folder).free)

    def _stream(self) -> str:
        """The path of the geometry stream: an input, the output, or scratch."""
        if self.ingest is None:
            return os.path.abspath(self.inputs[0])
        if self.voxelize is None:
            return os.path.abspath(self.output)
        return str(self.folder / "scene.gst")


def ingest(settings: IngestSettings, output: str, options: RunOptions) -> Request:
    """`gstream ingest`: meshes to one geometry stream.

    errors : UsageError for any path or option that cannot work
    """
    check_paths(settings.inputs, output, options.tmp, options.force, options.restart)
    return Request(INGEST, settings.inputs, output, options, ingest=settings)


def voxelize(
    stream: str,
    settings: VoxelizeSettings,
    output: str,
    options: RunOptions,
    scene: str | None = None,
) -> Request:
    """`gstream voxelize`: a geometry stream to a block file, of what a scene file calls for.

    errors : UsageError for any path or option that cannot work; of a scene also InputError,
        UnsupportedError
    """
    check_voxelize(settings)
    read = (stream, scene) if scene else (stream,)
    check_paths(read, output, options.tmp, options.force, options.restart)
    called = None
    if scene:
        settings, called = wanted_of_stream(read_scene(scene), settings, stream)
    return Request(VOXELIZE, (stream,), output, options, voxelize=settings, called=called)


def build(
    settings: IngestSettings,
    voxels: VoxelizeSettings,
    output: str,
    options: RunOptions,
    scene: str | None = None,
) -> Request:
    """`gstream build`: meshes to a block file, of what a scene file calls for.

    errors : as of voxelize
    """
    check_voxelize(voxels)
    read = (*settings.inputs, scene) if scene else settings.inputs
    check_paths(read, output, options.tmp, options.force, options.restart)
    called = None
    if scene:
        voxels, called = wanted_of_meshes(read_scene(scene), voxels)
    return Request((*INGEST, *VOXELIZE), settings.inputs, output, options, settings, voxels, called)


def simplify(blockfile: str, output: str, options: RunOptions) -> Request:
    """`gstream simplify`: a block file with level 0 to one with all its levels.

    The stage `unpack` leaves level 0 where `merge` would have; the job's stream is the block file.

    errors : UsageError for any path or option that cannot work; CorruptFileError
    """
    check_paths((blockfile,), output, options.tmp, options.force, options.restart)
    with open_block_file(blockfile) as file:
        held, columns = file.header, file.columns
    settings = VoxelizeSettings(
        sep=held.sep,
        ties=held.ties,
        resolution=held.resolution,
        block=1 << held.block_log2,
        keep_weights="weight" in columns,
        keep_geometry={VERTEX, TRIANGLE} <= set(columns),
        faces=held.faces,
        normals=held.normals,
        normal_bits=held.normal_bits,
    )
    return Request(RELEVEL, (blockfile,), output, options, voxelize=settings)


def resume(folder: Path, changes: Mapping[str, Any]) -> Request:
    """`gstream resume`: the job of that folder, as it was asked for.

    changes : fields of RunOptions that are to be others
    errors : UsageError for a folder that is no job's, a job of another version or of another
        place, and any path that cannot work by now
    """
    folder = folder.resolve()
    record = read_record(folder)
    held = record.identity
    if held.version != __version__:
        said = f"{folder}: its job was begun by gstream {held.version}, and this is {__version__}"
        raise UsageError(said, f"resume it with that version, or drop it: gstream clean {folder}")
    if not (os.path.isdir(record.folder) and folder.samefile(record.folder)):
        said = f"{folder}: was moved, and files in it name each other by {record.folder}"
        raise UsageError(said, "move it back")
    options = RunOptions(**{**record.options, "tmp": os.path.dirname(record.folder), **changes})
    paths = tuple(path for path, _ in held.inputs)
    check_paths(paths, held.output, options.tmp, options.force, options.restart)
    ingest, voxels = held.settings["ingest"], held.settings["voxelize"]
    if ingest:
        bounds = ingest["bounds"] and tuple(ingest["bounds"])
        ingest = IngestSettings(**{**ingest, "inputs": paths, "bounds": bounds})
    if voxels:
        columns, required = voxels["columns"], tuple(voxels["required"])
        columns = None if columns is None else tuple(columns)
        voxels = VoxelizeSettings(**{**voxels, "columns": columns, "required": required})
    return Request(
        stages=held.stages,
        inputs=paths,
        output=held.output,
        options=options,
        ingest=ingest or None,
        voxelize=voxels or None,
    )


def check_voxelize(settings: VoxelizeSettings) -> None:
    """errors : UsageError for a number that no grid can have."""
    resolution, size = settings.resolution, settings.voxel_size
    if (resolution is None) == (size is None):
        count = "no size" if size is None else "two sizes"
        raise UsageError(f"the voxels have {count}", "give either --resolution or --voxel-size")
    if resolution is not None and not 1 <= resolution <= MAX_RESOLUTION:
        said = f"--resolution {resolution} is out of range"
        raise UsageError(said, f"give 1 to {MAX_RESOLUTION} voxels per axis")
    if size is not None and not (isfinite(size) and size > 0):
        raise UsageError(f"--voxel-size {size} is out of range", "give a positive length")
    if settings.snap_bits is not None:
        check_snap_bits(settings.snap_bits, resolution or 1)
    if settings.block not in BLOCK_EDGES:
        raise UsageError(
            f"--block {settings.block} is out of range", "give a power of two, 8 to 256"
        )
    if settings.cell not in BLOCK_EDGES or settings.cell < settings.block:
        said = f"--cell {settings.cell} is out of range"
        raise UsageError(said, f"give a power of two, {settings.block} (--block) to 256")


def _size_and_spill(path: str) -> tuple[int, bool]:
    """Gzip is told by content, text by name: good enough for an estimate."""
    with open(path, "rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    return os.path.getsize(path), packed or Path(path).suffix.lower() in (".obj", ".off")


def _expected(needs: Sequence[DiskNeed]) -> str:
    scratch, output = sum(n.scratch for n in needs), needs[-1].output if needs else 0
    return f"about {_mib(scratch)} of scratch, {_mib(output)} of output"


def _count(workers: int) -> str:
    if workers == 0:
        return "this process alone"
    return f"{workers} worker{'s' if workers > 1 else ''}"


def _mib(size: int) -> str:
    return f"{size / (1 << 20):.1f} MiB"
