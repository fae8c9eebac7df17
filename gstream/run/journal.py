"""A job's folder: named by what decides the bytes, locked, removed on success, kept for resuming.

State is only files that appeared through `publish`: `job.json` here, done markers in the stages.
"""

import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any

from gstream.errors import GstreamError, RefusedError, StoppedError
from gstream.run.budget import MemoryPlan, plan_memory
from gstream.run.local import LOCK_FILE, locked_folder
from gstream.run.publish import publish

SAMPLES = 64  # blocks hashed between head and tail
SAMPLE_BYTES = 65_536
PLAN_FILE = "job.json"


@dataclass(frozen=True, slots=True)
class Identity:
    """Everything that decides what a job's scratch files hold."""

    stages: tuple[str, ...]
    settings: Mapping[str, Any]  # of ingest and voxelize
    inputs: Mapping[str, str]  # absolute path -> fingerprint
    output: str  # absolute path
    version: str  # of gstream

    def as_dict(self) -> dict[str, Any]:
        return {
            "stages": list(self.stages),
            "settings": dict(self.settings),
            "inputs": dict(self.inputs),
            "output": self.output,
            "version": self.version,
        }

    def folder_name(self) -> str:
        """`gstream-<16 hex digits>`: equal exactly when everything above is."""
        text = json.dumps(self.as_dict(), sort_keys=True, allow_nan=True)
        return f"gstream-{blake2b(text.encode(), digest_size=8).hexdigest()}"


def fingerprint(path: str | Path, whole: bool = False) -> str:
    """Size and hash of a file's head, tail and 64 blocks between (`whole`: of all); no times."""
    size = os.path.getsize(path)
    digest = blake2b(digest_size=16)
    with open(path, "rb") as file:
        for at in _sample_offsets(size, whole):
            file.seek(at)
            digest.update(file.read(SAMPLE_BYTES))
    return f"{size}-{digest.hexdigest()}"


def _sample_offsets(size: int, whole: bool) -> Sequence[int]:
    if whole or size <= (SAMPLES + 2) * SAMPLE_BYTES:
        return range(0, size, SAMPLE_BYTES)
    last = size - SAMPLE_BYTES
    return [last * i // (SAMPLES + 1) for i in range(SAMPLES + 2)]


@dataclass(frozen=True, slots=True)
class JobFolder:
    """The locked folder of a running job."""

    path: Path
    plan: MemoryPlan  # of the job's first run: its units keep their extents when it is resumed
    workers: int  # of this run
    resumed: bool


@contextmanager
def job_folder(
    tmp: str | Path, identity: Identity, memory: int, workers: int
) -> Iterator[JobFolder]:
    """Make or find the job's folder under `tmp` and hold it while the job runs.

    Removed when the job ends, and when it fails for a reason that another run would meet again;
    kept when it was stopped or met an error of ours.

    memory, workers : bytes and processes for this run; a resumed job keeps its first plan, with
        fewer workers if need be, and starts over where even that does not fit
    errors : RefusedError of `plan_memory`; UsageError when another process runs the same job
    """
    wanted = plan_memory(memory, workers)
    path = Path(tmp) / identity.folder_name()
    with locked_folder(str(path)):
        earlier = _earlier_plan(path)
        found = None if earlier is None else _resume(path, earlier, memory, workers)
        if found is None:
            _begin(path, identity, wanted)
        try:
            yield found or JobFolder(path, wanted, wanted.workers, resumed=False)
        except StoppedError as error:
            raise StoppedError(error.said, f"{error.remedy} (scratch: {path})") from error
        except GstreamError:
            _remove(path)
            raise
        _remove(path)


def _resume(path: Path, earlier: MemoryPlan, memory: int, workers: int) -> JobFolder | None:
    try:
        now = plan_memory(memory, workers, earlier.worker_memory)
    except RefusedError:
        return None
    return JobFolder(path, earlier, now.workers, resumed=True)


def _earlier_plan(path: Path) -> MemoryPlan | None:
    try:
        record = json.loads((path / PLAN_FILE).read_bytes())["plan"]
        return MemoryPlan(int(record["workers"]), int(record["worker_memory"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _begin(path: Path, identity: Identity, plan: MemoryPlan) -> None:
    for entry in path.iterdir():
        if entry.is_dir():
            shutil.rmtree(entry)
        elif entry.name != LOCK_FILE:
            entry.unlink()
    record = {
        "job": identity.as_dict(),
        "plan": {"workers": plan.workers, "worker_memory": plan.worker_memory},
    }
    with publish(path / PLAN_FILE) as file:
        file.write(json.dumps(record, sort_keys=True, indent=1).encode())


def _remove(path: Path) -> None:
    """First out of the way, then away: a half-removed folder must never look like a job's."""
    gone = path.with_name(f"{path.name}.removed")
    shutil.rmtree(gone, ignore_errors=True)
    os.replace(path, gone)
    shutil.rmtree(gone, ignore_errors=True)
