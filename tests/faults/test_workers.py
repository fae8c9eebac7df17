"""A worker process dies before each of its operations on the disk, or the operation fails there."""

import errno
import os
import re
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from faults.disk import Disk, Told
from faults.test_disk_errors import ERRORS, WRITING, failing

from gstream.run import worker


class Kept:
    """A copy that lives for the whole job, as an interpreter of its own does: its operations are
    numbered through all stages."""

    def __init__(self, process: worker.Fork) -> None:
        self.poll, self.wait, self.kill = process.poll, process.wait, process.kill


@pytest.fixture
def build(tiny, monkeypatch) -> Callable[..., tuple[int, str]]:
    """Build with one worker, and those that replace it, on these disks: status, what was said."""

    def run(*tolds: Told) -> tuple[int, str]:
        left = iter(tolds)

        def start(pipe: int) -> worker.Process:
            told = next(left, lambda *_: None)

            def serve(pipe: int) -> None:
                with Disk(tiny.place, told).installed():
                    worker.serve(pipe)

            return Kept(worker.Fork(serve, pipe))

        monkeypatch.setattr(worker, "start", start)
        return tiny.build("--workers", 1)

    return run


@pytest.fixture
def log(tiny, build, tmp_path) -> list[tuple[str, str]]:
    """The operations of the one worker of an undisturbed run."""

    def tell(_: int, *operation: str) -> None:
        with (tmp_path / "log").open("a") as file:
            file.write("\t".join(operation) + "\n")

    tiny.empty()
    assert build(tell) == (0, "")
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
