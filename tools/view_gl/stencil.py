"""Voxels that stencils cut out (Chajdas 2014, 4.9), in three places that give the same picture.

For what is cut once, before the upload: nothing of it is stored. For what changes at times, in the
pool's memory: masks become 0. For a stencil that moves with each frame, in the vertex shader.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..scene import Scene

Where = Literal["upload", "memory", "shader"]
Words = NDArray[np.uint32]


def without_cut(
    words: Words, scene: Scene, matrix: NDArray[np.float64], corner: NDArray[np.int64], level: int
) -> Words:
    """The voxels of a block whose centre lies in no stencil; at least one, with no faces.

    words : (n, stride); corner : (3,) of the block, in voxels of its level
    matrix : (3, 4), grid to world
    """
    codes = words[:, :1] >> np.array([0, 8, 16], np.uint32) & np.uint32(255)
    centre = (codes + corner + 0.5) * 2.0**level
    place = centre @ matrix[:, :3].T + matrix[:, 3]
    cut = np.zeros(len(words), np.bool_)
    for stencil in scene.dynamic.stencil:
        if stencil.kind == "sphere":
            away = place - np.array(stencil.centre)
            cut |= (away * away).sum(axis=1) <= stencil.radius**2
        else:
            low = np.array(stencil.low)
            cut |= ((place >= low) & (place <= low + np.array(stencil.size))).all(axis=1)
    if cut.all():
        first = words[:1].copy()
        first[0, 0] &= 0xFFFFFF  # a pool has no blocks of nothing
        return first
    return words[~cut]
