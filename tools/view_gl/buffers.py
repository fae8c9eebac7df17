"""Blocks on the GPU: a buffer, in which a pool says where each of them lies (thesis, 4.4)."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from .pool import Move, Pool

Words = NDArray[np.uint32]
STAGING_BYTES = 4 << 20
WORD = 4


class PoolBuffer:
    """Voxels, vertices or triangles of `stride` words each, of blocks by row of the tree."""

    def __init__(self, context: moderngl.Context, capacity: int, stride: int) -> None:
        self._context = context
        self.stride = stride
        self.pool = Pool(capacity)
        self.buffer = context.buffer(reserve=max(capacity, 1) * stride * WORD, dynamic=True)
        self._staging = context.buffer(reserve=STAGING_BYTES, dynamic=True)
        self.uploaded = 0  # bytes, since the start

    def make_room(self, node: int, count: int) -> bool:
        """Give a block a place, moving the others together if need be; is there room at all?"""
        if node in self.pool:
            return True
        if self.pool.nearly_full:
            self.move(self.pool.defragment())
        if self.pool.resurrect(node) or self.pool.allocate(node, count) is not None:
            return True
        self.move(self.pool.defragment())
        return self.pool.allocate(node, count) is not None

    def upload(self, blocks: Sequence[tuple[int, Words]]) -> None:
        """Write blocks to where the pool has them.

        Packed into the staging buffer, moved with one transfer for each of its fillings, then
        scattered by copies on the GPU. A block longer than the staging buffer is cut.
        """
        pieces: list[tuple[int, bytes]] = []
        room = STAGING_BYTES
        for node, words in blocks:
            place = self.pool.place(node)
            if place is None:
                raise ValueError(f"block {node} has no place")
            data, target = words.tobytes(), place[0] * self.stride * WORD
            at = 0
            while at < len(data):
                piece = data[at : at + room]
                pieces.append((target + at, piece))
                at += len(piece)
                room -= len(piece)
                if room == 0:
                    self._scatter(pieces)
                    pieces, room = [], STAGING_BYTES
        self._scatter(pieces)

    def move(self, moves: Sequence[Move]) -> None:
        """Carry out what the pool's defragmentation asks for.

        OpenGL refuses copies that overlap: those go by way of the staging buffer.
        """
        size = self.stride * WORD
        for move in moves:
            source, target, length = move.source * size, move.target * size, move.count * size
            if source - target >= length:
                self._copy(self.buffer, source, target, length)
                continue
            for at in range(0, length, STAGING_BYTES):
                piece = min(STAGING_BYTES, length - at)
                self._context.copy_buffer(
                    self._staging, self.buffer, piece, read_offset=source + at
                )
                self._copy(self._staging, 0, target + at, piece)

    def _copy(self, source: moderngl.Buffer, begin: int, target: int, length: int) -> None:
        self._context.copy_buffer(
            self.buffer, source, length, read_offset=begin, write_offset=target
        )

    def _scatter(self, pieces: Sequence[tuple[int, bytes]]) -> None:
        if not pieces:
            return
        packed = b"".join(piece for _, piece in pieces)
        self._staging.orphan()
        self._staging.write(packed)
        self.uploaded += len(packed)
        at = 0
        for target, piece in pieces:
            self._copy(self._staging, at, target, len(piece))
            at += len(piece)
