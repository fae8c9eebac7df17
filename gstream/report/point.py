"""One run in a process of its own: `python -m gstream.report.point JSON`, its report on stdout."""

import importlib
import json
import sys
from dataclasses import fields
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from typing import Any

from gstream.job import VoxelizeSettings
from gstream.run import commands
from gstream.run.commands import RunOptions


def voxelize(stream: str, output: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Voxelize with `settings`, fields of VoxelizeSettings and RunOptions; the job's report.

    Kernels are loaded before, so that the job's CPU seconds are its work's: loading takes up to a
    second, as much as voxelizing a small scene. They are measured here, to the microsecond.
    """
    for stage in commands.VOXELIZE:
        getattr(importlib.import_module(f"gstream.stages.{stage}"), "warm", lambda: None)()
    names = {field.name for field in fields(VoxelizeSettings)}
    voxels = {name: value for name, value in settings.items() if name in names}
    running = {name: value for name, value in settings.items() if name not in names}
    options = RunOptions(force=True, **running)
    began = _cpu_seconds()
    report = commands.voxelize(stream, VoxelizeSettings(**voxels), output, options).run().as_dict()
    return {**report, "cpu_seconds": _cpu_seconds() - began}


def _cpu_seconds() -> float:
    """Of this process and its children that have ended."""
    used = (getrusage(who) for who in (RUSAGE_SELF, RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)


if __name__ == "__main__":
    print(json.dumps(voxelize(**json.loads(sys.argv[1]))))
