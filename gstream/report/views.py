"""What the OpenGL viewer's knobs cost, and what they change in a picture.

The viewer, `python -m gstream_tools.view_gl`, is a program that gstream does not import. Each point
is a film of a camera that stands still, in fresh processes; then one of a camera that hardly moves.
"""

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from statistics import median
from subprocess import CompletedProcess, run
from typing import Any

from gstream.errors import GstreamError
from gstream.report.knobs import Knob, settings_at
from gstream.report.results import Plan, Samples, Series
from gstream.report.runs import fresh, prepared
from gstream.report.truth.pictures import (
    BACKGROUND,
    differing_pixels,
    flicker,
    picture_errors,
    read_picture,
    shortfall,
)
from gstream.report.truth.scene import Codes
from gstream.report.truth.scenes import SCENES
from gstream.run.progress import Progress, StageBegins, StageEnds, UnitDone

SCENE = "torus"  # of the built-in ones: it hides itself
FINENESS = 2  # voxels per axis of the file that is viewed, in those of the default
FINER = 8  # pixels along an edge of the reference's, for each of the picture's
FRAMES = 4  # of a point: the first reads, the others draw what is there
MOVING = 17  # frames of the camera that moves
STEP = 43  # degrees that it turns in a frame, times the resolution: an eighth of a pixel outside
LONGEST = 4096  # frames until a picture that streams must be final
PIXEL_ERROR = 1
BASE: dict[str, Any] = {
    "camera.samples": 4,
    "camera.sraa": False,
    "lod.pixel_error": PIXEL_ERROR,
    "shade.ambient": 0.25,
    "shade.background": list(BACKGROUND),
    "source.colours": "none",
    "budget.io": "sync",
    "budget.occlusion": True,
    "budget.refine": "closed",
    "budget.streaming": "always",  # or a small file is uploaded whole
    "budget.upload_per_frame": 1 << 20,
}
LIGHT = "[[light]]\ndirection = [-1, 1, -2]\n"
AZIMUTH, ELEVATION = 35, 40
LEFT_OUT = (2, 6)  # exit codes: a module is missing, no OpenGL


class NoViewerError(Exception):
    """The viewer cannot draw here; one line that says what is missing."""


