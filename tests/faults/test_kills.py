"""A job with two workers is killed at random moments: all of it, or one worker, again and again."""

import contextlib
import importlib
import json
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random

import pytest
from e2e.meshes import sphere, write_ply

from gstream.run import worker
from gstream.run.commands import INGEST, VOXELIZE
from gstream_cli.main import status

WORKERS = 2
SETTINGS = ("--resolution", 160, "--block", 16, "--cell", 16, "--chunk", 200, "--quiet")
MOST_KILLS = 3  # of one run: a unit that is hit by three is left out
STUCK_SECONDS = 120


def copy(pipe: int) -> worker.Process:
    return worker.Fork(worker.serve, pipe)


@dataclass(frozen=True, slots=True)
class Target:
    """A job to kill, and what it makes when nobody does."""

    folder: Path
    start_worker: Callable[[int], worker.Process]
    options: tuple[str, ...]
    whole: bytes = b""
    units: int = 0
    seconds: float = 0.0  # that it takes

    @property
    def output(self) -> Path:
        return self.folder / "out.gsb"

    def start(self) -> int:
        """A run in a process group of its own; forked, as importing everything takes longer."""
        child = os.fork()
        if child:
            return child
        code = 1
        try:
            os.setsid()
            worker.start = self.start_worker
            os.dup2(os.open(self.folder / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
            arguments = (
                "build",
                self.folder / "s.ply",
                "-o",
                self.output,
                *SETTINGS,
                *self.options,
            )
            more = ("--tmp", self.folder, "--workers", WORKERS, "--report", self.folder / "report")
            code = status([str(argument) for argument in (*arguments, *more)])
        finally:
            os._exit(code)

    def wait(self, child: int, seconds: float) -> int | None:
        """Its status when it ends within that time; whoever looks at the output sees it whole."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            ended, how = os.waitpid(child, os.WNOHANG)
            if self.output.exists():
                assert self.output.read_bytes() == self.whole
            if ended:
                return os.waitstatus_to_exitcode(how)
            time.sleep(0.002)
        return None

    @property
    def job(self) -> list[Path]:
        """The job's folder, if there is one."""
        return list(self.folder.glob(f"gstream-{'?' * 16}"))

    def done(self) -> int:
        return sum(len(list(folder.glob("*/*.done"))) for folder in self.job)

    def executed(self) -> int:
        stages = json.loads((self.folder / "report").read_text())["stages"]
        return sum(stage["units"] - stage["resumed"] for stage in stages)


@pytest.fixture
def target(tmp_path, request) -> Target:
    write_ply(tmp_path / "s.ply", *sphere(80))
    target = Target(tmp_path, *request.param)
    for name in (*INGEST, *VOXELIZE):  # what this process has loaded, runs and their copies have
        getattr(importlib.import_module(f"gstream.stages.{name}"), "warm", lambda: None)()
    for _ in range(2):  # the second does not compile
        target.output.unlink(missing_ok=True)
        began = time.monotonic()
        assert os.waitpid(target.start(), 0)[1] == 0, (tmp_path / "said").read_text()
        seconds = time.monotonic() - began
    whole = target.output.read_bytes()
    target.output.unlink()
    return replace(target, whole=whole, units=target.executed(), seconds=seconds)


def workers_of(pid: int) -> list[int]:
    tasks = Path(f"/proc/{pid}/task")
    try:
        return [int(c) for task in tasks.iterdir() for c in (task / "children").read_text().split()]
    except FileNotFoundError:
        return []


def disturb(target: Target, child: int, random: Random) -> tuple[int, int | None]:
    """Kill at random moments until the run is over; how often, and its status."""
    kills = 0
    while kills < MOST_KILLS:
        ended = target.wait(child, random.uniform(0, target.seconds))
        if ended is not None:
            return kills, ended
        workers = workers_of(child)
        if not workers or random.random() < 0.6:
            os.killpg(child, signal.SIGKILL)
            kills += 1
            break
        with contextlib.suppress(ProcessLookupError):  # its stage was over by now
            os.kill(random.choice(workers), signal.SIGKILL)
            kills += 1
    ended = target.wait(child, STUCK_SECONDS)
    assert ended is not None, "the run is stuck"
    return kills, ended


@pytest.mark.parametrize(
    ("target", "wanted"),
    [
        pytest.param((worker.fresh, ()), 40, id="40"),
        pytest.param((copy, ("--keep-geometry",)), 20, id="20, source triangles"),
        pytest.param((copy, ()), 1000, id="1000", marks=pytest.mark.long),
    ],
    indirect=["target"],
)
def test_random_kills_change_no_byte_and_what_was_done_is_not_done_again(target, wanted):
    random, kills, jobs = Random(wanted), 0, 0
    while kills < wanted or jobs == 0:
        done = target.done()
        more, ended = disturb(target, target.start(), random)
        kills += more
        assert ended in (0, -signal.SIGKILL), (target.folder / "said").read_text()
        if target.output.exists():  # after a kill too: the rerun then knows it as its own
            assert target.output.read_bytes() == target.whole
        if ended == 0:
            assert target.executed() <= target.units - done + 2 * WORKERS
            assert not list(target.folder.glob("gstream-*"))
        if target.output.exists() and not target.job:  # killed when all was done, or not at all
            target.output.unlink()
            jobs += 1
    print(f"{kills} kills, {jobs} jobs finished")
