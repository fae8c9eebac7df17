"""Killed, interrupted and repeated: a job ends in the same bytes, half-written files in none."""

import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest
from e2e.meshes import sphere, write_ply
from e2e.program import ENVIRONMENT, PROGRAM, fail, succeed

SETTINGS = ("--resolution", 256, "--block", 16, "--cell", 16, "--sep", "conservative")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a sphere and what an undisturbed build makes of it."""
    made = tmp_path_factory.mktemp("kill")
    write_ply(made / "sphere.ply", *sphere(120))
    succeed(made, "build", "sphere.ply", "-o", "whole.gsb", *SETTINGS, "--workers", 0)
    return made


def start(folder: Path, output: str, workers: int, *more: object) -> subprocess.Popen[str]:
    settings = (*SETTINGS, "--workers", workers, *more)
    command = [PROGRAM, "build", "sphere.ply", "-o", output, *settings]
    return subprocess.Popen(
        [str(part) for part in command],
        cwd=folder,
        env=ENVIRONMENT,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def wait_for(folder: Path, pattern: str, process: subprocess.Popen[str]) -> bool:
    """Wait until a file of that pattern is there; False when the process ends before."""
    while process.poll() is None:
        if any(folder.glob(pattern)):
            return True
        time.sleep(0.01)
    return False


@pytest.mark.parametrize(
    ("stage", "workers"),
    [("2-ingest", 2), ("3-presort", 2), ("4-voxelize", 2), ("6-simplify", 2), ("4-voxelize", 0)],
)
def test_a_killed_job_resumes_to_the_same_bytes(folder, stage, workers):
    output = f"killed-{stage}-{workers}.gsb"
    with start(folder, output, workers) as process:
        if not wait_for(folder, f"gstream-*/{stage}/*.done", process):
            pytest.skip("the job was over before it could be killed")
        process.kill()
        process.communicate()
    if not (folder / output).exists():
        assert list(folder.glob("gstream-*/job.json"))
        succeed(
            folder,
            "build",
            "sphere.ply",
            "-o",
            output,
            *SETTINGS,
            "--workers",
            workers,
            "--report",
            "r",
        )
        report = json.loads((folder / "r").read_text())
        assert sum(part["resumed"] for part in report["stages"]) > 0
    assert (folder / output).read_bytes() == (folder / "whole.gsb").read_bytes()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_job_exits_with_3_and_one_line_that_says_how_to_resume(folder, number):
    output = f"stopped-{number}.gsb"
    with start(folder, output, 2) as process:
        assert wait_for(folder, "gstream-*/4-voxelize/*.done", process)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 3
    line = said.splitlines()[-1]
    assert line.startswith(
        f"gstream: stopped by {number.name}; run the same command again to resume"
    )
    assert not (folder / output).exists()
    succeed(folder, "build", "sphere.ply", "-o", output, *SETTINGS, "--workers", 2)
    assert (folder / output).read_bytes() == (folder / "whole.gsb").read_bytes()


def test_a_second_run_of_a_running_job_is_refused(folder):
    with start(folder, "twice.gsb", 0) as process:
        assert wait_for(folder, "gstream-*/job.json", process)
        os.kill(process.pid, signal.SIGSTOP)
        arguments = ("build", "sphere.ply", "-o", "twice.gsb", *SETTINGS, "--workers", 0)
        said = fail(folder, 2, *arguments)
        assert "this job is running already in another process" in said
        os.kill(process.pid, signal.SIGCONT)
        process.communicate()
    assert process.returncode == 0


def test_a_killed_job_tells_how_far_it_is_and_is_resumed_by_its_folder(folder):
    output, log = "by-folder.gsb", folder / "by-folder.log"
    with start(folder, output, 2, "--log", log) as process:
        assert wait_for(folder, "gstream-*/4-voxelize/*.done", process)
        os.kill(process.pid, signal.SIGSTOP)
        job = next(folder.glob("gstream-*"))
        running = json.loads(succeed(folder, "status", job, "--json"))
        said = fail(folder, 2, "clean", job)
        process.kill()
        process.communicate()
    assert running["running"]
    assert "this job is running already" in said
    found = json.loads(succeed(folder, "status", job, "--json"))
    assert not found["running"]
    stages = {stage["stage"]: stage for stage in found["stages"]}
    assert list(stages) == ["1-spill", "2-ingest", "3-presort", "4-voxelize"]
    assert 0 < stages["4-voxelize"]["done"] < stages["4-voxelize"]["units"]
    text = succeed(folder, "status", job)
    assert f"gstream resume {job}\n" in text
    assert "merge" in text
    succeed(folder.parent, "resume", job, "--workers", 0, "--log", log)
    assert (folder / output).read_bytes() == (folder / "whole.gsb").read_bytes()
    events = [json.loads(line) for line in log.read_text().splitlines()]
    assert [event["resumed"] for event in events if event["event"] == "start"] == [False, True]
    done = [(event["stage"], event["unit"]) for event in events if event["event"] == "unit_done"]
    assert len(done) == len(set(done))
    assert (events[-1]["event"], events[-1]["output"]) == ("end", str(folder / output))


def test_a_stopped_job_with_other_settings_is_refused_until_it_is_cleaned(folder):
    output = "other.gsb"
    with start(folder, output, 0) as process:
        assert wait_for(folder, "gstream-*/2-ingest/*.done", process)
        process.kill()
        process.communicate()
    job = next(folder.glob("gstream-*"))
    other = ("build", "sphere.ply", "-o", output, "--resolution", 32, "--workers", 0)
    said = fail(folder, 2, *other)
    assert re.search(
        "settings were [0-9a-f]{16}, are [0-9a-f]{16} [(].*resolution 256, now 32", said
    )
    freed = re.fullmatch(rf"{job}: ([0-9,]+) bytes freed\n", succeed(folder, "clean", job))
    assert freed is not None
    assert int(freed[1].replace(",", "")) > 10_000
    assert not job.exists()
    succeed(folder, *other)
