"""Running the command line as a user does, and what it costs: CPU and memory of its whole tree."""

import json
import os
import platform
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gstream.run.usage import tree_memory

SAMPLE_SECONDS = 0.1
ENTRY = "from gstream_cli.main import run; run()"


@dataclass(frozen=True, slots=True)
class Cost:
    """What one command took; `returncode`, `out` and `err` are what it said."""

    returncode: int
    out: str
    err: str
    cpu_s: float  # user and system, all processes
    wall_s: float
    peak_bytes: int  # largest sampled sum of Pss_Anon + Pss_Shmem over the tree
    samples: int


class CommandFailed(SystemExit):
    """A command that must succeed did not; its argument is one line."""


def run(command: Sequence[str | Path], timeout: float | None = None) -> Cost:
    """Run one command to its end, sampling its process tree's memory every 0.1 s.

    A command that takes longer than `timeout` seconds is killed (returncode -9).
    """
    before, start = _children_cpu(), time.perf_counter()
    # files, not pipes: a full pipe would stall the command while we sample
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen(command, stdout=out, stderr=err, stdin=subprocess.DEVNULL)
        peak = samples = 0
        while process.poll() is None:
            peak, samples = max(peak, tree_memory(process.pid)), samples + 1
            if timeout is not None and time.perf_counter() - start > timeout:
                process.kill()
            time.sleep(SAMPLE_SECONDS)
        wall, cpu = time.perf_counter() - start, _children_cpu() - before
        said = []
        for file in (out, err):
            file.seek(0)
            said.append(file.read().decode(errors="replace"))
    return Cost(process.returncode, said[0], said[1], cpu, wall, peak, samples)


def gstream(*arguments: str | Path, timeout: float | None = None) -> Cost:
    """Run one gstream command to its end."""
    return run([sys.executable, "-c", ENTRY, *arguments], timeout)


def expect(*arguments: str | Path) -> Cost:
    """Run one gstream command that must succeed.

    errors : CommandFailed, which ends the program where nobody catches it
    """
    cost = gstream(*arguments)
    if cost.returncode:
        line = " ".join(map(str, arguments))
        raise CommandFailed(f"gstream {line}: exit code {cost.returncode}: {cost.err.strip()}")
    return cost


def _children_cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def voxels_of(path: Path) -> int:
    """Voxels of the finest level, as `gstream info` says."""
    levels = json.loads(expect("info", path, "--json").out)["levels"]
    return int(next(row["voxels"] for row in levels if row["level"] == 0))


def machine() -> str:
    """Cores, processor, clock and load, for the head of a report."""
    text = Path("/proc/cpuinfo").read_text()
    model, clock = (re.search(rf"{name}\s*: (.*)", text) for name in ("model name", "cpu MHz"))
    name = model[1] if model else platform.machine()
    speed = f", {float(clock[1]) / 1000:.2f} GHz" if clock else ""
    load = os.getloadavg()[0]
    return f"{os.cpu_count()} cores, {name}{speed}, load {load:.1f}, {platform.python_version()}"


def markdown(head: list[str], rows: list[list[Any]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(map(str, row)) + " |" for row in [head, *rows]]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]])
