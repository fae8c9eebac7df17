"""What measurements begin with: a scene and its stream, and modules in fresh processes."""

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gstream.errors import GstreamError
from gstream.job import IngestSettings
from gstream.report.truth.mesh import scene_of_stream
from gstream.report.truth.scene import Scene, write_ply
from gstream.report.truth.scenes import SCENES
from gstream.run import commands
from gstream.run.commands import RunOptions


def prepared(name: str, fineness: int, folder: Path) -> tuple[Scene, Path]:
    """A scene and its stream, made in `folder` where the user's file is none."""
    stream = folder / "scene.gst"
    if name.endswith(".gst"):
        return scene_of_stream(Path(name).name, name), Path(name)
    if name not in SCENES:
        _ingest(name, stream)
        return scene_of_stream(Path(name).name, stream), stream
    scene = SCENES[name](fineness)
    write_ply(scene, folder / "scene.ply")
    _ingest(str(folder / "scene.ply"), stream)
    return scene, stream


def _ingest(mesh: str, stream: Path) -> None:
    commands.ingest(IngestSettings(inputs=(mesh,)), str(stream), RunOptions(workers=0)).run()


def fresh(module: str, request: Mapping[str, Any]) -> Any:
    """What a module says as JSON in a new process."""
    command = [sys.executable, "-P", "-m", module, json.dumps(request)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise GstreamError(f"a run of the report failed: {said}; request {json.dumps(request)}")
    return json.loads(done.stdout)
