"""A worker process dies before each of its operations on the disk, or the operation fails there."""

import errno
import os
import re
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from faults.disk import Disk, Told
from faults.test_disk_errors import ERRORS, WRITING, failing
from faults.tiny import TinyJob

from gstream.run import local


def forked(tiny: TinyJob, tolds: list[Told]) -> Callable[..., object]:
    """A Popen whose processes are forked, as starting Python takes two seconds.

    tolds : what each worker's disk tells, in the order in which workers are started; then nothing
    """

    class Forked:
        def __init__(self, command: object, *, pass_fds: list[int], stdin: int) -> None:
            told = tolds.pop(0) if tolds else lambda *_: None
            self.returncode: int | None = None
            self.pid = os.fork()
            if self.pid == 0:
                try:
                    with Disk(tiny.place, told).installed():
                        local.serve(pass_fds[0])
                finally:
                    os._exit(1)

        def poll(self) -> int | None:
            return self._ended(os.WNOHANG)

        def wait(self) -> int | None:
            return self._ended(0)

        def kill(self) -> None:
            if self.returncode is None:
                os.kill(self.pid, signal.SIGKILL)

        def _ended(self, how: int) -> int | None:
            if self.returncode is None and (ended := os.waitpid(self.pid, how))[0]:
                self.returncode = os.waitstatus_to_exitcode(ended[1])
            return self.returncode

    return Forked


@pytest.fixture
def build(tiny, monkeypatch) -> Callable[..., tuple[int, str]]:
    """Build with one worker, the first of which has that disk: exit status, and what was said."""

    def run(*tolds: Told) -> tuple[int, str]:
        monkeypatch.setattr(subprocess, "Popen", forked(tiny, list(tolds)))
        return tiny.build("--workers", 1)

    return run


@pytest.fixture
def log(tiny, build, tmp_path) -> list[tuple[str, str]]:
    """The operations of the one worker of an undisturbed run."""
    with (tmp_path / "log").open("a", buffering=1) as file:
        tiny.empty()
        assert build(lambda _, *operation: file.write("\t".join(operation) + "\n")) == (0, "")
    lines = (tmp_path / "log").read_text().splitlines()
    found = [(kind, path) for kind, _, path in (line.partition("\t") for line in lines)]
    stages = {Path(path).parent.name for kind, path in found if path.endswith(".done")}
    assert len(stages) == 7, "every stage has a unit that ran in the worker"
    assert ("rename", str(tiny.output)) in found
    return found


def kill(number: int) -> Told:
    def told(at: int, operation: str, path: str) -> None:
        if at == number:
            os.kill(os.getpid(), signal.SIGKILL)

    return told


def kill_before(name: str) -> Told:
    """Killed before a file gets that name."""

    def told(_: int, operation: str, path: str) -> None:
        if operation == "rename" and path.endswith(name):
            os.kill(os.getpid(), signal.SIGKILL)

    return told


@pytest.mark.parametrize("kinds", [("rename",), pytest.param(WRITING, marks=pytest.mark.long)])
def test_a_worker_killed_before_any_of_its_operations_costs_no_rerun_and_no_byte(
    tiny, build, log, kinds
):
    for number in [number for number, (kind, _) in enumerate(log) if kind in kinds]:
        tiny.empty()
        assert build(kill(number)) == (0, ""), f"killed at {log[number]}"
        assert tiny.held() == tiny.whole, f"killed at {log[number]}"
        assert os.listdir(tiny.place) == [tiny.output.name]


@pytest.mark.parametrize("last", ["file.done", "out.gsb"])
def test_a_unit_whose_workers_die_when_its_file_is_made_is_done_by_the_rerun(tiny, build, last):
    tiny.empty()
    code, said = build(*map(kill_before, ("file.done", "file.done", last)))
    assert code == 3
    assert "each of these units has killed 3 workers and is left out: file (by signal 9)" in said
    assert tiny.held() == tiny.whole
    assert build() == (0, "")
    assert tiny.held() == tiny.whole


@pytest.mark.parametrize("kinds", [("rename",), pytest.param(WRITING, marks=pytest.mark.long)])
def test_any_failing_operation_of_a_worker_stops_the_job_which_resumes_to_the_same_bytes(
    tiny, build, log, kinds
):
    for number in [number for number, (kind, _) in enumerate(log) if kind in kinds]:
        error = ERRORS[number % len(ERRORS)]
        trial = f"{number}: {log[number]} fails with {errno.errorcode[error]}"
        tiny.empty()
        code, said = build(failing(number, error))
        assert code == 3, f"{trial}: {said}"
        assert re.fullmatch(rf"gstream: .*{os.strerror(error)} in stage .*, unit .*\n", said), trial
        assert build() == (0, ""), trial
        assert tiny.held() == tiny.whole, trial
        assert os.listdir(tiny.place) == [tiny.output.name], trial
