"""The frame loop: visibility, requests, loading, drawing (Chajdas 2014, 4.3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from gstream_tools.reader_py import BlockFile
from gstream_tools.scene import Resolution, Scene

from . import look
from .buffers import WORD, VoxelBuffer
from .camera import Camera, View
from .deform import Deformation
from .draw import Appearance, Painter
from .loader import Loader, Wish, Words
from .target import Target
from .tree import Tree
from .visibility import Boxes, Cut, Occlusion, walk

ATTRIBUTES = ("normal", "colour")  # columns that become words of a voxel, in their order
RELIEF = 1.25  # by which the pixel error grows while the pool is too small, and shrinks again
ROOMY = 0.6  # of the pool: below it the pixel error may shrink


@dataclass(frozen=True, slots=True)
class Frame:
    """What a frame did."""

    blocks: int  # drawn with colour
    probes: int
    voxels: int  # of the blocks drawn with colour
    wanted: int  # blocks and pages that were not there
    uploaded: int  # bytes
    converged: bool  # the next frame would be the same, and so would its cut
    pixel_error: float  # the limit that was held: above the scene's where the pool is too small
    deepest: int  # the finest level drawn, -1 where nothing is


class Renderer:
    """One block file, one scene, one context of OpenGL.

    size : of the picture, pixels
    tint : colour by level, instead of the file's colours
    """

    def __init__(
        self, context: moderngl.Context, file: BlockFile, scene: Scene, resolution: Resolution,
        size: tuple[int, int], *, tint: bool = False,
    ) -> None:  # fmt: skip
        self.file, self.scene, self.resolution = file, scene, resolution
        self.pixel_error = scene.lod.pixel_error
        self.closed = scene.budget.refine == "closed"
        self.synchronous = scene.budget.io == "sync"
        self.upload_limit = scene.budget.upload_per_frame
        self.occlusion = "occlusion" in resolution.effects
        self._context = context
        columns = [name for name in ATTRIBUTES if name in resolution.columns]
        self.loader = Loader(file, columns)
        file.load_opening()
        self.tree = Tree(file)
        self._read_roots()
        stride = self.loader.stride
        room = min(scene.budget.pool_bytes // (stride * WORD), sum(file.level_voxels))
        self.voxels = VoxelBuffer(context, max(room, 1), stride)
        defines = dict(resolution.defines) | ({"TINT": 1} if tint else {})
        self.painter = Painter(
            context, self.voxels, defines, columns, file.block_log2, file.normal_bits
        )
        kind = resolution.defines.get("DEFORM", 0)
        self._deformation = Deformation.of(scene, kind, file.matrix, file.box)
        self._boxes = Boxes(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
        self._history = Occlusion()
        self._resident = np.empty(0, np.bool_)
        self._waiting: list[tuple[int, Words]] = []  # read, not yet uploaded
        self._relief = 1.0
        self._picture = 0
        self._last: tuple[object, ...] = ()
        self._target: Target | None = None
        self._size = (0, 0)
        self.resize(size)

    def resize(self, size: tuple[int, int]) -> None:
        """Change the picture's size."""
        if self._target is not None and size == self._size:
            return
        if self._target is not None:
            self._target.release()
        samples = min(self.scene.camera.samples, self._context.max_samples)
        ids = "OCCLUSION" in self.resolution.defines
        self._size = size
        self._target = Target(self._context, size, samples, ids=ids)

    @property
    def target(self) -> Target:
        """What is drawn to."""
        if self._target is None:
            raise ValueError("the renderer has no size yet")
        return self._target

    def frame(self, camera: Camera) -> Frame:
        """Draw one frame with what is there, and ask for what is not."""
        before = self.voxels.uploaded
        loaded = self.loader.take()
        self.tree.rows_of_pages(loaded.pages)
        self._grow()
        self._waiting += [block for block in loaded.blocks if not self._resident[block[0]]]
        changed = self._upload(self.upload_limit)
        view = self._view(camera)
        cut = self._walk(view)
        if self.synchronous:
            while len(cut.wanted) or cut.pages:
                self.tree.rows_of_pages(cut.pages)
                self._grow()
                self._waiting = self.loader.read(self.tree.entries, cut.wanted.tolist())
                if not self._upload(None) and not cut.pages:
                    break
                changed = True
                cut = self._walk(view)
        else:
            on_way = {node for node, _ in self._waiting}
            nodes = [node for node in cut.wanted.tolist() if node not in on_way]
            self.loader.ask(Wish(frozenset(cut.pages), nodes), self.tree.entries)
        self._keep(cut)
        state = (camera, self._size, self.pixel_error, self._relief, self.closed, self.occlusion)
        if changed or state != self._last:
            self._picture += 1
        same = state == self._last and not changed
        self._last = state
        self._draw(cut, view)
        wanted = len(cut.wanted) + len(cut.pages)
        drawn = cut.drawn
        return Frame(
            blocks=len(drawn),
            probes=len(cut.probes),
            voxels=int(self.tree.count[drawn].sum()),
            wanted=wanted,
            uploaded=self.voxels.uploaded - before,
            converged=not (wanted or self._waiting) and same and self._history.settled,
            pixel_error=self.pixel_error * self._relief,
            deepest=int(self.tree.level[drawn].min()) if len(drawn) else -1,
        )

    def converge(self, camera: Camera, frames: int = 10_000) -> Frame:
        """Draw until nothing changes any more, or so many frames."""
        done = self.frame(camera)
        for _ in range(frames - 1):
            if done.converged:
                break
            done = self.frame(camera)
        return done

    def picture(self) -> NDArray[np.uint8]:
        """(height, width, 4) sRGB, the first row on top; alpha is how much of a pixel is covered."""
        return self.target.pixels()

    def close(self) -> None:
        """End the reading thread."""
        self.loader.close()

    def _read_roots(self) -> None:
        for page in range(self.file.pages):
            self.tree.add_page(page)
            if self.tree.level[-1] < self.file.levels - 1:
                break

    def _grow(self) -> None:
        more = len(self.tree) - len(self._resident)
        if more:
            self._resident = np.concatenate((self._resident, np.zeros(more, np.bool_)))
            self._history.grow(len(self.tree))
            low, high = self._deformation.boxes(self.tree.low, self.tree.high)
            self._boxes = Boxes(low, high, self.tree.edge * self._deformation.stretch)

    def _view(self, camera: Camera) -> View:
        roots, boxes = self.tree.roots, self._boxes
        box = np.zeros((2, 3))
        if len(roots):
            box = np.stack((boxes.low[roots].min(axis=0), boxes.high[roots].max(axis=0)))
        return View.of(camera, self._size, self.file.matrix, box)

    def _walk(self, view: View) -> Cut:
        if not self.occlusion:
            self._history.forget()
        return walk(
            self.tree,
            view,
            self._resident,
            self._history.hidden,
            self._boxes,
            pixel_error=self.pixel_error * self._relief,
            closed=self.closed,
        )

    def _upload(self, limit: int | None) -> bool:
        """Upload what was read, up to so many bytes, but one block at least. Did anything change?"""
        pool, size = self.voxels.pool, self.voxels.stride * WORD
        ready: list[tuple[int, Words]] = []
        total = 0
        while self._waiting:
            node, words = self._waiting[0]
            bytes_ = len(words) * size
            if ready and limit is not None and total + bytes_ > limit:
                break
            self._waiting.pop(0)
            if self._resident[node]:
                continue
            if pool.nearly_full:
                self.voxels.move(pool.defragment())
            if pool.allocate(node, len(words)) is None:
                self.voxels.move(pool.defragment())
                if pool.allocate(node, len(words)) is None:
                    self._relief *= RELIEF
                    self._waiting.clear()
                    break
            ready.append((node, words))
            total += bytes_
        self._forget_evicted()
        self.voxels.upload(ready)
        self._resident[[node for node, _ in ready]] = True
        return bool(ready)

    def _forget_evicted(self) -> None:
        self._resident[self.voxels.pool.evicted] = False
        self.voxels.pool.evicted.clear()

    def _keep(self, cut: Cut) -> None:
        """Release what the frame has no use for; what it has, is in use again."""
        pool, tree = self.voxels.pool, self.tree
        parents = np.unique(tree.parent[cut.wanted])
        siblings = tree.children_of(parents[parents >= 0])
        needed = np.concatenate((cut.drawn, cut.probes, cut.inner, siblings, tree.roots))
        keep = np.zeros(len(tree), np.bool_)
        keep[needed] = True
        for node in np.flatnonzero(self._resident):
            if keep[node] and node not in pool:
                pool.resurrect(int(node))
            elif not keep[node] and node in pool:
                pool.release(int(node))
        if self._relief > 1.0 and not len(cut.wanted) and pool.used < ROOMY * pool.capacity:
            self._relief = max(1.0, self._relief / RELIEF)

    def _draw(self, cut: Cut, view: View) -> None:
        tree, target = self.tree, self.target
        fresh = self._history.fresh(cut.probes, self._picture)
        probes = np.concatenate((cut.probes[fresh], cut.probes[~fresh]))
        middle = view.eye if view.perspective else self._deformation.pivot
        origin = np.floor(middle).astype(np.int64)
        self.painter.begin(tree, [cut.drawn, probes], origin)
        appearance = Appearance(
            look.uniforms(self.scene, self.file, self.resolution, origin)
            | self._deformation.uniforms(origin)
        )
        drawn = cut.drawn
        boxes = self._boxes
        pixels = view.voxel_pixels(boxes.low[drawn], boxes.high[drawn], boxes.edge[drawn])
        target.clear(self.scene.shade.background)
        self.painter.voxels(
            target, view, origin, len(drawn), appearance, float(pixels.max(initial=0.0))
        )
        count = len(drawn) + len(probes)
        if self.occlusion:
            self.painter.probes(
                target, view, origin, len(drawn), len(probes), int(fresh.sum()), appearance
            )
            passed = np.zeros(len(tree), np.bool_)
            passed[np.concatenate((drawn, probes))] = self.painter.flags(count)
            self._history.update(tree, cut, passed, self._picture)
        target.resolve()
        if target.samples > 1:
            self.painter.passes.append("resolve")
