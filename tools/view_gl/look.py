"""What a scene looks like, as uniforms: lights, surface, stencils."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..reader_py import BlockFile
from ..scene import Scene

Floats = NDArray[np.float64]

# Levels in turn, for the picture that shows them: Okabe and Ito's colours, told apart by everyone.
TINTS = ((0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (213, 94, 0))


def linear(colour: tuple[float, ...]) -> tuple[float, ...]:
    """sRGB components, 0 to 1, in linear light (IEC 61966-2-1)."""
    return tuple(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour)


def uniforms(scene: Scene, file: BlockFile, origin: NDArray[np.int64]) -> dict[str, Any]:
    """The uniforms of voxel.vert, shade.glsl and stencil.glsl, places relative to `origin`."""
    world = file.matrix[:, :3]
    start = world @ origin + file.matrix[:, 3]
    lights, intensities = [], []
    for light in in_order(scene):
        if light.kind == "directional":
            towards = -np.array(light.direction)
            lights += [*(towards / np.linalg.norm(towards)).tolist(), 0.0]
        else:
            lights += [*(np.array(light.position) - start).tolist(), 1.0]
        intensities += [light.intensity * c for c in linear(light.colour)]
    flat = scene.shade.model == "flat"
    return {
        "world": np.ascontiguousarray(world.T, dtype=np.float32).tobytes(),
        "lights": np.array(lights, np.float32).tobytes(),
        "intensities": np.array(intensities, np.float32).tobytes(),
        "ambient": 1.0 if flat else scene.ambient,
        "specular": (scene.shade.specular, scene.shade.shininess),
        "plain": tuple(scene.shade.colour),
        "tints": (np.array(TINTS, np.float32) / 255).tobytes(),
        **_stencils(scene, file, origin),
    }


def in_order(scene: Scene) -> list[Any]:
    """The scene's lights, those with shadows first: they have the first maps."""
    return sorted(scene.lights, key=lambda light: not light.shadows)


def _stencils(scene: Scene, file: BlockFile, origin: NDArray[np.int64]) -> dict[str, bytes]:
    """Stencils in the world, relative to the origin's place in it."""
    start = file.matrix[:, :3] @ origin + file.matrix[:, 3]
    spheres, boxes = [], []
    for stencil in scene.dynamic.stencil:
        if stencil.kind == "sphere":
            spheres += [*(np.array(stencil.centre) - start).tolist(), stencil.radius]
            boxes += [0.0, 0.0, 0.0]
        else:
            half = np.array(stencil.size) / 2
            spheres += [*(np.array(stencil.low) + half - start).tolist(), 0.0]
            boxes += half.tolist()
    return {
        "cut_spheres": np.array(spheres, np.float32).tobytes(),
        "cut_boxes": np.array(boxes, np.float32).tobytes(),
    }