class Views:
    """One file, its view, and the pictures and samples so far."""

    def __init__(self, plan: Plan, folder: Path, progress: Progress) -> None:
        self._plan, self._folder, self._progress = plan, folder, progress
        self._resolution = FINENESS * plan.resolution
        self._name = SCENE if plan.scenes[0] in SCENES else plan.scenes[0]
        self._file = folder / "scene.gsb"
        self._samples: dict[tuple[str, Any], Samples] = {}
        self._pictures: dict[tuple[str, Any], Codes] = {}
        self._moments: dict[tuple[str, Any], dict[str, float]] = {}  # errors of films

    def series(self) -> list[Series]:
        """Every value of every knob once, then all of them again.

        errors : NoViewerError; GstreamError where a run fails or no picture is final
        """
        scene, stream = prepared(self._name, self._resolution, self._folder)
        settings = settings_at(self._resolution, {})
        request = {"stream": str(stream), "output": str(self._file), "settings": settings}
        fresh("gstream.report.point", request)
        most = self._most_samples()
        knobs = [_up_to(most, knob) for knob in self._plan.knobs if knob.key]
        turned = [(knob, value) for knob in knobs for value in knob.values]
        stage = f"{scene.name} viewed"
        units = len(turned) * self._plan.runs
        self._progress(StageBegins(stage, units, units))
        for _ in range(self._plan.runs):
            for knob, value in turned:
                self._turn(knob, value)
                self._progress(UnitDone(stage, 1.0))
        self._progress(StageEnds(stage, 0.0))
        return [self._series(scene.name, knob) for knob in knobs]

    def _most_samples(self) -> int:
        """Of a pixel, as the driver has them."""
        options = ("--offscreen", self._folder / "probe.png", "--size", "16x16", "--samples", "8")
        done = self._run(*options, "--json", "--quiet")
        if done.returncode in LEFT_OUT:
            raise NoViewerError(_last_line(done).removeprefix("view_gl: "))
        return int(json.loads(_succeeded(done))["samples"])

    def _turn(self, knob: Knob, value: Any) -> None:
        """One process of a value, or more of one that streams, until its picture is final."""
        key = (knob.name, value)
        changed = {knob.key: value}
        if "frames" in knob.costs:
            lines = self._streamed(changed)
            final = next(i for i, line in enumerate(lines) if line["converged"])
            largest = max(line["uploaded"] for line in lines[1:])  # the first has the roots alone
            counts = {"frames": final + 1, "largest": largest}
            seconds = None
        else:
            lines = self._film(changed, FRAMES)
            last = lines[-1]
            seconds = median(line["cpu_milliseconds"] for line in lines[1:]) / 1000
            counts = {
                "voxels": last["voxels"],
                "bytes": sum(line["uploaded"] for line in lines),
                "read": last["read_bytes"],
            }
        if key in self._samples:
            self._samples[key].add(seconds, counts)
        else:
            self._samples[key] = Samples(seconds, counts)
            self._pictures[key] = self._picture(len(lines) - 1)
            if "frames" in knob.costs:
                frames = [self._picture(i) for i in range(counts["frames"])]
                self._moments[key] = shortfall(frames)
            elif not knob.same:
                self._film(changed, MOVING, turn=STEP / self._resolution)
                self._moments[key] = {"flicker": flicker([self._picture(i) for i in range(MOVING)])}

    def _streamed(self, changed: Mapping[str, Any]) -> list[dict[str, Any]]:
        frames = 16
        while frames <= LONGEST:
            lines = self._film({"budget.io": "async", **changed}, frames)
            if lines[-1]["converged"]:
                return lines
            frames *= 2
        raise GstreamError(f"{self._name}: no final picture in {LONGEST} frames of {changed}")

    def _series(self, scene: str, knob: Knob) -> Series:
        """The points, judged: all others against the default, or against the finer picture."""
        default = self._pictures[knob.name, knob.default]
        finer = None if knob.same else self._finer(knob)
        points = []
        for value in knob.values:
            sample, picture = self._samples[knob.name, value], self._pictures[knob.name, value]
            sample.differing = differing_pixels(picture, default)
            if finer is not None:
                sample.errors = picture_errors(picture, finer)
            sample.errors = {**sample.errors, **self._moments.get((knob.name, value), {})}
            points.append(sample.point(knob, value))
        return Series(scene, knob, tuple(points))

    def _finer(self, knob: Knob) -> Codes:
        """FINER^2 samples in each pixel: of finest voxels where the knob changes the voxels, and
        otherwise of those in the picture. No driver averages them."""
        error = 0 if knob.key == "lod.pixel_error" else FINER * PIXEL_ERROR
        self._film({"lod.pixel_error": error, "camera.samples": 1}, 1, FINER)
        return self._picture(0)

    def _film(
        self, changed: Mapping[str, Any], frames: int, finer: int = 1, turn: float = 0.0
    ) -> list[dict[str, Any]]:
        """The lines of frames.jsonl of a camera that turns by so many degrees a frame."""
        settings = {**BASE, **changed}
        lines = [f"{key} = {json.dumps(value)}\n" for key, value in settings.items()]
        (self._folder / "scene.toml").write_text("".join(lines) + LIGHT)
        keys = [
            {"time": time, "azimuth": AZIMUTH + turn * time, "elevation": ELEVATION}
            for time in sorted({0, frames - 1})
        ]
        (self._folder / "path.json").write_text(json.dumps({"fps": 1, "keys": keys}))
        width, height = finer * (self._resolution // 3), finer * (self._resolution // 4)
        done = self._run(
            "--scene", self._folder / "scene.toml", "--path", self._folder / "path.json",
            "--frames", self._folder / "frames", "--size", f"{width}x{height}",
            *(["--sync"] if settings["budget.io"] == "sync" else []), "--force", "--quiet",
        )  # fmt: skip
        _succeeded(done)
        found = (self._folder / "frames" / "frames.jsonl").read_text().splitlines()
        return [json.loads(line) for line in found]

    def _picture(self, number: int) -> Codes:
        """A frame of the last film."""
        return read_picture(self._folder / "frames" / f"frame-{number:05d}.png")

    def _run(self, *options: object) -> CompletedProcess[str]:
        command = [sys.executable, "-P", "-m", "gstream_tools.view_gl", self._file, *options]
        return run([str(part) for part in command], capture_output=True, text=True, check=False)


def _succeeded(done: CompletedProcess[str]) -> str:
    """What the viewer said on stdout."""
    if done.returncode:
        raise GstreamError(f"a run of the viewer failed: {_last_line(done)}")
    return done.stdout


def _last_line(done: CompletedProcess[str]) -> str:
    return (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]


def _up_to(most: int, knob: Knob) -> Knob:
    """Without numbers of samples that the driver does not have."""
    if knob.key != "camera.samples":
        return knob
    return replace(knob, values=tuple(value for value in knob.values if value <= most))
