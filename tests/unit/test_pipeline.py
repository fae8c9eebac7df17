"""The pipeline over a toy stage: real processes, resuming, deaths, signals and full disks."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from gstream.errors import InputError, RefusedError, StoppedError
from gstream.job import IngestSettings, Job
from gstream.run.budget import (
    LEAST_UNIT_BYTES,
    MIB,
    PARENT_BYTES,
    WORKER_BYTES,
    check_disk,
    plan_memory,
)
from gstream.run.pipeline import run_job
from gstream.run.progress import Event, Memory, Resumed, StageBegins, StageEnds, UnitLeftOut
from gstream.run.usage import tree_memory, tree_usage
from gstream.run.worker import UnitError
from unit import toy_stage


def toy_job(folder: Path, units: int = 6, how: str = "ok", workers: int = 0) -> Job:
    scratch = folder / "scratch"
    scratch.mkdir(exist_ok=True)
    return Job(
        folder=str(scratch),
        output=str(folder / "out.txt"),
        stream=str(folder / "out.txt"),
        ingest=IngestSettings((str(units), how)),
        workers=workers,
    )


def calls(folder: Path) -> list[str]:
    return (folder / "scratch" / "calls").read_text().split()


@pytest.mark.parametrize("workers", [0, 1, 2, 5])
def test_every_worker_count_gives_the_same_file_and_report(tmp_path, workers):
    report = run_job(toy_job(tmp_path, workers=workers), [toy_stage])
    assert (tmp_path / "out.txt").read_text() == "[0, 1, 4, 9, 16, 25]"
    assert dict(report.stages[0].counts) == {"sum": 55}
    assert sorted(calls(tmp_path)) == [f"u{i}" for i in range(6)]
    assert report.output_bytes == 20


def test_a_second_run_repeats_only_units_whose_files_are_gone(tmp_path):
    job = toy_job(tmp_path)
    run_job(job, [toy_stage])
    (tmp_path / "scratch/toy/u3.txt").unlink()
    (tmp_path / "scratch/toy/u4.txt").write_text("")
    report = run_job(job, [toy_stage])
    assert calls(tmp_path)[6:] == ["u3", "u4"]
    assert report.stages[0].resumed == 4


def test_a_paranoid_run_repeats_units_whose_files_have_other_bytes(tmp_path):
    job = toy_job(tmp_path)
    run_job(job, [toy_stage])
    (tmp_path / "scratch/toy/u3.txt").write_text("7")
    assert run_job(job, [toy_stage]).stages[0].resumed == 6
    assert (tmp_path / "out.txt").read_text() == "[0, 1, 4, 7, 16, 25]"
    assert run_job(job, [toy_stage], paranoid=True).stages[0].resumed == 5
    assert (tmp_path / "out.txt").read_text() == "[0, 1, 4, 9, 16, 25]"


def test_progress_hears_of_every_unit_and_only_pending_cost(tmp_path):
    run_job(toy_job(tmp_path, units=2), [toy_stage])
    told: list[Event] = []
    run_job(toy_job(tmp_path, units=4), [toy_stage], told.append)
    told = [event for event in told if not isinstance(event, Memory)]
    assert told[:2] == [Resumed("toy", 2), StageBegins("toy", 2, 5.0, 5 / 6)]
    assert [(unit.unit, unit.cost) for unit in told[2:4]] == [("u2", 2.0), ("u3", 3.0)]
    assert [type(event) for event in told[4:]] == [StageEnds]


@pytest.mark.parametrize("workers", [0, 2])
def test_an_error_of_a_unit_arrives_whole(tmp_path, workers):
    with pytest.raises(InputError) as caught:
        run_job(toy_job(tmp_path, how="input", workers=workers), [toy_stage])
    assert str(caught.value) == "a.ply: vertex 3: is not a number; repair the mesh"
    assert not (tmp_path / "out.txt").exists()


@pytest.mark.parametrize("workers", [0, 2])
def test_a_bug_in_a_unit_names_the_unit_and_keeps_its_traceback(tmp_path, workers):
    with pytest.raises(UnitError, match="stage toy, unit u1: ZeroDivisionError") as caught:
        run_job(toy_job(tmp_path, how="bug", workers=workers), [toy_stage])
    assert "_misbehave" in caught.value.trace


@pytest.mark.parametrize("workers", [0, 2])
def test_a_full_disk_stops_the_job_and_says_where_and_how_to_go_on(tmp_path, workers):
    with pytest.raises(StoppedError, match="No space left on device in stage toy, unit u1") as full:
        run_job(toy_job(tmp_path, how="full", workers=workers), [toy_stage])
    assert str(tmp_path) in str(full.value)
    assert "run the same command again to resume" in str(full.value)


def test_a_worker_that_dies_once_is_replaced(tmp_path):
    run_job(toy_job(tmp_path, how="die-once", workers=2), [toy_stage])
    assert (tmp_path / "out.txt").read_text() == "[0, 1, 4, 9, 16, 25]"


LEFT_OUT = (
    r"stage toy: each of these units has killed 3 workers and is left out: u1 \(by signal 9\);"
)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_unit_that_kills_three_workers_is_named_when_all_others_are_done(tmp_path, workers):
    told: list[Event] = []
    with pytest.raises(StoppedError, match=LEFT_OUT):
        run_job(toy_job(tmp_path, how="die", workers=workers), [toy_stage], told.append)
    assert sorted(calls(tmp_path)) == ["u0", "u2", "u3", "u4", "u5"]
    assert not (tmp_path / "out.txt").exists()
    left_out = [event for event in told if isinstance(event, UnitLeftOut)]
    assert left_out == [UnitLeftOut("toy", "u1", "signal 9")]


def test_a_rerun_tries_the_unit_that_was_left_out_alone_and_outlives_it(tmp_path):
    for _ in range(2):
        with pytest.raises(StoppedError, match=LEFT_OUT):
            run_job(toy_job(tmp_path, how="die", workers=2), [toy_stage])
    run_job(toy_job(tmp_path, how="ok", workers=2), [toy_stage])
    assert calls(tmp_path)[5:] == ["u1"]
    assert (tmp_path / "out.txt").read_text() == "[0, 1, 4, 9, 16, 25]"


def test_workers_that_die_of_every_unit_end_the_job_before_all_units_are_tried(tmp_path):
    with pytest.raises(StoppedError, match="left out") as stopped:
        run_job(toy_job(tmp_path, units=40, how="die-all", workers=2), [toy_stage])
    assert 16 <= str(stopped.value).count("by signal 9") <= 17


def test_a_job_in_a_thread_leaves_signals_alone(tmp_path):
    before = signal.getsignal(signal.SIGTERM)
    thread = threading.Thread(target=run_job, args=(toy_job(tmp_path), [toy_stage]))
    thread.start()
    thread.join()
    assert (tmp_path / "out.txt").exists()
    assert signal.getsignal(signal.SIGTERM) is before


SCRIPT = """
import sys
sys.path[:] = {path!r}
from pathlib import Path
from unit import toy_stage
from unit.test_pipeline import toy_job
from gstream.errors import GstreamError
from gstream.run.pipeline import run_job
try:
    run_job(toy_job(Path({folder!r}), how={how!r}, workers={workers}), [toy_stage])
