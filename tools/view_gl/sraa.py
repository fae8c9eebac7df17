"""Subpixel reconstruction (Chajdas 2014, 4.10): numbers of voxels at each sample, shading at one.

Primitives have no identity in a picture; voxels have. Their numbers in the pool are drawn, and
those of their blocks' records, so that a sample finds its own voxel among those that were shaded.
"""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from .programs import Programs

NUMBERS, SHADED = 1, 2  # texture units; 0 has the lights' maps


class DeferredTarget:
    """What `target.Target` is to colours, for voxels' numbers; resolved, a picture like its own."""

    def __init__(
        self, context: moderngl.Context, size: tuple[int, int], samples: int, programs: Programs
    ) -> None:
        self._context = context
        self.size, self.samples = size, samples
        self._numbers = context.texture(size, 2, samples=samples, dtype="u4")
        self._plain = context.framebuffer(
            [self._numbers], context.depth_renderbuffer(size, samples=samples)
        )
        self._shaded = context.texture(size, 4)
        self._half = context.framebuffer([self._shaded])
        self._whole = context.simple_framebuffer(size)
        self._background = (0.0, 0.0, 0.0)
        self._clearing = context.vertex_array(programs.screen("cleared.frag", {}), [])

    def use(self, *, ids: bool = False) -> None:
        """Draw here from now on."""
        self._plain.use()

    def clear(self, background: tuple[float, float, float]) -> None:
        """No voxel anywhere: a buffer of integers has no clear colour, so 0 is drawn."""
        self._background = background
        self._plain.use()
        self._plain.clear(depth=1.0)
        self._context.enable_only(moderngl.NOTHING)
        self._clearing.render(moderngl.TRIANGLES, vertices=3)

    def lock_depth(self, locked: bool) -> None:
        """Let depths be tested but not written."""
        self._plain.depth_mask = not locked
        self._plain.use()

    def lock_colour(self, locked: bool) -> None:
        """Let numbers be as they are."""
        self._plain.color_mask = (not locked,) * 4
        self._plain.use()

    def shade(self, program: moderngl.VertexArray) -> None:
        """Shade the voxel of each pixel's first sample."""
        self._numbers.use(NUMBERS)
        self._half.use()
        self._context.enable_only(moderngl.NOTHING)
        program.render(moderngl.TRIANGLES, vertices=3)

    def reconstruct(self, program: moderngl.VertexArray) -> None:
        """Give each sample its voxel's colour, and each pixel the mean of its samples."""
        self._numbers.use(NUMBERS)
        self._shaded.use(SHADED)
        self._whole.use()
        self._context.enable_only(moderngl.NOTHING)
        program.render(moderngl.TRIANGLES, vertices=3)

    @property
    def background(self) -> tuple[float, float, float]:
        """The colour of what no voxel covers."""
        return self._background

    def resolve(self) -> None:
        """Nothing is left to do: `reconstruct` was the last pass."""

    def copy_to(self, framebuffer: moderngl.Framebuffer) -> None:
        """The picture into a framebuffer of the same size and form."""
        self._context.copy_framebuffer(framebuffer, self._whole)

    def pixels(self) -> NDArray[np.uint8]:
        """(height, width, 4) the picture, its first row on top; alpha is what was covered."""
        width, height = self.size
        data = self._whole.read(components=4)
        return np.frombuffer(data, np.uint8).reshape(height, width, 4)[::-1]

    def release(self) -> None:
        """Give the buffers back."""
        for made in (self._plain, self._half, self._whole, self._numbers, self._shaded):
            made.release()
