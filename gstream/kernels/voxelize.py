"""One box of voxels being filled: the two loops of the voxelizer and the arrays between them.

The box grows its arrays as voxels appear and says so when a byte limit is reached; the caller then
splits it in eight. Also the plain front for tests and small uses, `voxelize_triangles`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gstream.kernels import accumulate as acc
from gstream.kernels import fragments as frag
from gstream.kernels.packets import arrange, emit_packets
from gstream.kernels.select import collect

I64 = NDArray[np.int64]
F64 = NDArray[np.float64]

MODES = {"conservative": frag.CONSERVATIVE, "6": frag.SIX, "26": frag.TWENTY_SIX}
TILE_EDGE = 8
BATCH_TRIANGLES = 4096  # sorted by shape at once; the sums of their voxels still fit the L2 cache


class BoxFullError(Exception):
    """The box' arrays would exceed its byte limit."""


def spread_table() -> NDArray[np.uint32]:
    """(256,) u4: the bits of i moved to every third place, the Morton code of (i, 0, 0)."""
    i = np.arange(256, dtype=np.uint32)
    table = np.zeros(256, np.uint32)
    for bit in range(8):
        table |= ((i >> np.uint32(bit)) & np.uint32(1)) << np.uint32(3 * bit)
    return table


SPREAD = spread_table()


@dataclass(frozen=True, slots=True)
class Rules:
    """What decides membership, the same for every triangle of a job."""

    snap_bits: int
    sep: str
    closed: bool
    both_faces: bool

    def packed(self) -> tuple[int, int, bool, bool]:
        """As the kernels take them."""
        return (self.snap_bits, MODES[self.sep], self.closed, self.both_faces)


