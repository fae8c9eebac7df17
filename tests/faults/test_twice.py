"""A unit that runs twice at once: one run waits, at any of its operations, while the other runs."""

import importlib
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from faults.disk import Disk

from gstream.job import IngestSettings, Job, VoxelizeSettings

# Not among them: spill, which appends to columns of fixed names, and pack, which writes beside the
# output. Their one run at a time is held by the lock of the job's folder.
STAGES = ("ingest", "presort", "voxelize", "merge", "simplify")


@pytest.fixture
def job(tiny) -> Job:
    """The tiny job in its folder, not begun."""
    tiny.empty()
    return Job(
        folder=str(tiny.place / "job"),
        output=str(tiny.output),
        stream=str(tiny.place / "job" / "scene.gst"),
        ingest=IngestSettings(tuple(map(str, tiny.meshes))),
        voxelize=VoxelizeSettings(resolution=16, block=8, cell=8),
    )


def held(job: Job) -> dict[str, bytes]:
    files = (path for path in Path(job.folder).rglob("*") if path.is_file())
    return {str(path): path.read_bytes() for path in files}


def run_beside(run: Callable[[], None], job: Job, number: int) -> bool:
    """Run twice: a process waits at the `number`-th operation that is no read, and is passed."""
    waits, wait = os.pipe()
    goes, go = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            left = iter(range(number, -1, -1))

            def told(at: int, operation: str, path: str) -> None:
                if operation != "read" and next(left, None) == 0:
                    os.write(wait, b"w")
                    os.read(goes, 1)

            with Disk(Path(job.folder), told).installed():
                run()
            os.write(wait, b"e")
            code = 0
        finally:
            os._exit(code)
    waited = os.read(waits, 1) == b"w"
    if waited:
        run()
        os.write(go, b"g")
    assert os.waitpid(child, 0)[1] == 0
    for descriptor in (waits, wait, goes, go):
        os.close(descriptor)
    return waited


def test_two_runs_of_a_unit_at_once_leave_what_one_leaves(job):
    for name in ("spill", *STAGES):
        stage = importlib.import_module(f"gstream.stages.{name}")
        for unit in stage.plan(job):
            stage.work(job, unit)
            once, number = held(job), 0
            run = partial(stage.work, job, unit)
            while name in STAGES and run_beside(run, job, number):
                assert held(job) == once, f"{unit} at operation {number}"
                number += 1
            assert number > 5 or name not in STAGES
        stage.finish(job)
