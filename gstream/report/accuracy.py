"""What accuracy costs: every knob turned on every scene, each point in fresh processes.

A point has the median of its runs' CPU seconds, the counts that are the same in all of them, and
its errors against the truth. Runs one after another, so that they do not slow each other.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import blake2b
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gstream.errors import GstreamError, UsageError
from gstream.read import open_block_file
from gstream.report.knobs import (
    BYTES,
    FORM_RESOLUTION,
    Knob,
    fewer,
    knobs,
    settings_at,
)
from gstream.report.results import Plan, Report, Samples, Series
from gstream.report.runs import fresh, prepared
from gstream.report.truth.metrics import (
    Content,
    corners_of,
    differing_bytes,
    differing_voxels,
    errors_of,
    leaks,
    misclassified,
    read_content,
)
from gstream.report.truth.oracle import exact_voxels
from gstream.report.truth.scene import Floats
from gstream.report.truth.scenes import SCENES
from gstream.report.views import NoViewerError, Views
from gstream.run.progress import Progress, StageBegins, StageEnds, UnitDone

SETS = {"small": (("sphere",), 96), "all": (tuple(SCENES), 256)}  # scenes, voxels per axis
FORMS_COST = 4.0  # of the process that measures forms, in those that voxelize
DEFAULT = ("", None)  # the key of the point that turns no knob


def plan_of(scenes: str, file: str | None, names: Sequence[str], runs: int) -> Plan:
    """The plan for `small` or `all` scenes or a file, and the knobs named, or all of them.

    errors : UsageError for a set or a knob that there is not, or no run
    """
    if scenes not in SETS:
        raise UsageError(f"there are no scenes {scenes!r}", f"give one of {', '.join(SETS)}")
    if runs < 1:
        raise UsageError(f"--runs {runs} is out of range", "give 1 or more")
    chosen, resolution = ((file,), FORM_RESOLUTION) if file else SETS[scenes]
    known = {knob.name: knob for knob in knobs(resolution)}
    for name in names:
        if name not in known:
            raise UsageError(f"there is no knob {name!r}", f"give one of {', '.join(known)}")
    turned = [knob for knob in known.values() if not names or knob.name in names]
    if scenes == "small" and not file:  # to end in two minutes: pictures take one more
        turned = [fewer(knob) for knob in turned if names or not knob.key]
    return Plan(chosen, resolution, tuple(turned), runs)


def measure(plan: Plan, progress: Progress, tmp: str | None = None) -> Report:
    """Run the plan; a stage of `progress` for each scene.

    tmp : folder for scratch, removed at the end; None = the system's
    errors : GstreamError where a run fails or its counts cannot be right
    """
    about, series, notes = [], [], []
    for number, name in enumerate(plan.scenes if any(not k.key for k in plan.knobs) else ()):
        with TemporaryDirectory(prefix="gstream-report-", dir=tmp) as folder:
            bench = _Bench(name, plan, Path(folder), progress, first=number == 0)
            series += bench.series()
            about.append(bench.about())
    if any(knob.key for knob in plan.knobs):
        with TemporaryDirectory(prefix="gstream-report-", dir=tmp) as folder:
            try:
                series += Views(plan, Path(folder), progress).series()
            except NoViewerError as error:
                notes.append(f"the viewer's knobs are left out: {error}")
    order = {knob.name: place for place, knob in enumerate(plan.knobs)}
    series.sort(key=lambda one: order[one.knob.name])
    machine = {"processors": os.cpu_count(), "python": sys.version.split()[0]}
    return Report(plan, tuple(about), tuple(series), machine, tuple(notes))


class _Bench:
    """One scene: its stream, the default's file, and the samples so far."""

    def __init__(
        self, name: str, plan: Plan, folder: Path, progress: Progress, *, first: bool
    ) -> None:
        self._plan, self._progress = plan, progress
        self._fineness = 2 * plan.resolution  # of a built-in scene: for the largest resolution
        self._scene, self._stream = prepared(name, self._fineness, folder)
        self._output = folder / "scene.gsb"
        self._samples: dict[tuple[str, Any], Samples] = {}
        self._of_the_set: dict[tuple[int, str, bytes], dict[str, float | None]] = {}
        self._options = [knob for knob in plan.knobs if knob.field]
        forms = [knob for knob in plan.knobs if not (knob.field or knob.key)]
        self._forms = [knob for knob in forms if first or not knob.scene]

    def series(self) -> list[Series]:
        """Every value once, then all of them again: a machine that slows down slows all alike."""
        turned = [(knob, v) for knob in self._options for v in knob.values if v != knob.default]
        units = (1 + len(turned) + bool(self._forms)) * self._plan.runs
        cost = (1 + len(turned) + FORMS_COST * bool(self._forms)) * self._plan.runs
        self._progress(StageBegins(self._scene.name, units, cost))
        self._voxelized({"resolution": 32})  # not counted: it compiles what is not yet cached
        for _ in range(self._plan.runs):
            self._turn_option(None, None)
            for knob, value in turned:
                self._turn_option(knob, value)
            if self._forms:
                self._turn_forms()
        self._progress(StageEnds(self._scene.name, 0.0))
        return [series for knob in self._plan.knobs if (series := self._series(knob)).points]

    def about(self) -> dict[str, Any]:
        return {
            "name": self._scene.name,
            "triangles": len(self._scene.triangles),
            "area": self._scene.area,
            "floor_voxels": self._scene.floor / self._default.voxel_size,
        }

    def _series(self, knob: Knob) -> Series:
        default = self._samples[DEFAULT] if knob.field else None
        found = {value: self._samples.get((knob.name, value), default) for value in knob.values}
        points = [sample.point(knob, value) for value, sample in found.items() if sample]
        return Series(knob.scene or self._scene.name, knob, tuple(points))

    def _turn_option(self, knob: Knob | None, value: Any) -> None:
        """One process of a value; the default comes first, without a knob."""
        changed = {knob.field: value} if knob else {}
        report = self._voxelized(changed)
        counts = _counts(report, self._output)
        key = (knob.name, value) if knob else DEFAULT
        if key in self._samples:
            self._samples[key].add(report["cpu_seconds"], counts)
        else:
            self._samples[key] = samples = Samples(report["cpu_seconds"], counts)
            with open_block_file(self._output) as file:
                content, matrix = read_content(file), file.matrix
            self._check("triangles", counts["triangles"], len(self._scene.triangles))
            self._check("voxels", counts["voxels"], len(content.positions))
            if knob is None:
                self._default = _Default(content, self._output.read_bytes(), matrix)
            samples.errors = self._errors(content, matrix, changed)
            samples.differing = self._differing(knob, content) if knob else 0
        self._progress(UnitDone(self._scene.name, 1.0))

    def _turn_forms(self) -> None:
        """One process of all values of all forms."""
        request = {
            "forms": [knob.name for knob in self._forms],
            "scene": self._scene.name,
            "fineness": self._fineness,
            "stream": str(self._stream),
            "resolution": self._plan.resolution,
            "matrix": self._default.matrix.tolist(),
        }
        for name, results in fresh("gstream.report.forms", request).items():
            for result in results:
                key = (name, result["value"])
                if key in self._samples:
                    self._samples[key].add(result["seconds"], result["counts"])
                else:
                    self._samples[key] = Samples(result["seconds"], result["counts"])
                    self._samples[key].errors = result["errors"]
        self._progress(UnitDone(self._scene.name, FORMS_COST))

    def _voxelized(self, changed: Mapping[str, Any]) -> dict[str, Any]:
        """The report of a process that writes the output with these settings."""
        settings = settings_at(self._plan.resolution, changed)
        request = {
            "stream": str(self._stream), "output": str(self._output), "settings": settings
        }  # fmt: skip
        return dict(fresh("gstream.report.point", request))

    def _errors(
        self, content: Content, matrix: Floats, changed: Mapping[str, Any]
    ) -> dict[str, float]:
        settings = settings_at(self._plan.resolution, changed)
        resolution, sep = settings["resolution"], settings["sep"]
        errors: dict[str, float | None] = asdict(
            errors_of(content, matrix, self._scene, self._default.voxel_size)
        )
        which = (resolution, sep, blake2b(content.positions.tobytes()).digest())
        if which not in self._of_the_set:
            grid = (resolution,) * 3
            exact = exact_voxels(corners_of(self._scene, matrix), sep, (0, 0, 0), grid)
            self._of_the_set[which] = {
                "misclassified": misclassified(content.positions, exact),
                "leaks": leaks(content.positions, self._scene, matrix, grid, sep),
            }
        errors |= self._of_the_set[which]
        return {name: float(error) for name, error in errors.items() if error is not None}

    def _differing(self, knob: Knob, content: Content) -> int:
        if knob.same == BYTES:
            return differing_bytes(self._output.read_bytes(), self._default.data)
        return differing_voxels(content, self._default.content) if knob.same else 0

    def _check(self, what: str, counted: int, expected: int) -> None:
        if counted != expected:
            raise GstreamError(f"{self._scene.name}: {counted} {what} counted, not {expected}")


@dataclass(frozen=True, slots=True)
class _Default:
    """The first run's file, which all others are compared with."""

    content: Content
    data: bytes
    matrix: Floats

    @property
    def voxel_size(self) -> float:
        return float(self.matrix[0, 0])


def _counts(report: Mapping[str, Any], output: Path) -> dict[str, Any]:
    """What a run did and wrote: equal in every run of a point, unlike seconds."""
    stages = {stage["stage"]: stage["counts"] for stage in report["stages"]}
    data = output.read_bytes()
    return {
        "triangles": stages["3-presort"]["triangles"],
        "fragments": stages["4-voxelize"]["fragments"],
        "voxels": stages["4-voxelize"]["voxels"],  # of level 0
        "bytes": len(data),
        "digest": blake2b(data, digest_size=16).hexdigest(),
    }
