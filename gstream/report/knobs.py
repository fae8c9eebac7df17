"""The knobs: what is turned, the values tried, and what each may change.

Most are options of `gstream voxelize`. The others are forms of a step that the program does not
offer, measured so that the price of the one it has can be read; the last are the viewer's.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

BYTES, VOXELS, PIXELS = "bytes", "voxels", "pixels"  # what stays equal under a lossless knob
FORM_RESOLUTION = 256  # the most voxels per axis of forms: they fill one box


@dataclass(frozen=True, slots=True)
class Knob:
    """One thing to turn; all others stay at their defaults."""

    name: str
    values: tuple[Any, ...]
    default: Any
    error: str = ""  # the error that judges it; empty: it must be lossless
    same: str = ""  # of a lossless knob: BYTES, VOXELS or PIXELS
    field: str = ""  # of VoxelizeSettings or RunOptions
    key: str = ""  # of a scene (spec/scene.md): the viewer's; without field and key: a form
    costs: tuple[str, ...] = ("seconds", "bytes")
    scene: str = ""  # a form that brings its own

    @property
    def title(self) -> str:
        """As a user writes it, or says it."""
        if self.key:
            return f"{self.key} of a scene that is viewed"
        return f"--{self.name}" if self.field else f"{self.name} (no option)"


UNITS = {
    "distance_rms": "distance to the surface, rms, voxels of the default",
    "normal_mean": "angle to the true normal, mean, degrees",
    "area": "area missing or too much, part of all",
    "misclassified": "voxels set or left out wrongly",
    "colour_mean": "distance from the true colour, mean, codes of 8 bits",
    "faces_missing": "surface without a face, part of all as seen along the axes",
    "order": "voxels that the order of triangles changes",
    "image_rms": "pixels that show the object, rms, codes of 8 bits",
    "edge_rms": "pixels that the object covers partly, rms, codes of 8 bits",
}


def defaults(resolution: int) -> dict[str, Any]:
    """What every point starts from: the program's own defaults, weights, and this process alone.

    Weights are kept so that the area can be judged; they are in every count of bytes.
    """
    return {
        "resolution": resolution,
        "sep": "6",
        "snap_bits": 12,
        "normal_bits": 11,
        "block": 64,
        "lz4": "fast",
        "workers": 0,
        "memory": 2 << 30,
        "cell": 256,
        "keep_weights": True,
    }


def knobs(resolution: int) -> tuple[Knob, ...]:
    """Every knob with its values, about a default of `resolution` voxels per axis."""
    sizes = tuple(resolution * 2**step // 4 for step in range(4))
    base = defaults(resolution)

    def option(name: str, values: tuple[Any, ...], error: str = "", same: str = "") -> Knob:
        field = name.replace("-", "_")
        return Knob(name, values, base[field], error, same, field)

    return (
        option("resolution", sizes, error="distance_rms"),
        option("sep", ("6", "26", "conservative"), error="area"),
        option("snap-bits", (2, 4, 6, 8, 12), error="misclassified"),
        Knob("classification", ("float32", "float64", "exact"), "exact", "misclassified",
             costs=("seconds",)),
        Knob("sums", ("float32", "float64", "int64"), "int64", "order"),
        option("normal-bits", (8, 9, 10, 11, 12), error="normal_mean"),
        Knob("colour-bits", (4, 5, 6, 7, 8, 10), 8, "colour_mean", costs=("bytes",)),
        Knob("face-threshold", (0.0, 0.02, 0.05, 0.1, 0.2), 0.0, "faces_missing",
             costs=("faces",)),
        Knob("lod-weight", ("count", "area", "area, never rounded"), "area", "normal_mean"),
        Knob("lod-codes", ("8", "9", "10", "11", "12", "once"), "11", "normal_mean",
             scene="strands"),
        option("block", (32, 64, 128), same=VOXELS),
        option("lz4", ("fast", "hc"), same=VOXELS),
        option("workers", (0, 2), same=BYTES),
        option("memory", (1 << 30, 2 << 30), same=BYTES),
        option("cell", (64, 256), same=BYTES),
        Knob("pixel-error", (8, 4, 2, 1, 0.5, 0.25), 1, "image_rms", key="lod.pixel_error",
             costs=("seconds", "bytes", "voxels")),
        Knob("samples", (1, 2, 4, 8), 4, "edge_rms", key="camera.samples", costs=("seconds",)),
        Knob("sraa", (False, True), False, "edge_rms", key="camera.sraa", costs=("seconds",)),
        Knob("occlusion", (False, True), True, same=PIXELS, key="budget.occlusion",
             costs=("seconds", "bytes", "voxels")),
        Knob("refine", ("partial", "closed"), "closed", same=PIXELS, key="budget.refine",
             costs=("frames", "largest")),
        Knob("upload-per-frame", (1 << 24, 1 << 20, 1 << 18, 1 << 16), 1 << 20, same=PIXELS,
             key="budget.upload_per_frame", costs=("frames", "largest")),
    )  # fmt: skip


def fewer(knob: Knob) -> Knob:
    """An option at its first, default and last value, a lossless one at two of these: starting a
    process takes 2 s."""
    if not (knob.field or knob.key):
        return knob
    wanted = {knob.values[0], knob.default, knob.values[-1]}
    if knob.same and len(wanted) > 2:
        wanted.remove(knob.values[0])
    return replace(knob, values=tuple(value for value in knob.values if value in wanted))


def shown(knob: Knob, value: Any) -> str:
    """A value as a user writes it."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if knob.name == "upload-per-frame":
        return f"{value >> 10}KiB"
    return f"{value >> 30}GiB" if knob.field == "memory" else str(value)


def settings_at(resolution: int, changed: Mapping[str, Any]) -> dict[str, Any]:
    """All settings of one point, by field."""
    return {**defaults(resolution), **changed}
