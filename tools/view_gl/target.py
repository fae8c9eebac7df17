"""What is drawn to: colour, depth and block numbers, with one sample a pixel or several."""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from .programs import Programs


class Target:
    """Buffers of one size.

    samples : of MSAA
    ids : with a second output of block numbers, one sample only
    programs : where several samples are resolved by
    """

    def __init__(
        self,
        context: moderngl.Context,
        size: tuple[int, int],
        samples: int,
        programs: Programs,
        *,
        ids: bool = False,
    ) -> None:
        self._context = context
        self.size = size
        self.samples = samples
        several = samples if samples > 1 else 0
        self._colour = context.texture(size, 4, samples=several)
        self._depth = context.depth_renderbuffer(size, samples=several)
        self._plain = self._resolved = context.framebuffer([self._colour], self._depth)
        self._resolving: moderngl.VertexArray | None = None
        if several:
            self._resolved = context.simple_framebuffer(size)
            resolve = programs.screen("resolve.frag", {"SAMPLES": samples})
            self._resolving = context.vertex_array(resolve, [])
        self._ids: moderngl.Texture | None = None
        self._with_ids = self._plain
        if ids and not several:
            self._ids = context.texture(size, 1, bytes(size[0] * size[1] * 4), dtype="u4")
            self._ids.filter = moderngl.NEAREST, moderngl.NEAREST
            self._with_ids = context.framebuffer([self._colour, self._ids], self._depth)

    @property
    def ids(self) -> moderngl.Texture:
        """The blocks' numbers, plus one; 0 where there is none, as at the start."""
        if self._ids is None:
            raise ValueError("the target has no block numbers")
        return self._ids

    def use(self, *, ids: bool) -> None:
        """Draw here from now on."""
        (self._with_ids if ids else self._plain).use()

    def clear(self, background: tuple[float, float, float]) -> None:
        """Nothing is drawn: alpha 0, the background's colour, the greatest depth.

        Block numbers are not touched: a buffer of integers has no clear colour, and whoever reads
        them sets them to 0.
        """
        self._plain.clear(*background, 0.0, depth=1.0)

    def lock_depth(self, locked: bool) -> None:
        """Let depths be tested but not written."""
        self._plain.depth_mask = not locked
        self._plain.use()  # masks are set when a framebuffer is bound

    def lock_colour(self, locked: bool) -> None:
        """Let colours be as they are."""
        self._plain.color_mask = (not locked,) * 4
        self._plain.use()

    def resolve(self) -> None:
        """Average the samples of each pixel."""
        if self._resolving is not None:
            self._colour.use(0)
            self._resolved.use()
            self._context.enable_only(moderngl.NOTHING)
            self._resolving.render(moderngl.TRIANGLES, vertices=3)

    def copy_to(self, framebuffer: moderngl.Framebuffer) -> None:
        """The resolved picture into a framebuffer of the same size and form."""
        self._context.copy_framebuffer(framebuffer, self._resolved)

    def pixels(self) -> NDArray[np.uint8]:
        """(height, width, 4) the picture, its first row on top; alpha is what was covered."""
        width, height = self.size
        data = self._resolved.read(components=4)
        return np.frombuffer(data, np.uint8).reshape(height, width, 4)[::-1]

    def release(self) -> None:
        """Give the buffers back."""
        for buffer in {self._plain, self._resolved, self._with_ids}:
            buffer.release()
        for image in (self._colour, self._depth, self._ids):
            if image is not None:
                image.release()
