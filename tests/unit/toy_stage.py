"""A stage for tests of the pipeline: squares numbers, and fails the way its settings' inputs say.

job.ingest.inputs: how many units, then what happens in unit 1: "ok", "die" (every time; "die-all":
in all units), "die-once", "input" (an InputError), "bug", "full" (disk), "sleep", or "stuck" in C.
"""

import errno
import hashlib
import os
import signal
import time
from pathlib import Path

from gstream.errors import InputError
from gstream.job import Job, Summary, Unit
from gstream.run.publish import Scratch, publish

NAME = "toy"


def plan(job: Job) -> list[Unit]:
    assert job.ingest is not None
    count = int(job.ingest.inputs[0])
    return [Unit(NAME, f"u{i}", cost=float(i), place=i, data=(i,)) for i in range(count)]


def work(job: Job, unit: Unit) -> None:
    assert job.ingest is not None
    number = unit.data[0]
    if number == 1 or job.ingest.inputs[1] == "die-all":
        _misbehave(job.ingest.inputs[1], Path(job.folder))
    with Scratch(job) as scratch, scratch.write(f"{NAME}/{unit.name}.txt") as file:
        file.write(str(number * number).encode())
    with (Path(job.folder) / "calls").open("a") as calls:
        calls.write(f"{unit.name}\n")
    scratch.mark_done(unit, {"square": number * number}, (f"{NAME}/{unit.name}.txt",))


def finish(job: Job) -> Summary:
    with Scratch(job) as scratch:
        squares = [int(scratch.read(f"{NAME}/{unit.name}.txt")) for unit in plan(job)]
    with publish(job.output) as file:
        file.write(str(squares).encode())
    return Summary(NAME, {"sum": sum(squares)})


def _misbehave(how: str, folder: Path) -> None:
    died = folder / "died"
    if how in ("die", "die-all") or (how == "die-once" and not died.exists()):
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if how == "input":
        raise InputError("a.ply", "vertex 3", "is not a number", "repair the mesh")
    if how == "bug":
        raise ZeroDivisionError("seven by nought")
    if how == "full":
        raise OSError(errno.ENOSPC, "No space left on device")
    if how == "sleep":
        time.sleep(60)
    if how == "stuck":
        hashlib.pbkdf2_hmac("sha256", b"x", b"y", 2**30)  # minutes, without the GIL
