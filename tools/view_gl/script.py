"""Camera scripts: key frames as JSON, a camera for every frame. README.md describes the file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import exp
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scene import Scene
from .camera import Camera
from .session import Session, scene_camera

Floats = NDArray[np.float64]

MAX_FRAMES = 1_000_000
# Keys of a key frame: how many numbers, and what they may be.
PLACED: dict[str, tuple[int, float, float]] = {
    "position": (3, -1e15, 1e15),
    "target": (3, -1e15, 1e15),
    "up": (3, -1e15, 1e15),
    "fov": (1, 1, 170),
}
ORBIT: dict[str, tuple[int, float, float]] = {
    "azimuth": (1, -36_000, 36_000),
    "elevation": (1, -90, 90),
    "zoom": (1, 1e-6, 1e6),
}
TIME = (1, -1e9, 1e9)


class ScriptError(Exception):
    """A file that is no camera script; one line that names the place, and what to do."""


@dataclass(frozen=True, slots=True)
class Script:
    """Key frames.

    times : (n,) seconds, ascending
    values : of each key, (n, k); all of PLACED or of ORBIT that the file has
    """

    fps: float
    times: Floats
    values: Mapping[str, Floats]

    @property
    def frames(self) -> int:
        """How many pictures there are: one at the first key and one at the last, if it fits."""
        return int((self.times[-1] - self.times[0]) * self.fps + 1e-6) + 1

    def at(self, frame: int) -> dict[str, Floats]:
        """The values of a frame, (k,) each."""
        time = self.times[0] + frame / self.fps
        return {name: curve(self.times, rows, time) for name, rows in self.values.items()}

    def camera(self, frame: int, session: Session, aspect: float) -> Camera:
        """The camera of a frame: what the script does not say is as in the scene.

        errors : SceneError for a camera that looks nowhere, or along its up
        """
        values = self.at(frame)
        zoom = exp(values.pop("zoom", np.zeros(1))[0])
        said: dict[str, Any] = {"position": None, "target": None} if "azimuth" in values else {}
        for name, row in values.items():
            said[name] = tuple(row.tolist()) if len(row) > 1 else float(row[0])
        scene: Scene = replace(session.scene, camera=replace(session.scene.camera, **said))
        return scene_camera(scene, session.file, aspect).zoom(zoom)


def read_script(path: str | Path) -> Script:
    """errors : OSError; ScriptError, one line that names the place"""
    try:
        given = json.loads(Path(path).read_bytes())
    except (ValueError, RecursionError) as error:
        raise ScriptError(f"{path}: is no JSON: {error}; mend the file") from None
    try:
        return script_of(given)
    except ScriptError as error:
        raise ScriptError(f"{path}: {error}") from None


def script_of(given: Any) -> Script:
    """errors : ScriptError, one line that names the place"""
    script = _object("the script", given, ("fps", "keys"))
    (fps,) = _numbers("fps", script.get("fps", 30), (1, 1e-3, 1e3))
    keys = script.get("keys")
    if not isinstance(keys, list) or not keys:
        raise ScriptError("keys: is no list of key frames; give one at least")
    first = _object("keys[0]", keys[0], ("time", *PLACED, *ORBIT))
    if ("position" in first) == ("azimuth" in first):
        raise ScriptError("keys[0]: needs either position or azimuth; give one of them")
    rules = {"time": TIME, **(PLACED if "position" in first else ORBIT)}
    names = [name for name in rules if name in first or name == "time"]
    rows: dict[str, list[list[float]]] = {name: [] for name in names}
    for i, key in enumerate(keys):
        _object(f"keys[{i}]", key, names)
        for name in names:
            place = f"keys[{i}].{name}"
            if name not in key:
                raise ScriptError(f"{place}: is missing; give it in all key frames or in none")
            rows[name].append(_numbers(place, key[name], rules[name]))
    values = {name: np.array(row) for name, row in rows.items()}
    times = values.pop("time")[:, 0]
    late = np.flatnonzero(np.diff(times) <= 0) + 1
    if len(late):
        raise ScriptError(f"keys[{late[0]}].time: is not after the key before; put them in order")
    if "zoom" in values:
        values["zoom"] = np.log(values["zoom"])  # as fast near the target as far from it
    made = Script(fps, times, values)
    if made.frames > MAX_FRAMES:
        raise ScriptError(f"keys: {made.frames} frames are above {MAX_FRAMES}; lower fps")
    return made


def curve(times: Floats, rows: Floats, time: float) -> Floats:
    """The value at a time, between (n, k) values at ascending times: a cubic Hermite spline.

    Tangents are Catmull and Rom's for uneven times, but 0 beside a stretch where nothing changes:
    what two keys in a row agree on rests between them.
    """
    if len(times) == 1:
        return np.array(rows[0])
    steps = np.diff(times)[:, None]
    slopes = np.diff(rows, axis=0) / steps
    tangents = np.empty_like(rows)
    tangents[0], tangents[-1] = slopes[0], slopes[-1]
    before, after = slopes[:-1], slopes[1:]
    mean = (before * steps[1:] + after * steps[:-1]) / (steps[1:] + steps[:-1])
    tangents[1:-1] = np.where((before == 0) | (after == 0), 0, mean)
    i = int(np.clip(np.searchsorted(times, time, "right") - 1, 0, len(steps) - 1))
    u = min(max((time - times[i]) / steps[i, 0], 0.0), 1.0)
    found: Floats = (
        (1 + 2 * u) * (1 - u) ** 2 * rows[i]
        + u * (1 - u) ** 2 * steps[i] * tangents[i]
        + u * u * (3 - 2 * u) * rows[i + 1]
        + u * u * (u - 1) * steps[i] * tangents[i + 1]
    )
    return found


def _object(place: str, given: Any, known: Iterable[str]) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise ScriptError(f"{place}: is no object; write {{…}}")
    for name in given:
        if name not in known:
            raise ScriptError(f"{place}: has no {name!r}; it may have {', '.join(known)}")
    return given


def _numbers(place: str, given: Any, rule: tuple[int, float, float]) -> list[float]:
    count, least, most = rule
    row = [given] if count == 1 else given
    real = isinstance(row, list) and len(row) == count
    if not real or not all(type(number) in (int, float) for number in row):
        said = "a number" if count == 1 else f"{count} numbers"
        raise ScriptError(f"{place}: is not {said}; give {said}")
    if not all(least <= number <= most for number in row):  # nor is a NaN
        raise ScriptError(f"{place}: is not from {least:g} to {most:g}; give another number")
    return [float(number) for number in row]
