"""Deformations of spec/scene.md 2.6 in grid coordinates: what they do to boxes; uniforms."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scene import Scene

Floats = NDArray[np.float64]
AXES = "xyz"


@dataclass(frozen=True, slots=True)
class Deformation:
    """p goes to p + shear (p - pivot) + wave · sin(waves · (p - pivot) + phase).

    Lengths in finest voxels. Of a scene without one, shear and wave are 0.
    """

    pivot: Floats  # (3,)
    shear: Floats  # (3, 3)
    wave: Floats  # (3,)
    waves: Floats  # (3,) radians for each finest voxel
    phase: float

    @staticmethod
    def of(scene: Scene, kind: int, matrix: Floats, box: Floats) -> Deformation:
        """A scene's.

        kind : 0 none, 1 shear, 2 wave
        matrix : (3, 4), grid to world
        box : (2, 3) of the source, in the world
        """
        dynamic, linear = scene.dynamic, matrix[:, :3]
        inverse = np.linalg.inv(linear)
        pivot = inverse @ (box.mean(axis=0) - matrix[:, 3])
        shear, wave = np.zeros((3, 3)), np.zeros((3,))
        waves = linear[AXES.index(dynamic.along)] * (2 * pi / dynamic.wavelength)
        if kind == 1:
            shear = inverse @ np.array(dynamic.matrix) @ linear - np.eye(3)
        if kind == 2:
            wave = np.asarray(inverse[:, AXES.index(dynamic.axis)] * dynamic.amplitude)
        return Deformation(pivot, shear, wave, waves, radians(dynamic.phase))

    def boxes(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Boxes (n, 3) around what was in boxes."""
        centre = (low + high) / 2
        half = (high - low) / 2 @ np.abs(np.eye(3) + self.shear).T + np.abs(self.wave)
        centre = centre + (centre - self.pivot) @ self.shear.T  # exact where there is no shear
        return centre - half, centre + half

    @property
    def stretch(self) -> float:
        """By how much a length grows at most."""
        longest = float(np.linalg.norm(np.eye(3) + self.shear, 2))
        return longest + float(np.linalg.norm(self.wave) * np.linalg.norm(self.waves))

    def slack(self, edge: float) -> float:
        """How far a displaced point of a cube may be outside the hull of its displaced corners.

        The second derivative along a line is at most |wave| |waves|², and the cube's diagonal its
        length: linear interpolation errs by an eighth of their product, for each of three axes.
        """
        return float(3 / 8 * np.linalg.norm(self.wave) * (self.waves @ self.waves) * edge * edge)

    def uniforms(self, origin: NDArray[np.int64]) -> dict[str, Any]:
        """Those of common.glsl."""
        return {
            "shear": np.ascontiguousarray(self.shear.T, dtype=np.float32).tobytes(),
            "pivot": tuple((self.pivot - origin).tolist()),
            "wave": tuple(self.wave.tolist()),
            "waves": tuple(self.waves.tolist()),
            "phase": self.phase,
            "slack": self.slack(1.0),
        }
