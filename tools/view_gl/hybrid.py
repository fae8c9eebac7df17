"""Source triangles of finest blocks whose voxels would be larger than allowed (Chajdas 2014, 4.7).

Two pools beside that of the voxels, managed alike: one of vertices, one of triangles. The voxels of
such a block stay where they are, so that they are there when the camera moves away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from ..reader_py import BlockFile
from .buffers import WORD, PoolBuffer
from .tree import Nodes, Tree

COLUMNS = ("vertex", "triangle")
VERTEX_WORDS, TRIANGLE_WORDS = 4, 3


@dataclass(frozen=True, slots=True)
class Pieces:
    """The source triangles of one block, as they lie in the pools."""

    node: int  # row of the tree
    vertices: NDArray[np.uint32]  # (v, 4): three floats in finest voxels, colour R | … | A << 24
    triangles: NDArray[np.uint32]  # (t, 3)


class SourceTriangles:
    """What is there of the file's source triangles, and what is to be read of them.

    pool_bytes : of each of the two pools
    """

    def __init__(
        self, context: moderngl.Context, file: BlockFile, pool_bytes: int, *, colour: bool
    ) -> None:
        self._file = file
        self._names = [*COLUMNS, *(("occupancy", "mask", "colour") if colour else ())]
        self.vertices = PoolBuffer(context, pool_bytes // (VERTEX_WORDS * WORD), VERTEX_WORDS)
        self.triangles = PoolBuffer(context, pool_bytes // (TRIANGLE_WORDS * WORD), TRIANGLE_WORDS)
        self.waiting: list[Pieces] = []
        self._refused: set[int] = set()  # blocks with more than a pool holds

    def read(self, entries: Sequence[Any], nodes: Sequence[int]) -> list[Pieces]:
        """Read the triangles of blocks; entries by row of the tree."""
        found = self._file.load([entries[node] for node in nodes], self._names)
        return [self._pieces(node, block) for node, block in zip(nodes, found, strict=True)]

    def lacking(self, tree: Tree, nodes: Nodes) -> list[int]:
        """Which of these blocks have triangles that are neither there nor on their way.

        Those that were released come back, if they are still there.
        """
        for node in nodes.tolist():
            for buffer in (self.vertices, self.triangles):
                if node not in buffer.pool:
                    buffer.pool.resurrect(node)
        on_way = {pieces.node for pieces in self.waiting}
        return [
            node
            for node in nodes.tolist()
            if not self._is_there(node)
            and node not in on_way
            and node not in self._refused
            and int(tree.entries[node]["triangle"]["raw"]) > 1
        ]

    def drawable(self, nodes: Nodes) -> NDArray[np.bool_]:
        """(n,) which of these blocks can be drawn as triangles."""
        return np.array([self._is_there(node) for node in nodes.tolist()], np.bool_)

    def upload(self, limit: int | None) -> bool:
        """Upload what was read, up to so many bytes but one block at least; was there anything?"""
        total = 0
        ready: list[Pieces] = []
        while self.waiting:
            pieces = self.waiting[0]
            size = pieces.vertices.nbytes + pieces.triangles.nbytes
            if ready and limit is not None and total + size > limit:
                break
            self.waiting.pop(0)
            if self._is_there(pieces.node):
                continue
            if not self._place(pieces):
                self._refused.add(pieces.node)
                continue
            ready.append(pieces)
            total += size
        self.vertices.upload([(pieces.node, pieces.vertices) for pieces in ready])
        self.triangles.upload([(pieces.node, pieces.triangles) for pieces in ready])
        self.vertices.pool.evicted.clear()  # what is there is asked of the pools themselves
        self.triangles.pool.evicted.clear()
        return bool(ready)

    @property
    def uploaded(self) -> int:
        """Bytes, since the start."""
        return self.vertices.uploaded + self.triangles.uploaded

    def keep(self, nodes: Nodes) -> None:
        """Release what is not among these blocks."""
        wanted = set(nodes.tolist())
        for buffer in (self.vertices, self.triangles):
            for node in [node for node in buffer.pool.blocks() if node not in wanted]:
                buffer.pool.release(node)
        # One pool may have evicted what the other still has: then neither has it.
        for node in wanted:
            if (node in self.vertices.pool) != (node in self.triangles.pool):
                has = self.vertices if node in self.vertices.pool else self.triangles
                has.pool.release(node)

    def _is_there(self, node: int) -> bool:
        return node in self.vertices.pool and node in self.triangles.pool

    def _place(self, pieces: Pieces) -> bool:
        placed: list[PoolBuffer] = []
        for buffer, values in (
            (self.vertices, pieces.vertices),
            (self.triangles, pieces.triangles),
        ):
            if not buffer.make_room(pieces.node, len(values)):
                for other in placed:
                    other.pool.release(pieces.node)
                return False
            placed.append(buffer)
        return True

    def _pieces(self, node: int, block: dict[str, NDArray[Any]]) -> Pieces:
        places = block["vertex"].astype(np.float64) * 2.0**-self._file.snap_bits
        vertices = np.empty((len(places), VERTEX_WORDS), np.uint32)
        vertices[:, :3] = places.astype(np.float32).view(np.uint32)
        vertices[:, 3] = self._colours(places, block) if "colour" in block else 0
        return Pieces(node, vertices, np.ascontiguousarray(block["triangle"], np.uint32))

    def _colours(
        self, places: NDArray[np.float64], block: dict[str, NDArray[Any]]
    ) -> NDArray[np.uint32]:
        """(v,) the colour of the voxel that each vertex lies in, or of the block's middle voxel."""
        most = (1 << self._file.block_log2) - 1
        voxel = np.minimum(places.astype(np.uint32), most)
        wanted = voxel[:, 0] | voxel[:, 1] << 8 | voxel[:, 2] << 16
        words = block["words"] & 0xFFFFFF
        order = np.argsort(words)
        at = np.minimum(np.searchsorted(words, wanted, sorter=order), len(words) - 1)
        row = order[at]
        row[words[row] != wanted] = len(words) // 2
        packed: NDArray[np.uint32] = np.ascontiguousarray(block["colour"]).view(np.uint32)
        colours: NDArray[np.uint32] = packed.reshape(-1)[row]
        return colours
