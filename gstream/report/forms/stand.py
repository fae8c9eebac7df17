"""What a form is measured on, and how: the same triangles for all values, in turns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from time import process_time
from typing import Any

import numpy as np

from gstream.kernels import accumulate, fragments
from gstream.kernels.voxelize import Box, Rules
from gstream.report.truth.scene import Floats, Ints, Scene

SNAP_BITS = 12
TURNS = 5  # of each value in a process; the fastest counts


@dataclass(frozen=True, slots=True)
class Stand:
    """A scene's triangles on the grid of the default."""

    scene: Scene
    resolution: int  # at most 256: everything fits in one box
    voxel_size: float
    origin: Floats  # (3,) world

    @property
    def corners(self) -> Ints:
        """(m, 3, 3) i8 units of 2^-SNAP_BITS voxel."""
        units = (self.scene.points - self.origin) / self.voxel_size * 2.0**SNAP_BITS
        snapped: Ints = np.floor(units + 0.5).astype(np.int64)
        return snapped[self.scene.triangles]

    def centres(self, voxels: Ints) -> Floats:
        """(n, 3) world positions of voxel centres."""
        return (voxels + 0.5) * self.voxel_size + self.origin

    def filled(self, values: Floats) -> tuple[Box, Ints, Ints]:
        """A box with all triangles, and the voxels that `--sep 6` sets in it.

        values : (m, 3, c) channels at the corners
        returns : the box, (n,) rows of its sums, (n,) Morton codes, ascending
        """
        box = Box(values.shape[2])
        box.start(Rules(SNAP_BITS, "6", False, False), 256, (self.resolution,) * 3)
        box.add(self.corners, values)
        rows, codes = box.collect(0, 1, accumulate.HIT)
        return box, rows.astype(np.int64), codes.astype(np.int64)


@dataclass(frozen=True, slots=True)
class Result:
    """One value of a form, measured in one process."""

    value: Any
    seconds: float | None  # CPU; None where the form is not about time
    counts: Mapping[str, int]
    errors: Mapping[str, float] = field(default_factory=dict)


def seconds_of(tasks: Mapping[Any, Callable[[], object]]) -> dict[Any, float]:
    """The least CPU seconds of each task in TURNS turns, all tasks in each turn."""
    best = {name: np.inf for name in tasks}
    for _ in range(TURNS):
        for name, task in tasks.items():
            began = process_time()
            task()
            best[name] = min(best[name], process_time() - began)
    return best


def no_channels(triangles: int) -> Floats:
    """Corner values of a scene without attributes."""
    return np.zeros((triangles, 3, 0))


BUFFER = fragments.BUFFER_FRAGMENTS
