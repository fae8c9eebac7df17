"""A job's folder: named by its output, locked, removed on success, kept for resuming.

State is only files that appeared through `publish`: `job.json` here, done markers in the stages.
"""

import json
import os
import shutil
from collections.abc import Iterator, Mapping, Set
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any, Self

from gstream.errors import GstreamError, RefusedError, StoppedError, UsageError
from gstream.run.budget import MemoryPlan, plan_memory
from gstream.run.fingerprint import agree, fingerprint_if_any
from gstream.run.local import LOCK_FILE, locked_folder
from gstream.run.publish import BESIDE, OUTPUT_FILE, publish

PLAN_FILE = "job.json"


@dataclass(frozen=True, slots=True)
class Identity:
    """Everything that decides what a job's scratch files hold."""

    stages: tuple[str, ...]
    settings: Mapping[str, Any]  # of ingest and voxelize, as JSON values, without the inputs
    inputs: tuple[tuple[str, str], ...]  # absolute path and fingerprint, in order
    output: str  # absolute path
    version: str  # of gstream

    def as_dict(self) -> dict[str, Any]:
        return {
            "stages": list(self.stages),
            "settings": dict(self.settings),
            "inputs": [list(pair) for pair in self.inputs],
            "output": self.output,
            "version": self.version,
        }

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Self:
        """errors : KeyError, TypeError, ValueError for anything that `as_dict` did not make"""
        return cls(
            stages=tuple(fields["stages"]),
            settings=dict(fields["settings"]),
            inputs=tuple((str(path), str(print_)) for path, print_ in fields["inputs"]),
            output=str(fields["output"]),
            version=str(fields["version"]),
        )

    def settings_fingerprint(self) -> str:
        """16 hex digits: equal exactly when stages and settings are."""
        text = json.dumps([self.stages, self.settings], sort_keys=True)
        return blake2b(text.encode(), digest_size=8).hexdigest()

    def changes(self, now: "Identity") -> list[str]:
        """What is different `now`, each with both fingerprints; of different order, the inputs."""
        changes = []
        if self.version != now.version:
            changes.append(f"gstream was {self.version}, is {now.version}")
        before, after = self.settings_fingerprint(), now.settings_fingerprint()
        if before != after:
            changes.append(f"settings were {before}, are {after}{_differing(self, now)}")
        earlier, later = dict(self.inputs), dict(now.inputs)
        for path in dict.fromkeys((*earlier, *later)):
            was, is_ = earlier.get(path, "no input"), later.get(path, "no input")
            if not agree(was, is_):
                changes.append(f"{path} was {was}, is {is_}")
        if not changes and [path for path, _ in self.inputs] != [path for path, _ in now.inputs]:
            changes.append("the inputs are in another order")
        return changes


def folder_name(output: str) -> str:
    """`gstream-<16 hex digits>` of the output's path: two jobs for one output would be in conflict.

    So a job whose inputs or settings were changed meets its earlier folder, and is refused.
    """
    return f"gstream-{blake2b(os.path.abspath(output).encode(), digest_size=8).hexdigest()}"


def _differing(earlier: Identity, now: Identity) -> str:
    """The settings that differ, such as ` (resolution 256, now 512)`."""
    found = []
    for group, held in now.settings.items():
        before = earlier.settings.get(group) or {}
        found += [
            f"{name} {before[name]}, now {value}"
            for name, value in (held or {}).items()
            if name in before and before[name] != value
        ]
    return f" ({'; '.join(found)})" if found else ""


@dataclass(frozen=True, slots=True)
class Record:
    """What a job's folder says of its job: all that is needed to run it again."""

    identity: Identity
    folder: str  # where it was made: scratch files name each other by absolute paths
    plan: MemoryPlan  # of the first run: units keep their extents
    options: Mapping[str, Any]  # of the last run: workers, memory, force, paranoid

    @classmethod
    def read(cls, folder: Path) -> Self | None:
        """The record in `folder`; None when it holds none.

        errors : OSError for one that cannot be read, lest its job be started over
        """
        try:
            record = json.loads((folder / PLAN_FILE).read_bytes())
            plan = MemoryPlan(int(record["plan"]["workers"]), int(record["plan"]["worker_memory"]))
            identity = Identity.from_dict(record["job"])
            return cls(identity, str(record["folder"]), plan, dict(record["options"]))
        except (FileNotFoundError, NotADirectoryError, ValueError, KeyError, TypeError):
            return None

    def publish(self) -> None:
        record = {
            "job": self.identity.as_dict(),
            "folder": self.folder,
            "plan": {"workers": self.plan.workers, "worker_memory": self.plan.worker_memory},
            "options": dict(self.options),
        }
        with publish(Path(self.folder) / PLAN_FILE) as file:
            file.write(json.dumps(record, sort_keys=True, indent=1).encode())


