"""The passes of a frame over the blocks that the cut names, as `spec/effects.toml` orders them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from ..reader_py import BlockFile
from .buffers import PoolBuffer
from .camera import View
from .hybrid import SourceTriangles
from .programs import CUT_GROUP, FLAG_GROUP, Programs
from .shadow import Maps
from .sraa import NUMBERS, SHADED, DeferredTarget
from .stencil import Where
from .target import Target
from .tree import Nodes, Tree

Words = NDArray[np.uint32]
SPRITE_PIXELS = 24.0  # larger voxels are drawn as faces: points have a greatest size
COMMAND = 5  # words of an indirect command: four, and one that moderngl's stride has


@dataclass(frozen=True, slots=True)
class Appearance:
    """What the defines of a program need beside the camera, by uniform's name."""

    values: Mapping[str, bytes | float | int | bool | tuple[float, ...]]


class Painter:
    """The programs of one scene, and the passes that they make.

    defines : what `gstream_tools.scene.resolve` gives for the scene and file
    columns : the words of a voxel behind its first, in order: normal, colour
    """

    def __init__(
        self,
        context: moderngl.Context,
        voxels: PoolBuffer,
        defines: Mapping[str, int],
        columns: Sequence[str],
        file: BlockFile,
        cut: Where = "shader",
    ) -> None:
        self._context = context
        self._voxels = voxels
        self._defines = dict(defines)
        if "STENCIL" in defines:
            self._defines["CUT_HERE"] = int(cut == "shader")
        self._layout = ["voxel", *columns]
        self._fixed = {
            "last": (1 << file.block_log2) - 1,
            "normal_bits": file.normal_bits,
            # 6-separating voxels leave out slivers of the surface, and with them the faces of steps
            # that those alone were turned to: 11 holes in 30 pictures of a bumpy torus.
            "whole": file.separability == 6,
        }
        self.programs = Programs(context)
        self._made: dict[str, tuple[moderngl.Program, moderngl.VertexArray | None]] = {}
        self._commands = context.buffer(reserve=COMMAND * 4, dynamic=True)
        self._records = context.buffer(reserve=24, dynamic=True)
        self._pieces = context.buffer(reserve=COMMAND * 4, dynamic=True)
        self._flags = context.buffer(reserve=4, dynamic=True)
        self._flagging: moderngl.ComputeShader | None = None
        self._cutting: moderngl.ComputeShader | None = None
        self.passes: list[str] = []  # of the last frame, in order

    def begin(self, tree: Tree, lists: Sequence[Nodes], origin: NDArray[np.int64]) -> None:
        """Write what is to be drawn; blocks are numbered through all lists, for their flags.

        lists : rows of the tree: drawn, probes, drawn as source triangles, then those of each light
        """
        self.passes.clear()
        nodes = np.concatenate(lists)
        places = [self._voxels.pool.place(int(node)) or (0, 0) for node in nodes]
        commands = np.zeros((len(nodes), COMMAND), np.uint32)
        commands[:, 1] = 1
        commands[:, 3] = np.arange(len(nodes))
        if len(nodes):
            commands[:, [2, 0]] = places
        records = np.empty((len(nodes), 6), np.int32)
        level = tree.level[nodes]
        records[:, :3] = (tree.corner[nodes] << level[:, None]) - origin
        records[:, 3] = level
        records[:, 4] = np.arange(len(nodes))
        records[:, 5] = np.repeat(np.arange(len(lists)), [len(part) for part in lists])
        self._commands = self._write(self._commands, commands)
        self._records = self._write(self._records, records)
        if "OCCLUSION" in self._defines:
            self._flags = self._write(self._flags, np.zeros(max(len(nodes), 1), np.uint32))

    def _write(self, buffer: moderngl.Buffer, data: NDArray[np.generic]) -> moderngl.Buffer:
        """Fill a buffer; a larger one if need be, for which the programs' arrays are made anew."""
        if data.nbytes > buffer.size:
            buffer.release()
            buffer = self._context.buffer(reserve=2 * data.nbytes, dynamic=True)
            self._made = {name: (program, None) for name, (program, _) in self._made.items()}
        else:
            buffer.orphan()
        if data.nbytes:
            buffer.write(np.ascontiguousarray(data).tobytes())
        return buffer

    def cut(self, block: int, level: int, look: Appearance) -> None:
        """Clear the masks of a block's voxels that stencils cut out, in the pool's memory.

        look : with places relative to the block's corner
        """
        if self._cutting is None:
            defines = {"STENCIL": self._defines["STENCIL"], "STRIDE": len(self._layout)}
            self._cutting = self.programs.compute(("common", "stencil", "cut.comp"), defines)
        start, count = self._voxels.pool.place(block) or (0, 0)
        values = {**look.values, "run": (start, count), "block": (0, 0, 0, level)}
        _assign(self._cutting, values)
        self._voxels.buffer.bind_to_storage_buffer(2)
        self._cutting.run(-(-count // CUT_GROUP))
        self._context.memory_barrier(moderngl.ALL_BARRIER_BITS)

    def voxels(
        self, target: Target | DeferredTarget, view: View, origin: NDArray[np.int64], count: int,
        look: Appearance,
        largest: float,
    ) -> None:  # fmt: skip
        """The first `count` blocks, with colour.

        largest : a voxel's edge in pixels, at most
        """
        self.passes.append("voxels")
        sprites = target.samples == 1 and "DEFORM" not in self._defines and largest <= SPRITE_PIXELS
        form = "sprites" if sprites else "faces"
        target.use(ids=sprites and "OCCLUSION" in self._defines)
        context = self._context
        context.enable_only(moderngl.DEPTH_TEST | moderngl.PROGRAM_POINT_SIZE)
        context.depth_func = "<="
        self._run(form, view, origin, target.size, 0, count, look)
        if sprites and "OCCLUSION" in self._defines and isinstance(target, Target):
            self._flag(target)

    def geometry(
        self, target: Target | DeferredTarget, view: View, origin: NDArray[np.int64],
        source: SourceTriangles, blocks: Mapping[int, int], look: Appearance,
    ) -> None:  # fmt: skip
        """Source triangles, before all voxels: they are at least as near (thesis, 4.5.2).

        blocks : the number of each block among all that `begin` was given
        """
        self.passes.append("geometry")
        if not blocks:
            return
        commands = np.zeros((len(blocks), COMMAND), np.uint32)
        for row, (node, number) in zip(commands, blocks.items(), strict=True):
            first, count = source.triangles.pool.place(node) or (0, 0)
            base, _ = source.vertices.pool.place(node) or (0, 0)
            row[:] = 3 * count, 1, 3 * first, base, number
        self._pieces = self._write(self._pieces, commands)
        program, array = self._made.get("pieces") or (self.programs.pieces(self._defines), None)
        if array is None:
            used = ["place", *(["tone"] if "tone" in program else [])]
            layout = "3f 4f1" if "tone" in program else "3f 4x"
            array = self._context.vertex_array(
                program,
                [(source.vertices.buffer, layout, *used), self._block_inputs(program)],
                source.triangles.buffer,
            )
            self._made["pieces"] = program, array
        target.use(ids=False)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = "<="
        self._set(program, view, origin, target.size, look.values)
        self._flags.bind_to_storage_buffer(0)
        array.render_indirect(self._pieces, moderngl.TRIANGLES, len(blocks))

    def _block_inputs(self, program: moderngl.Program) -> tuple[Any, ...]:
        if "draw" in program:
            return self._records, "4i 2u/i", "block", "draw"
        return self._records, "4i 8x/i", "block"

    def probes(
        self, target: Target | DeferredTarget, view: View, origin: NDArray[np.int64],
        first: int, count: int,
        fresh: int, look: Appearance,
    ) -> None:  # fmt: skip
        """Blocks that stand for occluded children: tested, and flagged where they pass.

        fresh : so many of them, the first ones, may be in sight by now: they also fill pixels that
            nothing else covers, until their children are drawn
        """
        if count == 0:
            return
        self.passes.append("probes")
        context = self._context
        target.use(ids=False)
        target.lock_depth(True)
        context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        context.blend_func = moderngl.ONE_MINUS_DST_ALPHA, moderngl.DST_ALPHA
        # A probe's face may lie in that of what it stands for, which nearly passes: not behind it.
        context.polygon_offset = -1.0, -1.0
        if "SRAA" in self._defines:
            fresh = 0  # numbers do not blend
        self._run("faces", view, origin, target.size, first, fresh, look)
        target.lock_colour(True)
        self._run("probes", view, origin, target.size, first + fresh, count - fresh, look)
        target.lock_colour(False)
        target.lock_depth(False)
        context.polygon_offset = 0.0, 0.0

    def shade(
        self, target: DeferredTarget, view: View, origin: NDArray[np.int64], look: Appearance
    ) -> None:
        """Colours of a target of numbers: one for each pixel, then each sample's."""
        self.passes.append("shade")
        stride = {"STRIDE": len(self._layout)}
        self._context.memory_barrier(moderngl.ALL_BARRIER_BITS)
        for name, draw in (
            ("numbered.frag", target.shade),
            ("reconstruct.frag", target.reconstruct),
        ):
            if name not in self._made:
                made = self.programs.screen(name, self._defines | stride)
                self._made[name] = made, self._context.vertex_array(made, [])
            program, array = self._made[name]
            if array is None:
                array = self._context.vertex_array(program, [])
                self._made[name] = program, array
            textures = {"depths": 0, "numbers": NUMBERS, "shaded": SHADED}
            values = {"background": target.background, **textures}
            self._set(program, view, origin, target.size, {**values, **look.values})
            self._records.bind_to_storage_buffer(1)
            self._voxels.buffer.bind_to_storage_buffer(2)
            draw(array)

    def shadows(
        self, maps: Maps, views: Sequence[View], origin: NDArray[np.int64],
        counts: Sequence[tuple[int, int]], look: Appearance,
    ) -> None:  # fmt: skip
        """Depths as the lights see them, side by side.

        counts : of each light, the number of its first block and how many there are
        """
        self.passes.append("shadow")
        maps.frame.use()
        maps.frame.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = "<="
        for i, (view, (first, count)) in enumerate(zip(views, counts, strict=True)):
            maps.frame.viewport = (i * maps.side, 0, maps.side, maps.side)
            self._run("shadow", view, origin, (maps.side, maps.side), first, count, look)

    def flags(self, count: int) -> NDArray[np.bool_]:
        """(count,) which blocks had a fragment that passed the depth test, by their number."""
        # Without the barrier the read comes before the writes: all flags were 0 in llvmpipe.
        self._context.memory_barrier(moderngl.ALL_BARRIER_BITS)
        if count == 0:
            return np.zeros(0, np.bool_)
        flags: NDArray[np.uint32] = np.frombuffer(self._flags.read(count * 4), np.uint32)
        return flags.astype(np.bool_)

    def _run(
        self, name: str, view: View, origin: NDArray[np.int64], size: tuple[int, int],
        first: int, count: int, look: Appearance,
    ) -> None:  # fmt: skip
        if count == 0:
            return
        program, array = self._made.get(name) or (self._compile(name), None)
        if array is None:
            array = self._array(program)
            self._made[name] = program, array
        self._set(program, view, origin, size, look.values)
        self._flags.bind_to_storage_buffer(0)
        array.render_indirect(self._commands, moderngl.POINTS, count, first)

    def _set(
        self, program: moderngl.Program, view: View, origin: NDArray[np.int64],
        size: tuple[int, int], more: Mapping[str, Any],
    ) -> None:  # fmt: skip
        """Give a program the uniforms that it has."""
        _assign(program, {**self._fixed, **view_values(view, origin, size), **more})

    def _compile(self, name: str) -> moderngl.Program:
        if name == "faces":
            return self.programs.faces(self._defines)
        if name == "sprites":
            return self.programs.sprites(self._defines)
        defines = dict(self._defines)
        if name == "shadow":
            defines.pop("OCCLUSION", None)
        return self.programs.depths(name, defines)

    def _array(self, program: moderngl.Program) -> moderngl.VertexArray:
        """The pool's words and the blocks' records, as far as the program has inputs for them."""
        kinds = {"voxel": "1u", "normal": "1u", "colour": "4f1"}
        used = [name for name in self._layout if name in program]
        layout = " ".join(kinds[name] if name in used else "4x" for name in self._layout)
        return self._context.vertex_array(
            program,
            [
                (self._voxels.buffer, layout, *used),
                self._block_inputs(program),
            ],
            mode=moderngl.POINTS,
        )

    def _flag(self, target: Target) -> None:
        """Flags from the numbers of the blocks that sprites have left in the picture."""
        if self._flagging is None:
            self._flagging = self.programs.compute(("flag.comp",), {})
        target.ids.bind_to_image(0, read=True, write=True)
        self._flags.bind_to_storage_buffer(0)
        self._context.memory_barrier(moderngl.ALL_BARRIER_BITS)
        width, height = target.size
        self._flagging.run(-(-width // FLAG_GROUP), -(-height // FLAG_GROUP))


def view_values(
    view: View, origin: NDArray[np.int64], size: tuple[int, int]
) -> dict[str, bytes | bool | tuple[float, ...]]:
    """The uniforms of common.glsl and of the sprites."""
    eye = view.eye - origin if view.perspective else view.eye
    rows = view.clip.copy()
    rows[:, 3] = rows @ (*origin, 1.0)
    pixel = np.array([[2 / size[0], 0, -1], [0, 2 / size[1], -1], [0, 0, 1.0]])
    if view.perspective:
        ray = np.linalg.inv(rows[[0, 1, 3], :3]) @ pixel
    else:
        place = np.array([[1, 0, -rows[0, 3]], [0, 1, -rows[1, 3]], [0, 0, 0]]) @ pixel
        ray = np.linalg.inv(np.vstack((rows[:2, :3], view.eye))) @ place
    return {
        "clip": view.local(origin).tobytes(),
        "eye": tuple(eye.tolist()),
        "parallel": not view.perspective,
        "viewport": (float(size[0]), float(size[1])),
        "ray": np.ascontiguousarray(ray.T, dtype=np.float32).tobytes(),
    }


def _assign(program: moderngl.Program | moderngl.ComputeShader, values: Mapping[str, Any]) -> None:
    """Give a program the uniforms of these that it has."""
    for name, value in values.items():
        member = program.get(name, None)
        if isinstance(member, moderngl.Uniform) and isinstance(value, bytes):
            member.write(value)
        elif isinstance(member, moderngl.Uniform):
            member.value = value
