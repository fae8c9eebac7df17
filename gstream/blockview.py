"""One block of an open block file; its columns are read and decoded when they are asked for."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats.columns import COLUMN_IDS, ColumnSpec, Record, decode_column, octree_masks
from gstream.formats.framing import crc32
from gstream.formats.lodrule import unit_vectors
from gstream.formats.morton import decode_one
from gstream.formats.pieces import (
    PIECE_IDS,
    TRIANGLE,
    VERTEX,
    Pieces,
    check_numbers,
    decode_piece_column,
    items_of,
)

if TYPE_CHECKING:
    from gstream.read import BlockFile

U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
U32 = NDArray[np.uint32]


class BlockView:
    """One block of an open file; its columns are read and decoded when they are asked for."""

    __slots__ = ("_place", "children", "count", "decoded", "entry", "file", "key", "level")

    def __init__(self, file: "BlockFile", entry: Any) -> None:
        self.file, self.entry = file, entry
        self.level = int(entry["level"])  # 0 = finest
        self.key = int(entry["key"])  # Morton code of the block within its level
        self.count = int(entry["count"])  # voxels
        self.children = int(entry["children"])  # bit c: block 8 * key + c of the next finer level
        self.decoded: dict[str, NDArray[Any]] = {}  # columns so far
        self._place: tuple[int, int, int] | None = None

    @property
    def place(self) -> tuple[int, int, int]:
        """Block coordinates (x, y, z) within the level."""
        if self._place is None:
            self._place = decode_one(self.key)
        return self._place

    @property
    def corner(self) -> NDArray[np.int64]:
        """(3,) voxel coordinates of the block's first voxel within its level."""
        return np.array(self.place, np.int64) * self.file.block_edge

    @property
    def low(self) -> U8:
        """(3,) low corner of the tight bounds in the block, inclusive."""
        return np.asarray(self.entry["low"])

    @property
    def high(self) -> U8:
        """(3,) high corner of the tight bounds in the block, inclusive."""
        return np.asarray(self.entry["high"])

    def stored(self, name: str) -> bytes:
        """The stored bytes of one column, their CRC checked (GSB-0411)."""
        return self._stored(name)[0]

    def column(self, name: str) -> NDArray[Any]:
        """One decoded column: (n,) or (n, components); occupancy as (n,) u32 Morton codes.

        n is `count`, but of the columns of `pieces`.
        errors : UnsupportedError for a column that the file lacks or an unknown codec;
                 CorruptFileError GSB-04..
        """
        if name not in self.decoded:
            spec = self._known(name)
            if spec.id in PIECE_IDS:
                return self._piece_column(spec)
            data, record, offset = self._stored(name)
            self.decoded[name] = decode_column(
                spec, record, data, self.count, self.file.head.settings.block_log2,
                filters=self.file.arithmetic(self.count).filters, path=self.file.path, at=offset,
            )  # fmt: skip
        return self.decoded[name]

    def pieces(self) -> Pieces:
        """The source triangles in the block, cut at its borders; none above level 0.

        errors : as `column`
        """
        return Pieces(self.column(VERTEX), self.column(TRIANGLE))

    @property
    def piece_counts(self) -> tuple[int, int]:
        """How many vertices and source triangles the block has; nothing is read."""
        specs = map(self.file.specs.get, (VERTEX, TRIANGLE))
        raw = [int(self.entry[spec.field]["raw"]) if spec else 0 for spec in specs]
        return items_of(raw[0]), items_of(raw[1])

    def _piece_column(self, spec: ColumnSpec) -> NDArray[Any]:
        data, record, offset = self._stored(spec.name)
        values = decode_piece_column(
            spec, record, data, filters=self.file.arithmetic(items_of(record.raw_bytes)).filters,
            path=self.file.path, at=offset,
        )  # fmt: skip
        if spec.name == TRIANGLE:
            check_numbers(values, self.piece_counts[0], self.file.path, offset)
        return values

    def octree(self) -> U8:
        """(nodes,) u8: the raw occupancy column, child masks of the octree; errors as `column`."""
        self._known("occupancy")
        data, record, offset = self._stored("occupancy")
        return octree_masks(
            record, data, self.count, self.file.head.settings.block_log2,
            filters=self.file.arithmetic(0).filters, path=self.file.path, at=offset,
        )  # fmt: skip

    def _known(self, name: str) -> ColumnSpec:
        spec = self.file.specs.get(name)
        if spec is None:
            remedy = f"the file stores {', '.join(self.file.columns)}"
            raise UnsupportedError(self.file.path, f"there is no column {name!r}", remedy)
        if spec.id not in COLUMN_IDS and spec.id not in PIECE_IDS:
            said = f"column {name!r} is of a kind that this release does not know"
            raise UnsupportedError(self.file.path, said, "upgrade gstream")
        return spec

    def _stored(self, name: str) -> tuple[bytes, Record, int]:
        """Stored bytes, what decoding must know of them, and where they lie."""
        # One call for the eight fields of a column record: each field alone costs as much.
        entry = self.entry[self.file.specs[name].field]
        offset, stored, raw, crc, constant, codec, filter_id, _ = entry.item()
        data = self.file.read_payload(self.entry, offset, stored) if stored else b""
        if data and crc32(data) != crc:
            self.file.refuse_changed()
            said = f"column {name} of block {self.key}, level {self.level}, does not match its CRC"
            raise CorruptFileError("GSB-0411", self.file.path, offset, said)
        return data, Record(codec, filter_id, constant, raw), offset

    def positions(self) -> U32:
        """(n, 3) u32 voxel coordinates x, y, z within the level, in Morton order."""
        decode = self.file.arithmetic(self.count).decode_morton
        return decode(self.column("occupancy")) + self.corner.astype(np.uint32)

    @property
    def mask(self) -> U8:
        """(n,) u8 face masks, bits 0 to 5 = -x +x -y +y -z +z."""
        return self.column("mask")

    @property
    def normal_codes(self) -> U16:
        """(n, 2) u16 octahedral codes."""
        return self.column("normal")

    def normals(self) -> NDArray[np.float32]:
        """(n, 3) unit vectors in grid axes; 0, 0, 0 where the voxel has no direction."""
        bits = self.file.specs["normal"].bits if "normal" in self.file.specs else 0
        decode = self.file.arithmetic(self.count).decode_normals
        return unit_vectors(decode(self.normal_codes, bits))

    @property
    def colour(self) -> U8:
        """(n, 4) u8 RGBA, sRGB codes, straight alpha."""
        return self.column("colour")

    @property
    def weight(self) -> U32:
        """(n,) u32 surface in the voxel, unit 2^-20 voxel faces of the block's level."""
        return self.column("weight")

    def words(self) -> U32:
        """(n,) u32: x | y << 8 | z << 16 within the block, face mask in bits 24 to 29."""
        local = self.file.arithmetic(self.count).decode_morton(self.column("occupancy"))
        parts = (local[:, 0], local[:, 1], local[:, 2], self.mask.astype(np.uint32))
        words = np.zeros(len(local), np.uint32)
        for i, part in enumerate(parts):
            words |= part << np.uint32(8 * i)
        return words
