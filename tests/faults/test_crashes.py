"""The process dies before each operation on its disk; what was not synced is lost or torn."""

import json
import os
import signal
from random import Random

import pytest
from faults.disk import Disk
from faults.tiny import TinyJob

WRITING = ("write", "fsync", "rename")


def crash(tiny: TinyJob, number: int, random: Random | None) -> None:
    """Build in a process that is killed before that operation; random : what power loss takes."""
    child = os.fork()
    if child == 0:
        disk = Disk(tiny.place, lambda at, *_: at == number and end())

        def end() -> None:
            if random is not None:
                disk.lose_power(random)
            os.kill(os.getpid(), signal.SIGKILL)

        try:
            with disk.installed():
                tiny.build()
        finally:
            os._exit(1)
    assert os.waitpid(child, 0)[1] == signal.SIGKILL


def resume(tiny: TinyJob) -> dict[str, int]:
    """Run again; how many units each stage had, less those that were done."""
    report = tiny.place / "report"
    assert tiny.build("--report", report) == (0, "")
    stages = json.loads(report.read_text())["stages"]
    return {stage["stage"]: stage["units"] - stage["resumed"] for stage in stages}


def markers(tiny: TinyJob) -> list[str]:
    return [path.parent.name for path in tiny.place.glob("*/*/*.done")]


def test_a_kill_before_any_operation_costs_only_the_unit_that_was_running(tiny):
    total = sum(1 for kind, path in tiny.log if path.endswith(".done") and kind == "rename")
    for number in tiny.numbers("rename"):
        tiny.empty()
        crash(tiny, number, None)
        assert tiny.held() in (None, tiny.whole)
        left = 0 if tiny.held() else total - len(markers(tiny))
        ran = resume(tiny)
        assert sum(ran.values()) == left, f"killed at {tiny.log[number]}"
        assert tiny.held() == tiny.whole


def test_a_kill_while_the_job_s_folder_goes_leaves_a_finished_job(tiny):
    gone = next(n for n, (_, path) in enumerate(tiny.log) if path.endswith(".removed"))
    assert gone - tiny.end > 10, "each stage's folder is an operation"
    for number in range(tiny.end, gone):
        tiny.empty()
        crash(tiny, number, None)
        assert resume(tiny) == {}, f"killed at {tiny.log[number]}"
        assert tiny.held() == tiny.whole


@pytest.mark.parametrize("step", [3, pytest.param(1, marks=pytest.mark.long)])
def test_what_a_power_loss_takes_is_made_again_and_never_believed(tiny, step):
    for number in tiny.numbers(*WRITING)[::step]:
        tiny.empty()
        crash(tiny, number, Random(number))
        assert tiny.held() in (None, tiny.whole), f"lost at {tiny.log[number]}"
        resume(tiny)
        assert tiny.held() == tiny.whole, f"lost at {tiny.log[number]}"
