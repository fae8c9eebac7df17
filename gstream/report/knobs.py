"""The knobs: options of `gstream voxelize`, the values tried, and what each may change."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

BYTES, VOXELS = "bytes", "voxels"  # what must stay equal under a lossless knob


@dataclass(frozen=True, slots=True)
class Knob:
    """One option; all others stay at their defaults while it is turned."""

    name: str
    field: str  # of VoxelizeSettings or RunOptions
    values: tuple[Any, ...]
    error: str = ""  # the field of metrics.Errors that judges it; empty: it must be lossless
    same: str = ""  # of a lossless knob: BYTES or VOXELS

    @property
    def option(self) -> str:
        """As a user writes it."""
        return f"--{self.name}"


UNITS = {
    "distance_rms": "distance to the surface, rms, voxels of the default",
    "normal_mean": "angle to the true normal, mean, degrees",
    "area": "area missing or too much, part of all",
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
    return (
        Knob("resolution", "resolution", sizes, error="distance_rms"),
        Knob("sep", "sep", ("6", "26", "conservative"), error="area"),
        Knob("snap-bits", "snap_bits", (2, 4, 6, 8, 12), error="normal_mean"),
        Knob("normal-bits", "normal_bits", (8, 9, 10, 11, 12), error="normal_mean"),
        Knob("block", "block", (32, 64, 128), same=VOXELS),
        Knob("lz4", "lz4", ("fast", "hc"), same=VOXELS),
        Knob("workers", "workers", (0, 2), same=BYTES),
        Knob("memory", "memory", (1 << 30, 2 << 30), same=BYTES),
        Knob("cell", "cell", (64, 256), same=BYTES),
    )


def fewer(knob: Knob, resolution: int) -> Knob:
    """The knob at its first, default and last value: starting a process takes 2 s."""
    wanted = {knob.values[0], defaults(resolution)[knob.field], knob.values[-1]}
    return replace(knob, values=tuple(value for value in knob.values if value in wanted))


def shown(field: str, value: Any) -> str:
    """A value as a user writes it."""
    return f"{value >> 30}GiB" if field == "memory" else str(value)


def settings_at(resolution: int, changed: Mapping[str, Any]) -> dict[str, Any]:
    """All settings of one point, by field."""
    return {**defaults(resolution), **changed}
