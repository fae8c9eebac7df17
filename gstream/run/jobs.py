"""What a job's folder says of its job while nobody runs it here, and the folder's removal."""

import json
import os
import re
import shutil
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gstream.errors import UsageError
from gstream.job import Job, Unit
from gstream.run.journal import PLAN_FILE, Record, remove
from gstream.run.local import LOCK_FILE, locked_folder
from gstream.run.publish import MARKER, UNITS_FILE, Scratch

JOB_NAME = re.compile(r"gstream-[0-9a-f]{16}")
REMOVED = re.compile(rf"{JOB_NAME.pattern}\.removed")  # what a killed `remove` leaves
UNBORN = {LOCK_FILE, f"{PLAN_FILE}.wip"}  # what a run leaves that was killed before `job.json`


@dataclass(frozen=True, slots=True)
class StageStatus:
    """How far one stage is."""

    stage: str
    done: int  # units
    units: int | None  # of all; None before the stage was planned
    counts: Mapping[str, int | float]  # sums over the units that are done


@dataclass(frozen=True, slots=True)
class JobStatus:
    """How far a job is."""

    folder: str
    job: Mapping[str, Any]  # stages, settings, inputs, output, version
    options: Mapping[str, Any]  # of the last run
    running: bool  # some process holds it
    stages: tuple[StageStatus, ...]  # those that have begun
    scratch_bytes: int
    last_unit_seconds: float | None  # since the last unit was finished

    def as_dict(self) -> dict[str, Any]:
        """The status as JSON values."""
        return asdict(self)


def read_record(folder: Path) -> Record:
    """errors : UsageError for a folder that is no job's, or cannot be read"""
    try:
        record = Record.read(folder)
    except OSError as error:
        said = f"{error.filename}: cannot be read: {os.strerror(error.errno or 0)}"
        raise UsageError(said, "check its permissions") from error
    if record is None:
        if not folder.exists():
            said = f"{folder}: is not there"
            raise UsageError(said, "a finished job leaves no folder; check the name")
        said = f"{folder}: is not the folder of a job"
        raise UsageError(said, "name the folder gstream-… that a stopped run has named")
    return record


def status(folder: Path) -> JobStatus:
    """How far the job of that folder is; changes nothing.

    errors : UsageError for a folder that is no job's
    """
    folder = folder.resolve()
    record = read_record(folder)
    markers = [path.stat().st_mtime for path in folder.glob(f"*/*{MARKER}")]
    with Scratch(Job(str(folder), record.identity.output, record.identity.output)) as scratch:
        begun = sorted(path.parent.name for path in folder.glob(f"*/{UNITS_FILE}"))
        stages = tuple(_stage_status(scratch, stage) for stage in begun)
    return JobStatus(
        folder=str(folder),
        job=record.identity.as_dict(),
        options=record.options,
        running=_is_running(folder),
        stages=stages,
        scratch_bytes=size_of(folder),
        last_unit_seconds=max(0.0, time.time() - max(markers)) if markers else None,
    )


def _stage_status(scratch: Scratch, stage: str) -> StageStatus:
    units = json.loads(scratch.read(f"{stage}/{UNITS_FILE}"))["units"]
    done, counts = 0, Counter[str]()
    for marker in scratch.path(stage).glob(f"*{MARKER}"):
        counted = scratch.done(Unit(stage, marker.name.removesuffix(MARKER)))
        if counted is not None:
            done += 1
            counts.update({k: v for k, v in counted.items() if isinstance(v, int | float)})
    return StageStatus(stage, done, units, dict(sorted(counts.items())))


def _is_running(folder: Path) -> bool:
    if not (folder / LOCK_FILE).exists():
        return False
    try:
        with locked_folder(str(folder), patience=0.0):
            return False
    except UsageError:
        return True


def clean(folder: Path) -> int:
    """Remove the folder of a job that nobody runs, and its half-written outputs; bytes freed.

    errors : UsageError for a folder that is no job's, or whose job is running
    """
    folder = folder.resolve()
    if REMOVED.fullmatch(folder.name) and folder.is_dir():
        freed = size_of(folder)
        shutil.rmtree(folder)
        return freed
    half = None if _is_unborn(folder) else Path(f"{read_record(folder).identity.output}.wip")
    with locked_folder(str(folder)):
        freed = size_of(folder)
        if half is not None and half.is_file():
            freed += half.stat().st_size
            half.unlink()
        remove(folder)
    return freed


def _is_unborn(folder: Path) -> bool:
    return (
        JOB_NAME.fullmatch(folder.name) is not None
        and folder.is_dir()
        and (folder / LOCK_FILE).is_file()
        and {entry.name for entry in folder.iterdir()} <= UNBORN
    )


def size_of(folder: Path) -> int:
    """Bytes of all files below; those that vanish meanwhile are not among them."""
    total = 0
    for at, _, names in os.walk(folder):
        for name in names:
            try:
                total += os.lstat(os.path.join(at, name)).st_size
            except FileNotFoundError:
                continue
    return total
