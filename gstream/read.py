"""Reading a block file: blocks by level, place or world box, from a path, URL, memory or callable.

    with open_block_file("bunny.gsb") as scene:
        for block in scene.blocks(level=0):
            draw(block.words(), block.normals())

Only the bytes asked for are read, and every byte is checked before it is trusted. Layout:
spec/blockfile.md.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from gstream.blockview import BlockView
from gstream.errors import CorruptFileError, StoppedError, UsageError
from gstream.formats.arithmetic import Arithmetic, Choice, plain
from gstream.formats.batches import BATCH, SMALL, Batch, cut, decode_batch
from gstream.formats.blockhead import BlockFileHeader, Head, parse_head
from gstream.formats.columns import COLUMN_IDS, ColumnSpec
from gstream.formats.directory import MAX_HEAD_BYTES, STATE_DATA, Rows, merged_runs, payload_span
from gstream.formats.morton import decode_morton, encode_morton
from gstream.formats.pages import Directory
from gstream.source import Ranges, Source, open_ranges

Place = Sequence[int]
Box = tuple[NDArray[np.float64], NDArray[np.float64]]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
U32 = NDArray[np.uint32]

CORNERS: Final = np.indices((2, 2, 2)).reshape(3, 8).T
EVERYWHERE: Final = (np.full(3, -np.inf), np.full(3, np.inf))
RUN_BYTES: Final = 16 << 20  # the longest run that is read for a part of it
IDENTITY: Final = (32, 24)  # where the head has file_bytes and content_id: offset, length


def open_block_file(source: Source, *, choose: Choice = plain, name: str = "") -> "BlockFile":
    """Open a block file; use as a context manager, or close it.

    source : path, URL, the file's bytes, or a callable (offset, length) -> bytes
    choose : what decodes: NumPy, or gstream.compiled's, several times faster
    name : for messages, where the source is no path
    errors : UsageError for what cannot be read; CorruptFileError; UnsupportedError;
        of a URL also, whenever it is read, StoppedError for a network that fails and another file
    """
    ranges = open_ranges(source, name)
    try:
        return BlockFile(ranges, choose)
    except BaseException:
        ranges.close()
        raise


@dataclass(frozen=True, slots=True)
class Voxels:
    """Voxels of one level from many blocks, one row each."""

    level: int
    positions: U32  # (n, 3) voxel coordinates within the level
    columns: Mapping[str, NDArray[Any]]  # by column name, as BlockView.column gives them


class BlockFile:
    """An open block file. Not for use from several threads at once."""

    def __init__(self, ranges: Ranges, choose: Choice = plain) -> None:
        self.path, self._ranges = ranges.name, ranges
        self._choose, self._decoded = choose, 0  # voxels, once for each column that is read
        self.head: Head = parse_head(ranges.begin(MAX_HEAD_BYTES), self.path)
        size = ranges.size()
        if size is not None and size != self.head.file_bytes:
            said = f"the file has {size} bytes, not {self.head.file_bytes}: truncated"
            raise CorruptFileError("GSB-0102", self.path, min(size, self.head.file_bytes), said)
        self._ahead: list[tuple[int, int]] = []  # byte ranges that an iteration will come to
        self.specs: dict[str, ColumnSpec] = {c.name: c for c in self.head.columns}
        self.directory = Directory(self.head, self.read_range, self.path, self.refuse_changed)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close what open_block_file opened; a second call does nothing."""
        self._ranges.close()

    def arithmetic(self, voxels: int) -> Arithmetic:
        """What to decode that many more voxels with."""
        self._decoded += voxels
        return self._choose(self._decoded)

    @property
    def header(self) -> BlockFileHeader:
        """The settings the file was made with."""
        return self.head.settings

    @property
    def resolution(self) -> int:
        """Voxels per axis at level 0."""
        return self.head.settings.resolution

    @property
    def levels(self) -> int:
        """Number of levels; level 0 is the finest."""
        return self.head.settings.levels

    @property
    def block_edge(self) -> int:
        """Voxels along an edge of a block."""
        return 1 << self.head.settings.block_log2

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the stored columns."""
        return tuple(self.specs)

    @property
    def metadata(self) -> Mapping[str, Any]:
        """Units, up, crs (absent, None or a string) and the ledger."""
        return self.head.metadata

    @property
    def content_id(self) -> str:
        """Hash of settings and decoded content, as 32 hex digits."""
        return self.head.content_id.hex()

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Voxel index of level 0 -> world: (3, 4); integer indices are low corners of voxels."""
        return self.level_matrix(0)

    def level_matrix(self, level: int) -> NDArray[np.float64]:
        """Voxel index of a level -> world: (3, 4)."""
        matrix = np.array(self.head.settings.matrix).reshape(3, 4)
        matrix[:, :3] *= 2.0**level
        return matrix

    def read_range(self, offset: int, length: int) -> bytes:
        """Exactly `length` bytes; a shorter read means a truncated file (GSB-0102)."""
        if self._ranges.distant:
            begin, end = self.head.head_bytes, self.head.head_bytes + self._opening_bytes
            if begin <= offset and offset + length <= end:
                self.load_opening()
        return self._ranges.read(offset, length)

    @property
    def _opening_bytes(self) -> int:
        """Length of the opening run; 0 where it is too long to be read for a part of it."""
        return self.head.opening_bytes if self.head.opening_bytes <= RUN_BYTES else 0

    def load_opening(self) -> None:
        """Read the run of the coarsest levels, in one request or none; later reads use it."""
        self._ranges.keep(self.head.head_bytes, self.head.opening_bytes)

    def read_payload(self, entry: Any, offset: int, length: int) -> bytes:
        """Stored bytes of a block's column; from afar, in a run with others that will be wanted."""
        if self._ranges.distant and not self._ranges.holds(offset, length):
            around = [run for run in self._ahead if run[0] <= offset and offset + length <= run[1]]
            if not around:
                rows = self.directory.siblings(int(entry["level"]), int(entry["key"]))
                around = merged_runs(rows, self.head.columns)
            begin, end = around[0]
            if end - begin <= RUN_BYTES:  # more than siblings take: they lie apart, as in no file
                self._ranges.keep(begin, end - begin)
        return self.read_range(offset, length)

    def refuse_changed(self) -> None:
        """Read the head's identity again, where a CRC fails: StoppedError if it is another one."""
        offset, length = IDENTITY
        stated = self.head.file_bytes.to_bytes(8, "little") + self.head.content_id
        if self._ranges.read_at(offset, length) != stated:
            said = f"{self.path}: is no longer the file that was opened"
            raise StoppedError(said, "run again to read it")

    def blocks(self, level: int, columns: Sequence[str] = ()) -> Iterator[BlockView]:
        """The blocks of one level in Morton order, without the empty ones.

        columns : names of those that every block will be asked for: several blocks are decoded at
            once where that is faster. What is wrong with one is said when it is asked for
        """
        return self.blocks_inside(level, EVERYWHERE, columns)

    def blocks_inside(
        self, level: int, box: Box, columns: Sequence[str] = ()
    ) -> Iterator[BlockView]:
        """Blocks whose tight bounds meet a box of voxels of their level, inclusive."""
        self._check_level(level)
        first, last = box
        for entries in self.directory.entries_of(level):
            corner = decode_morton(entries["key"]).astype(np.float64) * self.block_edge
            here = entries["state"] == STATE_DATA
            here &= (corner + entries["high"] >= first).all(axis=1)
            here &= (corner + entries["low"] <= last).all(axis=1)
            entries = entries[here]
            if self._ranges.distant:
                self._ahead = merged_runs(entries, self.head.columns)
            for begin, end in pairwise(cut(entries["count"])):
                yield from self._views(entries[begin:end], columns)

    def _views(self, entries: Rows, names: Sequence[str]) -> list[BlockView]:
        """Blocks with their columns, as far as these can be decoded all at once."""
        views = [BlockView(self, entry) for entry in entries]
        small = entries["count"].mean() <= SMALL
        for name, batch in self.decode(entries, names if small else ()).items():
            for view, values in zip(views, batch.blocks(), strict=True):
                if values is not None:
                    view.decoded[name] = values
        return views

    def decode(self, entries: Rows, names: Iterable[str]) -> dict[str, Batch]:
        """Columns of some entries with voxels, all at once; none where that would not pay.

        It pays for up to BATCH voxels, near each other in a near file, where decoding is compiled.
        """
        kernels = self.arithmetic(0).batches
        specs = [s for s in map(self.specs.get, names) if s is not None and s.id in COLUMN_IDS]
        voxels = int(entries["count"].sum(dtype=np.int64))
        if kernels is None or not specs or not 0 < voxels <= BATCH or self._ranges.distant:
            return {}
        begin, end = payload_span(entries, specs)
        if end - begin > RUN_BYTES:
            return {}
        with suppress(CorruptFileError):  # too short: the column that it cuts says so
            run = memoryview(self.read_range(begin, end - begin))
            log2_edge = self.head.settings.block_log2
            return {s.name: decode_batch(s, entries, run, begin, log2_edge, kernels) for s in specs}
        return {}

    def block(self, level: int, place: Place) -> BlockView | None:
        """The block at block coordinates (x, y, z) of a level; None where there is no voxel."""
        self._check_level(level)
        if not all(0 <= c < 1 << 16 for c in place):
            return None
        entry = self.directory.find(level, int(encode_morton(np.array([place]))[0]))
        return BlockView(self, entry) if entry is not None and entry["state"] else None

    def region(
        self,
        low: Sequence[float],
        high: Sequence[float],
        level: int = 0,
        columns: Sequence[str] = (),
    ) -> Voxels:
        """The voxels of a level that touch a world box.

        low, high : corners of the box, world units, both inclusive
        columns : names of the columns wanted beside the positions
        A box that is oblique to the grid is taken as its bounding box in voxel indices.
        errors : UnsupportedError for a column that the file does not store
        """
        first, last = box = self.index_box(low, high, level)
        parts: list[tuple[U32, list[NDArray[Any]]]] = []
        for block in self.blocks_inside(level, box, ("occupancy", *columns)):
            positions = block.positions()
            inside = ((positions >= first) & (positions <= last)).all(axis=1)
            parts.append((positions[inside], [block.column(n)[inside] for n in columns]))
        if not parts:
            return Voxels(level, np.empty((0, 3), np.uint32), {n: np.empty(0) for n in columns})
        merged = {n: np.concatenate([p[1][i] for p in parts]) for i, n in enumerate(columns)}
        return Voxels(level, np.concatenate([p[0] for p in parts]), merged)

    def index_box(self, low: Sequence[float], high: Sequence[float], level: int) -> Box:
        """First and last voxel of a level, both inclusive, whose closed cubes touch a world box."""
        matrix = self.level_matrix(level)
        corners = np.where(CORNERS, np.asarray(high, float), np.asarray(low, float))
        index = np.linalg.solve(matrix[:, :3], (corners - matrix[:, 3]).T).T
        return np.ceil(index.min(axis=0)) - 1, np.floor(index.max(axis=0))

    def _check_level(self, level: int) -> None:
        if not 0 <= level < self.levels:
            raise UsageError(f"{self.path}: there is no level {level}", f"0 to {self.levels - 1}")