except GstreamError as error:
    print(error)
    sys.exit(error.exit_code)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("workers", [0, 2])
def test_a_signal_stops_a_script_without_a_main_guard_and_its_workers(tmp_path, workers, number):
    status, said, children = stop_script(tmp_path, "sleep", workers, number)
    assert status == StoppedError.exit_code
    assert said == f"stopped by {number.name}; run the same command again to resume\n"
    assert not any(Path(f"/proc/{pid}").exists() for pid in children)


def test_a_signal_stops_a_process_held_by_c_code_and_removes_the_half_written_file(tmp_path):
    half = tmp_path / "out.txt.wip"
    half.touch()
    status, said, _ = stop_script(tmp_path, "stuck", 0, signal.SIGTERM)
    assert status == StoppedError.exit_code
    assert said == "gstream: stopped by a signal; run the same command again to resume\n"
    assert not half.exists()


def stop_script(folder: Path, how: str, workers: int, number: int) -> tuple[int, str, list[str]]:
    """Exit status, output and former children of a script that is sent a signal while it works."""
    script = folder / "script.py"
    filled = SCRIPT.format(path=sys.path, folder=str(folder), workers=workers, how=how)
    script.write_text(filled)
    command = [sys.executable, script]
    out = subprocess.PIPE
    with subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, text=True) as process:
        wait_until(lambda: (folder / "scratch/toy").exists())
        time.sleep(0.5)  # until unit 1 has begun; too early is as good a moment
        children = child_processes(process.pid)
        process.send_signal(number)
        said, _ = process.communicate(timeout=20)
    return process.returncode, said, children


def child_processes(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/task/{pid}/children").read_text().split()


def wait_until(holds) -> None:
    end = time.monotonic() + 60
    while not holds():
        assert time.monotonic() < end, "waited a minute"
        time.sleep(0.02)


@pytest.mark.parametrize("workers", [1, 2, 7])
def test_the_memory_plan_never_promises_more_than_it_was_given(workers):
    for memory in range(LEAST_UNIT_BYTES + PARENT_BYTES, 8 << 30, 100 * MIB):
        plan = plan_memory(memory, workers)
        taken = (
            PARENT_BYTES + plan.workers * WORKER_BYTES + max(plan.workers, 1) * plan.worker_memory
        )
        assert taken <= memory
        assert plan.worker_memory >= LEAST_UNIT_BYTES
        assert plan.workers <= workers


def test_too_little_memory_is_refused_with_the_amount_that_would_do():
    with pytest.raises(
        RefusedError, match=r"--memory 100MiB is too little.*give --memory (\d+)MiB"
    ):
        plan_memory(100 * MIB, 2)


def test_a_short_disk_is_refused_with_both_numbers():
    with pytest.raises(RefusedError, match="/x: scratch needs about 3 MiB, and 1 MiB are free"):
        check_disk("scratch", "/x", 2 * MIB + 1, MIB)


def test_tree_memory_counts_a_child():
    code = "data = bytearray(64 << 20); print(1, flush=True); input()"
    before = tree_memory(os.getpid())
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", code], stdin=pipe, stdout=pipe) as child:
        assert child.stdout is not None
        child.stdout.readline()
        assert tree_memory(os.getpid()) - before > 60 << 20
        child.communicate(b"\n")


SPEND = """
import subprocess, sys
inner = "sum(i * i for i in range(5_000_000)); open(sys.argv[1], 'wb').write(bytes(3 << 20))"
subprocess.run([sys.executable, "-c", "import sys;" + inner, sys.argv[1]], check=True)
print(1, flush=True)
input()
"""


def test_tree_usage_counts_a_grandchild_that_has_ended(tmp_path):
    before = tree_usage(os.getpid())
    pipe, command = subprocess.PIPE, [sys.executable, "-c", SPEND, str(tmp_path / "out")]
    with subprocess.Popen(command, stdin=pipe, stdout=pipe) as child:
        assert child.stdout is not None
        child.stdout.readline()
        took = tree_usage(os.getpid()).since(before)
        child.communicate(b"\n")
    assert took.cpu_seconds > 0.1
    assert 3 << 20 <= took.written_bytes < 4 << 20
    assert took.read_bytes > 0
