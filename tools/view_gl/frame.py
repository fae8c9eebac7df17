"""The frame loop: visibility, requests, loading, drawing (Chajdas 2014, 4.3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from ..reader_py import BlockFile
from ..scene import Resolution, Scene, SceneError
from . import look, shadow
from .buffers import WORD, Words
from .camera import Camera, View
from .deform import Deformation
from .draw import Appearance, Painter
from .hybrid import SourceTriangles
from .loader import Loader, Wish
from .pool import HIGH_WATERMARK
from .residency import ResidentVoxels
from .sraa import DeferredTarget
from .stencil import Where, without_cut
from .target import Target
from .tree import Nodes, Tree
from .visibility import Boxes, Cut, Occlusion, walk

ATTRIBUTES = ("normal", "colour")  # columns that become words of a voxel, in their order


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
    cut : where stencils are applied
    """

    def __init__(
        self, context: moderngl.Context, file: BlockFile, scene: Scene, resolution: Resolution,
        size: tuple[int, int], *, tint: bool = False, cut: Where = "shader",
    ) -> None:  # fmt: skip
        self.file, self.scene, self.resolution = file, scene, resolution
        self.pixel_error = scene.lod.pixel_error
        self.closed = scene.budget.refine == "closed"
        self.synchronous = scene.budget.io == "sync"
        self.upload_limit = scene.budget.upload_per_frame
        self._stencils = "STENCIL" in resolution.defines
        self._cut: Where = cut
        # A coarse voxel that is not uploaded bounds nothing: its children may be there.
        uncut = not (self._stencils and cut == "upload")
        self.occlusion = "occlusion" in resolution.effects and uncut
        self.paused = False  # draw what is there, ask for nothing more
        self._samples = scene.camera.samples
        self._context = context
        self._columns = [name for name in ATTRIBUTES if name in resolution.columns]
        self._source: SourceTriangles | None = None
        if "hybrid" in resolution.effects:
            if "SRAA" in resolution.defines:
                said = "source triangles have no numbers that samples could find"
                raise SceneError(scene.path, "camera.sraa", said, "leave out sraa, or hybrid")
            pool, colour = scene.budget.pool_bytes, "colour" in resolution.columns
            self._source = SourceTriangles(context, file, pool, colour=colour)
        self.loader = Loader(file, self._columns, self._source)
        file.load_opening()
        self.tree = Tree(file)
        self._read_roots()
        stride = self.loader.stride
        # Of a file that fits the pool stays below its watermark: nothing is ever moved or lost.
        fitting = int(sum(file.level_voxels) / HIGH_WATERMARK) + 1
        room = min(scene.budget.pool_bytes // (stride * WORD), fitting)
        self.voxels = ResidentVoxels(context, self.tree, max(room, 1), stride)
        self.tint(tint)
        kind = resolution.defines.get("DEFORM", 0)
        self._deformation = Deformation.of(scene, kind, file.matrix, file.box)
        self._boxes = Boxes(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
        self._lights = resolution.defines.get("SHADOW", 0)
        self._maps: shadow.Maps | None = None
        self._mapped: list[list[int]] = []  # the blocks in the maps
        self._history = Occlusion()
        self.last_cut: Cut | None = None
        self._picture = 0
        self._last: tuple[object, ...] = ()
        self._target: Target | DeferredTarget | None = None
        self._size = (0, 0)
        self.resize(size)
        self._grow()
        self._read(self.tree.roots.tolist())

    def tint(self, tint: bool) -> None:
        """Colour by level, or as the scene says."""
        defines = dict(self.resolution.defines) | ({"TINT": 1} if tint else {})
        self.painter = Painter(
            self._context, self.voxels.store, defines, self._columns, self.file, self._cut
        )
        self._last = ()

    def resize(self, size: tuple[int, int], samples: int = 0) -> None:
        """Change the picture's size, and its samples, at most what the driver has, if given."""
        samples = min(samples or self._samples, self._context.max_samples)
        if self._target is not None and (size, samples) == (self._size, self._target.samples):
            return
        if self._target is not None:
            self._target.release()
        ids = "OCCLUSION" in self.resolution.defines
        self._size, self._samples, self._last = size, samples, ()
        if samples > 1 and "SRAA" in self.resolution.defines:
            self._target = DeferredTarget(self._context, size, samples, self.painter.programs)
        else:
            programs = self.painter.programs
            self._target = Target(self._context, size, samples, programs, ids=ids)
        if self._lights:
            if self._maps is not None:
                self._maps.release()
            self._maps, self._mapped = shadow.Maps(self._context, self._lights, size), []

    @property
    def target(self) -> Target | DeferredTarget:
        """What is drawn to."""
        if self._target is None:
            raise ValueError("the renderer has no size yet")
        return self._target

    def frame(self, camera: Camera) -> Frame:
        """Draw one frame with what is there, and ask for what is not."""
        before = self.uploaded
        loaded = self.loader.take()
        self.tree.rows_of_pages(loaded.pages)
        self._grow()
        self._take(loaded.blocks)
        changed = self._upload(self.upload_limit)
        if self._source is not None:
            self._source.waiting += loaded.sources
            changed |= self._source.upload(self.upload_limit)
        view = self._view(camera)
        lights = self._light_views()
        cuts = self._walk(view, lights)
        moved = self._state(camera) != self._last
        if self.synchronous and not self.paused:
            if self.occlusion and moved and self._wish(cuts):
                cuts = self._test(cuts, view, lights)
            while (wish := self._wish(cuts)).pages or wish.nodes:
                self.tree.rows_of_pages(wish.pages)
                self._grow()
                if not self._read(wish.nodes) and not wish.pages:
                    break
                changed = True
                cuts = self._walk(view, lights)
                if self.occlusion and self._wish(cuts):
                    cuts = self._test(cuts, view, lights)
            if self._source is not None and (sources := self._sources(cuts[0])):
                self._source.waiting = self._source.read(self.tree.entries, sources)
                changed |= self._source.upload(None)
        else:
            self.loader.ask(Wish() if self.paused else self._wish(cuts), self.tree.entries)
        self.voxels.keep(cuts)
        if self._source is not None:
            self._source.keep(cuts[0].undersampled)
        state = self._state(camera)
        if changed or state != self._last:
            self._picture += 1
        same = state == self._last and not changed
        self._last = state
        self._draw(cuts, view, lights)
        self.last_cut = cuts[0]
        cut, wish = cuts[0], self._wish(cuts)
        wanted = len(wish.nodes) + len(wish.pages) + len(wish.sources)
        drawn = cut.drawn
        return Frame(
            blocks=len(drawn),
            probes=len(cut.probes),
            voxels=int(self.tree.count[drawn].sum()),
            wanted=wanted,
            uploaded=self.uploaded - before,
            converged=(self.paused or not (wanted or self.voxels.on_way))
            and same
            and self._history.settled,
            pixel_error=self.pixel_error * self.voxels.relief,
            deepest=int(self.tree.level[drawn].min()) if len(drawn) else -1,
        )

    @property
    def uploaded(self) -> int:
        """Bytes, since the start."""
        return self.voxels.store.uploaded + (0 if self._source is None else self._source.uploaded)

    def converge(self, camera: Camera, frames: int = 10_000) -> Frame:
        """Draw until nothing changes any more, or so many frames."""
        done = self.frame(camera)
        for _ in range(frames - 1):
            if done.converged:
                break
            done = self.frame(camera)
        return done

    def picture(self) -> NDArray[np.uint8]:
        """(height, width, 4) sRGB, the first row on top; alpha: how much of a pixel is covered."""
        return self.target.pixels()

    def close(self) -> None:
        """End the reading thread and close the file."""
        self.loader.close()
        self.file.source.close()

    def _read_roots(self) -> None:
        for page in range(self.file.pages):
            self.tree.add_page(page)
            if self.tree.level[-1] < self.file.levels - 1:
                break

    def _grow(self) -> None:
        if len(self.tree) > len(self.voxels.here):
            self.voxels.grow()
            self._history.grow(len(self.tree))
            low, high = self._deformation.boxes(self.tree.low, self.tree.high)
            self._boxes = Boxes(low, high, self.tree.edge * self._deformation.stretch)

    def _box(self) -> NDArray[np.float64]:
        """(2, 3) around all that may be drawn, in finest voxels."""
        roots, boxes = self.tree.roots, self._boxes
        if not len(roots):
            return np.zeros((2, 3))
        return np.stack((boxes.low[roots].min(axis=0), boxes.high[roots].max(axis=0)))

    def _view(self, camera: Camera) -> View:
        return View.of(camera, self._size, self.file.matrix, self._box())

    def _light_views(self) -> list[View]:
        if self._maps is None:
            return []
        box, matrix = self._box(), self.file.matrix
        corners = box[[[i & 1, i >> 1 & 1, i >> 2] for i in range(8)], [0, 1, 2]]
        world = corners @ matrix[:, :3].T + matrix[:, 3]
        around = np.stack((world.min(axis=0), world.max(axis=0)))
        return shadow.views(self.scene, self._lights, self._maps.side, matrix, around, box)

    def _walk(self, view: View, lights: list[View]) -> list[Cut]:
        """The camera's cut, and those of the lights, which no occlusion makes coarser."""
        if not self.occlusion:
            self._history.forget()
        nothing = np.zeros(len(self.tree), np.bool_)
        views = [(view, self._history.hidden, self.closed), *((v, nothing, True) for v in lights)]
        error = self.pixel_error * self.voxels.relief
        return [
            walk(
                self.tree, of, self.voxels.here, hidden, self._boxes,
                pixel_error=error, closed=closed,
            )
            for of, hidden, closed in views
        ]  # fmt: skip

    def _state(self, camera: Camera) -> tuple[object, ...]:
        """What a picture depends on beside the blocks that are there."""
        limits = self.pixel_error, self.voxels.relief, self.closed, self.occlusion
        return camera, self._size, *limits

    def _test(self, cuts: list[Cut], view: View, lights: list[View]) -> list[Cut]:
        """The cuts without what is hidden by what is here: it is not read (thesis, 4.6)."""
        self.voxels.keep(cuts)
        self._picture += 1
        self._draw(cuts, view, lights, whole=False)
        return self._walk(view, lights)

    def _wish(self, cuts: list[Cut]) -> Wish:
        """What the cuts lack and is not on its way to the GPU already."""
        on_way = self.voxels.on_way
        nodes = dict.fromkeys(node for cut in cuts for node in cut.wanted.tolist())
        pages = frozenset(page for cut in cuts for page in cut.pages)
        wanted = [node for node in nodes if node not in on_way]
        return Wish(pages, wanted, self._sources(cuts[0]))

    def _sources(self, cut: Cut) -> list[int]:
        """The blocks whose source triangles are to be read: not those that a stencil may touch."""
        if self._source is None or self._stencils:
            return []
        return self._source.lacking(self.tree, cut.undersampled)

    def _read(self, nodes: Sequence[int]) -> bool:
        """Read and upload blocks now; was there anything?"""
        self._take(self.loader.read(self.tree.entries, nodes))
        return self._upload(None)

    def _take(self, blocks: Sequence[tuple[int, Words]]) -> None:
        """Have blocks uploaded, without what a stencil cuts out, if that is where it does."""
        if self._stencils and self._cut == "upload":
            blocks = [
                (node, without_cut(words, self.scene, self.file.matrix, *self._place(node)))
                for node, words in blocks
            ]
        self.voxels.take(blocks)

    def _upload(self, limit: int | None) -> bool:
        """Upload what was read, up to so many bytes but one block at least; was there anything?"""
        uploaded = self.voxels.upload(limit)
        if self._stencils and self._cut == "memory":
            for node in uploaded:
                corner, level = self._place(node)
                place = look.uniforms(self.scene, self.file, corner << level)
                self.painter.cut(node, level, Appearance(place))
        return bool(uploaded)

    def _place(self, node: int) -> tuple[NDArray[np.int64], int]:
        """A block's corner, in voxels of its level, and that."""
        return self.tree.corner[node], int(self.tree.level[node])

    def _draw(self, cuts: list[Cut], view: View, lights: list[View], *, whole: bool = True) -> None:
        tree, target, cut = self.tree, self.target, cuts[0]
        fresh = self._history.fresh(cut.probes, self._picture)
        probes = np.concatenate((cut.probes[fresh], cut.probes[~fresh]))
        middle = view.eye if view.perspective else self._deformation.pivot
        origin = np.floor(middle).astype(np.int64)
        casters = [light.drawn for light in cuts[1:]]
        as_triangles = np.zeros(len(cut.drawn), np.bool_)
        if self._source is not None:
            as_triangles = self._source.drawable(cut.drawn)
        drawn, sources = cut.drawn[~as_triangles], cut.drawn[as_triangles]
        self.painter.begin(tree, [drawn, probes, sources, *casters], origin)
        edges = [float(tree.edge[nodes].max(initial=1.0)) for nodes in casters]
        appearance = Appearance(
            look.uniforms(self.scene, self.file, origin)
            | self._deformation.uniforms(origin)
            | shadow.uniforms(lights, edges, origin)
        )
        if self._maps is not None:
            first = len(drawn) + len(probes) + len(sources)
            self._shade(lights, casters, first, origin, appearance)
        boxes = self._boxes
        pixels = view.voxel_pixels(boxes.low[drawn], boxes.high[drawn], boxes.edge[drawn])
        target.clear(self.scene.shade.background)
        if self._source is not None:
            first = len(drawn) + len(probes)
            blocks = {node: first + i for i, node in enumerate(sources.tolist())}
            self.painter.geometry(target, view, origin, self._source, blocks, appearance)
        self.painter.voxels(
            target, view, origin, len(drawn), appearance, float(pixels.max(initial=0.0))
        )
        if self.occlusion:
            self.painter.probes(
                target, view, origin, len(drawn), len(probes), int(fresh.sum()), appearance
            )
            passed = np.zeros(len(tree), np.bool_)
            tested = np.concatenate((drawn, probes, sources))
            passed[tested] = self.painter.flags(len(tested))
            self._history.update(tree, cut, passed, self._picture, whole=whole)
        if isinstance(target, DeferredTarget):
            self.painter.shade(target, view, origin, appearance)
        target.resolve()
        if target.samples > 1:
            self.painter.passes.append("resolve")

    def _shade(
        self, lights: list[View], casters: list[Nodes], first: int, origin: NDArray[np.int64],
        appearance: Appearance,
    ) -> None:  # fmt: skip
        """Draw the lights' maps, where other blocks are in them than the last time."""
        if self._maps is None:
            return
        self._maps.depths.use(0)
        mapped = [nodes.tolist() for nodes in casters]
        if mapped == self._mapped:
            return
        self._mapped = mapped
        counts = []
        for nodes in casters:
            counts.append((first, len(nodes)))
            first += len(nodes)
        self.painter.shadows(self._maps, lights, origin, counts, appearance)