class Box:
    """A cube of edge^3 voxels that collects fragments; `start` makes it another one, empty again.

    channels : attribute channels per corner besides the geometry (colour 4, input normal 3)
    """

    def __init__(self, channels: int) -> None:
        b = frag.BUFFER_FRAGMENTS
        self._keys, self._owners = np.empty(b, np.uint32), np.empty(b, np.int32)
        self._hits, self._areas = np.empty(b, np.bool_), np.empty(b)
        self._values = np.empty((b, channels))
        self.used = np.zeros(2, np.int64)
        self._allocate(channels)

    def start(
        self,
        rules: Rules,
        edge: int,
        room: tuple[int, int, int] | None = None,
        limit_bytes: int = 1 << 40,
    ) -> None:
        """Begin with an empty box, in the arrays of the last one.

        edge : voxels per edge, a power of two, 8 to 256
        room : voxels that may be set along x, y, z: less than the edge where the grid ends inside
        limit_bytes : BoxFullError when the arrays would grow beyond it
        """
        self.rules, self.limit_bytes = rules, limit_bytes
        self.edge, self.room = edge, room or (edge, edge, edge)
        self.tile_slots = np.full((edge // TILE_EDGE) ** 3, -1, np.int32)
        if self.tiles.nbytes + self.sums.nbytes + self.flags.nbytes > limit_bytes:
            self._allocate(self.sums.shape[1] - acc.CHANNELS)
        self.sums[: self.voxels] = 0
        self.flags[: self.voxels] = 0
        self.used[:] = 0
        self.fragments = 0

    def _allocate(self, channels: int) -> None:
        self.tiles = np.empty((64, acc.TILE_VOXELS), np.int32)
        self.sums = np.zeros((4096, acc.CHANNELS + channels), np.int64)
        self.flags = np.zeros(4096, np.uint8)

    @property
    def voxels(self) -> int:
        return int(self.used[1])

    def add(self, corners: I64, values: F64) -> NDArray[np.bool_]:
        """Add triangles; returns per triangle whether a target in this box was met.

        corners : (n, 3, 3) i8   snap units relative to the box's low corner
        values : (n, 3, channels) f8
        errors : BoxFullError; the box is then of no use until the next start
        """
        assigned = np.zeros(len(corners), np.bool_)
        for first in range(0, len(corners), BATCH_TRIANGLES):
            batch = slice(first, first + BATCH_TRIANGLES)
            self._add_batch(corners[batch], values[batch], assigned[batch])
        return assigned

    def _add_batch(self, corners: I64, values: F64, assigned: NDArray[np.bool_]) -> None:
        n, rules = len(corners), self.rules.packed()
        normals, masks = np.ones((n, 4)), np.empty(n, np.uint8)
        order, shapes = np.empty(n, np.int32), np.empty(n, np.int16)
        small = arrange(corners, rules, order, shapes)
        buffers = (self._keys, self._owners, self._hits, self._areas)
        place = 0
        while place < small:
            place, count = emit_packets(
                corners, values, order, shapes, small, rules, self.room, place,
                normals, masks, assigned, *buffers, self._values,
            )  # fmt: skip
            self._accumulate(count, normals, masks)
        slab = -1
        while place < n:
            place, slab, count = frag.emit(
                corners, values, order, rules, self.room, (place, slab), SPREAD,
                normals, masks, assigned, *buffers, self._values,
            )  # fmt: skip
            self._accumulate(count, normals, masks)

    def _accumulate(self, count: int, normals: F64, masks: NDArray[np.uint8]) -> None:
        self.fragments += count
        start = 0
        while start < count:
            start += acc.accumulate(
                count - start, self._keys[start:], self._owners[start:], self._hits[start:],
                self._areas[start:], self._values[start:], normals, masks,
                self.tile_slots, self.tiles, self.used, self.sums, self.flags,
            )  # fmt: skip
            if start < count:
                self._grow()

    def _grow(self) -> None:
        tiles, sums, flags = self.tiles, self.sums, self.flags
        more_tiles = tiles.nbytes if self.used[0] == len(tiles) else 0
        more_sums = sums.nbytes + flags.nbytes if self.used[1] + acc.CHUNK > len(sums) else 0
        held = tiles.nbytes + sums.nbytes + flags.nbytes
        if held + more_tiles + more_sums > self.limit_bytes:
            raise BoxFullError
        if more_tiles:
            self.tiles = _doubled(tiles)
        if more_sums:
            self.sums, self.flags = _doubled(sums), _doubled(flags)

    def collect(
        self, part: int, parts: int, wanted: int = 0
    ) -> tuple[NDArray[np.int32], NDArray[np.uint32]]:
        """Rows of the sums and Morton codes of the part-th of `parts` equal Morton ranges.

        wanted : bits that the flags of a voxel must have
        """
        tiles = len(self.tile_slots) // parts
        slots = self.tile_slots[part * tiles : (part + 1) * tiles]
        rows, codes = collect(slots, self.tiles, self.flags, wanted)
        return rows, codes


def _doubled(array: NDArray[Any]) -> NDArray[Any]:
    """The same rows, then as many zeros."""
    doubled = np.zeros((2 * len(array), *array.shape[1:]), array.dtype)
    doubled[: len(array)] = array
    return doubled


@dataclass(frozen=True, slots=True)
class Voxels:
    """The sums of one box, in Morton order."""

    voxel: I64  # (m, 3) voxel coordinates in the grid
    hit: NDArray[np.bool_]  # (m,) a target was met; all true in the conservative mode
    area: I64  # (m,) unit 2^-26 voxel face, at least 1 per fragment
    vector: I64  # (m, 3) area vector, unit 2^-38 voxel face
    mask: NDArray[np.uint8]  # (m,) face mask, 0 where only degenerate triangles met the voxel
    colour: I64  # (m, c) channels times area
    fragments: int
    assigned: NDArray[np.bool_]  # (n,) per triangle: a target in this box was met


def voxelize_triangles(
    vertices: I64,
    snap_bits: int,
    box_low: tuple[int, int, int],
    box_edge: int,
    sep: str,
    ties: str,
    channels: F64 | None = None,
) -> Voxels:
    """Voxelize snapped triangles in one box.

    vertices : (n, 3, 3) i8   snap units (2^-snap_bits voxel) in the grid
    box_low : voxel coordinates of the box's low corner
    box_edge : power of two, 8 to 256
    channels : (n, 3, c) f8   attribute channels at the corners
    """
    if channels is None:
        channels = np.zeros((len(vertices), 3, 0))
    box = Box(channels.shape[2])
    box.start(Rules(snap_bits, sep, ties == "closed", False), box_edge)
    low = np.array(box_low, np.int64)
    assigned = box.add(vertices - (low << snap_bits), channels)
    rows, codes = box.collect(0, 1)
    sums, flags = box.sums[rows], box.flags[rows]
    voxel = compact(codes) + low
    return Voxels(
        voxel, (flags & acc.HIT) != 0, sums[:, acc.AREA], sums[:, acc.VECTOR : acc.CHANNELS],
        flags & np.uint8(63), sums[:, acc.CHANNELS :], box.fragments, assigned,
    )  # fmt: skip


def compact(codes: NDArray[np.uint32]) -> I64:
    """(n, 3) i8 coordinates of Morton codes of up to 24 bits."""
    out = np.zeros((len(codes), 3), np.int64)
    for c in range(3):
        for bit in range(8):
            out[:, c] |= ((codes >> np.uint32(3 * bit + c)) & np.uint32(1)).astype(np.int64) << bit
    return out


def fragments(
    corners: I64, rules: Rules, room: tuple[int, int, int]
) -> Iterator[tuple[NDArray[np.int32], NDArray[np.uint32], NDArray[np.bool_]]]:
    """Triangle, Morton code and target met of each fragment in a box of `room` voxels, in batches.

    corners : (n, 3, 3) i8   snap units relative to the box's low corner
    """
    n, b = len(corners), frag.BUFFER_FRAGMENTS
    keys, owners, hits = np.empty(b, np.uint32), np.empty(b, np.int32), np.empty(b, np.bool_)
    normals, masks, assigned = np.ones((n, 4)), np.empty(n, np.uint8), np.zeros(n, np.bool_)
    areas, none = np.empty(b), np.empty((b, 0))
    order, shapes = np.empty(n, np.int32), np.empty(n, np.int16)
    small = arrange(corners, rules.packed(), order, shapes)
    outputs = (normals, masks, assigned, keys, owners, hits, areas)
    place, slab = 0, -1
    while place < n:
        if place < small:
            place, count = emit_packets(
                corners, np.empty((n, 3, 0)), order, shapes, small, rules.packed(), room, place,
                *outputs, none,
            )  # fmt: skip
        else:
            place, slab, count = frag.emit(
                corners, np.empty((n, 3, 0)), order, rules.packed(), room, (place, slab), SPREAD,
                *outputs, none,
            )  # fmt: skip
        if count:
            yield owners[:count], keys[:count], hits[:count]