@dataclass(frozen=True, slots=True)
class JobFolder:
    """The locked folder of a running job."""

    path: Path
    plan: MemoryPlan
    workers: int  # of this run
    resumed: bool


@contextmanager
def job_folder(
    path: Path, identity: Identity, memory: int, options: Mapping[str, Any], restart: bool = False
) -> Iterator[JobFolder]:
    """Make the job's folder, or find it, and hold it while the job runs.

    Removed when the job ends, and when it fails for a reason that another run would meet again;
    kept when it was stopped or met an error of ours.

    memory : bytes for this run; options : what `Record` keeps, `workers` among them. A resumed job
        keeps its first plan, with fewer workers if need be
    restart : drop what an earlier run left
    errors : RefusedError of `plan_memory`; UsageError when another process runs the job, or inputs
        or settings are not those of the earlier run
    """
    wanted = plan_memory(memory, options["workers"])
    with locked_folder(str(path)):
        earlier = None if restart else Record.read(path)
        if earlier is None:
            _empty(path, {LOCK_FILE})
            plan, workers = wanted, wanted.workers
        else:
            _refuse_changes(path, earlier.identity, identity)
            plan, workers = earlier.plan, _fitting(earlier.plan, memory, options["workers"])
            identity = earlier.identity  # it may know all of an input, and this run samples
        Record(identity, str(path), plan, options).publish()
        try:
            yield JobFolder(path, plan, workers, resumed=earlier is not None)
        except StoppedError as error:
            raise StoppedError(error.said, f"{error.remedy} {_ways_on(path)}") from error
        except GstreamError:
            remove(path)
            raise
        except Exception as error:
            error.add_note(_ways_on(path))
            raise
        with suppress(OSError):  # the output is there: scratch that cannot be removed is no failure
            # What is large goes first: a run that is killed meanwhile has left a finished job.
            _empty(path, {LOCK_FILE, PLAN_FILE, OUTPUT_FILE})
            remove(path)


def _ways_on(path: Path) -> str:
    return f"(or: gstream resume {path}; to drop it: gstream clean {path})"


def _refuse_changes(path: Path, earlier: Identity, now: Identity) -> None:
    changes = [*earlier.changes(now), *_changes_beside(path)]
    if changes:
        said = (
            f"{path}: an earlier run of this job was stopped, and since then {'; '.join(changes)}"
        )
        raise UsageError(said, "put that back to resume, or add --restart to start over")


def _changes_beside(path: Path) -> Iterator[str]:
    """What is different now in files that the inputs name, and that were read with them."""
    for note in sorted(path.glob(f"*/*{BESIDE}")):
        for name, was in json.loads(note.read_bytes()).items():
            is_ = fingerprint_if_any(name)
            if was != is_:
                yield f"{name} was {was}, is {is_}"


def _fitting(earlier: MemoryPlan, memory: int, workers: int) -> int:
    """How many workers fit whose units are those of the earlier plan."""
    try:
        return plan_memory(memory, workers, earlier.worker_memory).workers
    except RefusedError as error:
        raise RefusedError(error.said, f"{error.remedy}, or --restart to start over") from error


def _empty(path: Path, kept: Set[str]) -> None:
    for entry in path.iterdir():
        if entry.is_dir():
            shutil.rmtree(entry)
        elif entry.name not in kept:
            entry.unlink()


def remove(path: Path) -> None:
    """First out of the way, then away: a half-removed folder must never look like a job's."""
    gone = path.with_name(f"{path.name}.removed")
    shutil.rmtree(gone, ignore_errors=True)
    os.replace(path, gone)
    shutil.rmtree(gone, ignore_errors=True)
