"""The maps of the lights that cast shadows: depths of the scene as each of them sees it.

What is drawn is a cut like the camera's, made for the light's own view, so that nothing the camera
does not see loses its shadow. Voxels do not depend on the view (Chajdas 2014, 4.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan, degrees
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from ..scene import Scene, SceneError
from .camera import Camera, View
from .look import in_order

Floats = NDArray[np.float64]

MOST = 4096  # pixels of a map's side
BIAS = 1.5  # of a texel or voxel: a surface of voxels is a staircase, and must not shade itself


class Maps:
    """Depth maps side by side in one texture; a side has at least the picture's pixels."""

    def __init__(self, context: moderngl.Context, count: int, size: tuple[int, int]) -> None:
        self.side = min(1 << (max(size) - 1).bit_length(), MOST)
        self.depths = context.depth_texture((self.side * count, self.side))
        self.depths.compare_func = "<="
        self.depths.repeat_x = self.depths.repeat_y = False
        self.frame = context.framebuffer(depth_attachment=self.depths)

    def release(self) -> None:
        """Give the buffers back."""
        self.frame.release()
        self.depths.release()


def views(
    scene: Scene, count: int, side: int, matrix: Floats, world: Floats, box: Floats
) -> list[View]:
    """The view of each of the first `count` lights over all that is drawn, in maps of that side.

    matrix : (3, 4), grid to world; world, box : (2, 3), what is drawn, in world and in grid
    errors : SceneError for a point light among what it lights: one map does not see all around it
    """
    centre = world.mean(axis=0)
    reach = float(np.linalg.norm(world[1] - world[0])) / 2
    made = []
    for i, light in enumerate(in_order(scene)[:count]):
        if light.kind == "directional":
            back = -np.array(light.direction) / np.linalg.norm(light.direction)
            camera = Camera(_point(centre + back * reach * 2), _point(centre), height=2 * reach)
        else:
            place = np.array(light.position)
            distance = float(np.linalg.norm(place - centre))
            if distance <= reach * 1.01:
                said = "a point light within what it lights has shadows all around"
                raise SceneError(scene.path, f"light[{i}].shadows", said, "move it outside")
            fov = 2 * degrees(atan(reach / np.sqrt(distance**2 - reach**2)))
            camera = Camera(_point(place), _point(centre), fov=fov)
        made.append(View.of(camera, (side, side), matrix, box))
    return made


def uniforms(
    lights: Sequence[View], edges: Sequence[float], origin: NDArray[np.int64]
) -> dict[str, Any]:
    """What shade.glsl needs; edges : of each light, the longest edge of a voxel in its map."""
    if not lights:
        return {}
    bias = [BIAS * max(edge, 1.0) for edge in edges]
    return {
        "light_clip": b"".join(view.local(origin).tobytes() for view in lights),
        "light_bias": np.array(bias, np.float32).tobytes(),
    }


def _point(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return (x, y, z)
