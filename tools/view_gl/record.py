"""Pictures without a window: one of a scene, or one for every frame of a camera script."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from time import monotonic, process_time
from typing import Any

from . import offscreen
from .camera import Camera
from .frame import Frame, Renderer
from .script import Script
from .session import Session

MAX_FRAMES = 1000  # of one picture: a still camera takes as many as the tree has levels, and a few
QUIET_SECONDS = 2.0  # nothing is said of what is over sooner


class Pace:
    """Says on stderr how far something is, at most once in two seconds."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._start = self._last = monotonic()

    @property
    def seconds(self) -> float:
        """Since the start."""
        return monotonic() - self._start

    def says(self, text: str, done: int = 0, total: int = 0) -> None:
        """text : what is done; done, total : of equal parts, which tell the time left"""
        now = monotonic()
        if self._quiet or now - self._last < QUIET_SECONDS:
            return
        self._last = now
        if done:
            text += f", {self.seconds * (total - done) / done:,.0f} s left"
        print(f"view_gl: {text}", file=sys.stderr, flush=True)


def picture(renderer: Renderer, camera: Camera, path: str, pace: Pace) -> dict[str, Any]:
    """Draw until nothing changes any more, and write the picture; what was drawn."""
    for number, frame in enumerate(_settling(renderer, camera), 1):
        pace.says(f"frame {number}: {frame.blocks:,} blocks, {frame.voxels:,} voxels")
    renderer.target.pixels()  # waits for the driver
    seconds = pace.seconds
    offscreen.save(renderer.picture(), path)
    return {
        "picture": path,
        "size": list(renderer.target.size),
        "samples": renderer.target.samples,
        "frames": number,
        **drawn(renderer, frame),
        "levels": renderer.file.levels,
        "file_bytes": renderer.file.file_bytes,
        "seconds": round(seconds, 3),
    }


def film(
    session: Session, renderer: Renderer, script: Script, folder: Path, sync: bool, pace: Pace
) -> None:
    """Write frame-00000.png and so on, and a line of frames.jsonl for each.

    sync : each frame is drawn until nothing changes any more; otherwise as a viewer would see it
    errors : OSError, and those of the file
    """
    width, height = renderer.target.size
    uploaded = 0  # the first frame has what was there before, too
    with (folder / "frames.jsonl").open("w", encoding="utf-8") as lines:
        for number in range(script.frames):
            camera = script.camera(number, session, width / height)
            start, worked = monotonic(), process_time()
            frames = _settling(renderer, camera) if sync else [renderer.frame(camera)]
            frame = _last(frames)
            pixels = renderer.picture()
            line = {
                "frame": number,
                "time": float(script.times[0]) + number / script.fps,
                **drawn(renderer, frame),
                "uploaded": renderer.uploaded - uploaded,
                "milliseconds": round(1000 * (monotonic() - start), 3),
                "cpu_milliseconds": round(1000 * (process_time() - worked), 3),
            }
            offscreen.save(pixels, folder / f"frame-{number:05d}.png")
            lines.write(json.dumps(line) + "\n")
            lines.flush()
            uploaded = renderer.uploaded
            pace.says(f"frame {number + 1} of {script.frames}", number + 1, script.frames)


def drawn(renderer: Renderer, frame: Frame) -> dict[str, Any]:
    """What a frame showed, and what was read of the file until then."""
    source = renderer.file.source
    return {**asdict(frame), "read_bytes": source.bytes, "requests": source.requests}


def _settling(renderer: Renderer, camera: Camera) -> Iterator[Frame]:
    for _ in range(MAX_FRAMES):
        frame = renderer.frame(camera)
        yield frame
        if frame.converged:
            return


def _last(frames: Iterable[Frame]) -> Frame:
    for frame in frames:
        last = frame
    return last
