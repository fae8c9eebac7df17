"""One run in a process of its own: `python -m gstream.report.point JSON`, its report on stdout."""

import importlib
import json
import sys
from dataclasses import fields
from typing import Any

from gstream.job import VoxelizeSettings
from gstream.run import commands
from gstream.run.commands import RunOptions


def voxelize(stream: str, output: str, settings: dict[str, Any]) -> dict[str, Any]:
    """Voxelize with `settings`, fields of VoxelizeSettings and RunOptions; the job's report.

    Kernels are loaded before, so that the job's CPU seconds are its work's: loading takes up to a
    second, as much as voxelizing a small scene.
    """
    for stage in commands.VOXELIZE:
        getattr(importlib.import_module(f"gstream.stages.{stage}"), "warm", lambda: None)()
    names = {field.name for field in fields(VoxelizeSettings)}
    voxels = {name: value for name, value in settings.items() if name in names}
    running = {name: value for name, value in settings.items() if name not in names}
    options = RunOptions(force=True, **running)
    return commands.voxelize(stream, VoxelizeSettings(**voxels), output, options).run().as_dict()


if __name__ == "__main__":
    print(json.dumps(voxelize(**json.loads(sys.argv[1]))))
