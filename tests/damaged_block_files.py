"""Damaged block files, one per rule, and sound ones that use every freedom of the spec.

`python tests/damaged_block_files.py spec/vectors` writes the vectors that are missing; one that is
there is never written again.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from struct import Struct
from zlib import crc32

import numpy as np
import piece_block_files as piece
import pytest
import rare_block_files as rare
from filtered_block_files import every_filter
from small_block_files import ALL, IDENTITY, Paging, Scene, file_bytes, random_scene

import gstream.formats.blockfile
from gstream.formats.blockhead import BlockFileHeader
from gstream.formats.columns import Block
from gstream.formats.directory import entry_dtype
from gstream.formats.framing import CODEC_CONSTANT, CODEC_LZ4, CODEC_RAW
from gstream.formats.morton import encode_morton
from gstream.read import open_block_file

SECTION = Struct("<4sIQQI4x")


class Patch:
    """A block file whose bytes are changed, and whose CRCs are then made right again."""

    def __init__(self, data: bytes) -> None:
        self.data = bytearray(data)
        self.head = int.from_bytes(data[28:32], "little")
        self.columns = open_block_file(data).head.columns
        self.sections = {}
        for i in range(data[238]):
            kind, _, offset, length, _ = SECTION.unpack_from(data, 256 + 32 * i)
            self.sections[kind.decode()] = (offset, length)
        at, length = self.sections["PAGE"]
        self.page_records = np.frombuffer(self.data, "<u8", length // 8, at).reshape(-1, 4)

    @property
    def entries(self) -> np.ndarray:
        """The entries of page 0 of a file of depth 1, writable."""
        at = int(self.page_records[0, 2])
        count = int(self.page_records[0, 0] >> 32)
        return np.frombuffer(self.data, entry_dtype(self.columns), count, at)

    def at(self, offset: int, value: bytes) -> "Patch":
        self.data[offset : offset + len(value)] = value
        return self

    def flip(self, offset: int) -> "Patch":
        self.data[offset] ^= 1
        return self

    def entry(self, row: int, field: str, value: object, column: str = "") -> "Patch":
        target = self.entries[column] if column else self.entries
        target[field][row] = value
        return self

    def payload(self, row: int, column: str, value: bytes) -> "Patch":
        """Overwrite the first stored bytes of a column, and set its CRC."""
        record = self.entries[column][row : row + 1]
        offset, stored = int(record["offset"][0]), int(record["stored"][0])
        self.at(offset, value)
        record["crc"] = crc32(self.data[offset : offset + stored])
        return self

    def sealed(self) -> bytes:
        """The file with the CRCs of pages (of depth 1), head and tail made right."""
        if self.data[236] == 1:
            for record in self.page_records:
                at, length = int(record[2]), int(record[3] & 0xFFFFFFFF)
                record[3] = length | crc32(self.data[at : at + length]) << 32
        head = crc32(self.data[: self.head - 4])
        self.at(self.head - 4, head.to_bytes(4, "little"))
        tail = len(self.data) - 64
        self.at(tail + 12, self.data[32:40]).at(tail + 20, self.data[40:56])
        self.at(tail + 36, head.to_bytes(4, "little"))
        self.at(len(self.data) - 4, crc32(self.data[tail:-4]).to_bytes(4, "little"))
        return bytes(self.data)


def tiny(**changes: object) -> Scene:
    scene = random_scene(resolution=16, voxels=23, seed=5)
    return replace(scene, **changes)


ROOT = tiny().blocks[(1, 0)].count
PLANES = 6 * ((ROOT + 7) // 8)


def tiny_file(**arguments: object) -> bytes:
    return file_bytes(tiny(), **arguments)


@cache
def sound_file() -> bytes:
    return tiny_file()


def smallest_file() -> bytes:
    scene = random_scene(resolution=16, voxels=3, seed=5, names=ALL[:3])
    return file_bytes(scene)


def patch() -> Patch:
    return Patch(sound_file())


def with_column(name: str, level: int, **fields: object) -> bytes:
    """A file whose column of the first block of a level is replaced; its CRC is made right."""
    changed: list[int] = []

    def alter(at: int, key: int, encoded: dict) -> None:
        if at == level and not changed:
            column = replace(encoded[name], **fields)
            encoded[name] = replace(column, crc=crc32(column.data) if column.data else 0)
            changed.append(key)

    return tiny_file(alter=alter)


def with_root(name: str, change: Callable[[np.ndarray], np.ndarray]) -> bytes:
    """A file whose coarsest block has another column than the LOD rule gives."""
    scene = tiny()
    top = (scene.header.levels - 1, 0)
    scene.blocks[top] = replace(
        scene.blocks[top], **{name: change(getattr(scene.blocks[top], name))}
    )
    return file_bytes(scene)


def without_a_voxel() -> bytes:
    scene = tiny()
    root = scene.blocks[(1, 0)]
    arrays = {name: getattr(root, name)[1:] for name in ALL[1:]}
    scene.blocks[(1, 0)] = replace(root, morton=root.morton[1:], **arrays)
    return file_bytes(scene)


def with_rows(*changes: tuple[str, int, object]) -> bytes:
    def alter(rows: np.ndarray) -> np.ndarray:
        for field, row, value in changes:
            rows[field][row] = value
        return rows

    return tiny_file(alter_rows=alter)


def with_ledger(**ledger: object) -> bytes:
    return file_bytes(tiny(ledger=ledger))


def split_group() -> bytes:
    with pytest.MonkeyPatch.context() as patched:
        starts = np.array([0, 2, len(tiny().blocks)])
        patched.setattr(gstream.formats.blockfile, "page_starts", lambda *_: starts)
        return tiny_file()


def with_a_gap() -> bytes:
    """Eight bytes of zeros between the last payload and the tail."""
    sound, crc = sound_file(), patch().head - 4
    data = bytearray(sound[:-64] + bytes(8) + sound[-64:])
    data[32:40] = len(data).to_bytes(8, "little")
    data[crc : crc + 4] = crc32(data[:crc]).to_bytes(4, "little")
    return Patch(bytes(data)).sealed()


def pages_in_other_places() -> bytes:
    """The second and the third page, each in the other's place."""
    made = Patch(file_bytes(rare.scattered(3, 8), paging=Paging(1)))
    first, second = made.page_records[1:3, 2].tolist()
    length = second - first
    made.data[first : second + length] = made.data[second:][:length] + made.data[first:second]
    made.page_records[1:3, 2] = second, first
    return made.sealed()


def childless() -> bytes:
    """A block of level 1 that is stated to be empty and has no children."""
    scene = random_scene(resolution=32, voxels=2, seed=5)
    key = next(key for key in range(8) if (1, key) not in scene.blocks)

    def alter(rows: np.ndarray) -> np.ndarray:
        empty = np.zeros(1, rows.dtype)
        empty["key"], empty["level"] = key, 1
        rows["children"][rows["level"] == 2] |= 1 << key
        return np.concatenate([rows, empty])

    return file_bytes(scene, alter_rows=alter)


def empty_with_voxels() -> bytes:
    return patch().entry(1, "state", 0).sealed()


def wrong_level_table() -> bytes:
    made = patch()
    return made.at(made.sections["LEVL"][0] + 8, b"\7").sealed()


def lower_resolution() -> bytes:
    scene = tiny()
    box = replace(scene.header, resolution=11)
    return file_bytes(replace(scene, header=box))


def section_place() -> bytes:
    return patch().at(256 + 3 * 32 + 8, b"\xff").sealed()


def renamed_column() -> bytes:
    made = patch()
    return made.at(made.sections["COLM"][0] + 32 + 8, b"musk").sealed()


def damaged_table_page() -> bytes:
    made = Patch(tiny_file(paging=Paging(8, 1, 1)))
    return bytes(made.flip(made.head + 9).data)


def broken_metadata() -> bytes:
    made = patch()
    return made.at(made.sections["META"][0], b"[").sealed()


def tail_with_a_reserved_byte() -> bytes:
    data = bytearray(sound_file())
    data[-10] = 1
    data[-4:] = crc32(data[-64:-4]).to_bytes(4, "little")
    return bytes(data)


def lz4_that_ends_in_a_match() -> bytes:
    """It unpacks to the right masks, but LZ4 wants literals at the end of a block."""
    data = bytes([0x1F, 63, 1, 0, ROOT - 1 - 4 - 15, 0])
    return with_column("mask", 1, data=data, codec=CODEC_LZ4, filter=0)


def no_rows_in_page() -> bytes:
    made = patch()
    return made.at(made.sections["PAGE"][0] + 4, bytes(4)).sealed()


def other_first_key() -> bytes:
    made = patch()
    return made.at(made.sections["PAGE"][0] + 8, b"\1").sealed()


def patch_voxels() -> bytes:
    made = patch()
    at, length = made.sections["META"]
    text = bytes(made.data[at : at + length])
    digit = text.index(b'"voxels":[') + len(b'"voxels":[')
    return made.at(at + digit, b"9").sealed()


DAMAGE: dict[str, Callable[[], bytes]] = {
    "GSB-0101": lambda: bytes(patch().flip(1).data),
    "GSB-0102": lambda: bytes(patch().flip(-20).data),
    "GSB-0102-reserved": tail_with_a_reserved_byte,
    "GSB-0103": lambda: bytes(patch().flip(60).data),
    "GSB-0104": lambda: patch().at(69, b"\1").sealed(),
    "GSB-0105": lambda: patch().at(56, bytes(4)).sealed(),
    "GSB-0106": lambda: patch().at(72, np.float64(np.nan).tobytes()).sealed(),
    "GSB-0201": section_place,
    "GSB-0202": lambda: bytes(Patch(tiny_file(extra=[(b"note", b"hello")])).flip(-65).data),
    "GSB-0203": wrong_level_table,
    "GSB-0204": renamed_column,
    "GSB-0205": broken_metadata,
    "GSB-0206": no_rows_in_page,
    "GSB-0206-reserved": lambda: patch().at(patch().sections["PAGE"][0] + 1, b"\1").sealed(),
    "GSB-0207": damaged_table_page,
    "GSB-0301": lambda: bytes(patch().flip(patch().head + 30).data),
    "GSB-0302": other_first_key,
    "GSB-0303": lambda: patch().entry(2, "key", 0).entry(1, "key", 7).sealed(),
    "GSB-0304": split_group,
    "GSB-0305": lambda: patch().entry(1, "high", 200).sealed(),
    "GSB-0306": lambda: with_rows(("children", -1, 1)),
    "GSB-0306-no-children": childless,
    "GSB-0307": lambda: tiny_file(alter_rows=lambda rows: rows[rows["level"] == 0]),
    "GSB-0308": empty_with_voxels,
    "GSB-0309": lambda: patch().entry(1, "zero", 1).sealed(),
    "GSB-0310": lambda: patch().at(224, b"\1").sealed(),
    "GSB-0311": lambda: patch().entry(1, "codec", CODEC_CONSTANT, "occupancy").sealed(),
    "GSB-0312": lambda: patch().entry(1, "offset", patch().head + 64, "occupancy").sealed(),
    "GSB-0312-gap": with_a_gap,
    "GSB-0312-order-of-pages": pages_in_other_places,
    "GSB-0401": lambda: with_column("weight", 1, data=b"\xff\xff\xff", codec=CODEC_LZ4),
    "GSB-0401-end-of-lz4": lz4_that_ends_in_a_match,
    "GSB-0402": lambda: with_column("weight", 1, raw_bytes=5),
    "GSB-0403": lambda: with_column(
        "mask", 1, data=b"", codec=CODEC_CONSTANT, filter=0, constant=64
    ),
    "GSB-0404": lambda: with_column("mask", 1, filter=5),
    "GSB-0405": lambda: with_column("mask", 1, data=b"\x40" * ROOT, codec=CODEC_RAW, filter=0),
    "GSB-0406": lambda: with_column("mask", 1, data=b"\xff" * PLANES, codec=CODEC_RAW, filter=2),
    "GSB-0407": lambda: patch().payload(0, "occupancy", b"\0").sealed(),
    "GSB-0408": lambda: patch().payload(0, "occupancy", b"\x01").sealed(),
    "GSB-0409": lambda: patch().entry(1, "count", 513).sealed(),
    "GSB-0410": lambda: with_root("mask", lambda mask: mask * 0),
    "GSB-0411": lambda: bytes(patch().flip(-65).data),
    "GSB-0412": lambda: patch().entry(1, "codec", 9, "mask").sealed(),
    "GSB-0501": lambda: with_rows(("low", -1, 3), ("high", -1, 3)),
    "GSB-0502": lower_resolution,
    "GSB-0503": without_a_voxel,
    "GSB-0504": lambda: with_root("mask", lambda mask: np.where(mask == 63, 62, 63).astype("u1")),
    "GSB-0505": lambda: with_root("normal", lambda normal: np.roll(normal, 1, axis=0)),
    "GSB-0506": lambda: with_root("colour", lambda colour: colour ^ 1),
    "GSB-0507": lambda: with_root("weight", lambda weight: weight + 1),
    "GSB-0508": lambda: tiny_file(kept=ALL[:-1]),
    "GSB-0509": lambda: patch().at(40, b"0123").sealed(),
    "GSB-0601": lambda: with_ledger(triangles=3, assigned=2),
    "GSB-0602": patch_voxels,
    "GSB-0603": lambda: with_ledger(triangles=1, assigned=1, degenerate=2),
    **piece.DAMAGE,
}


def smallest_scene() -> Scene:
    """The file that section 13 of the spec prints."""
    code = encode_morton(np.array([[1, 2, 3]])).astype(np.uint32)
    header = BlockFileHeader(8, 12, 1, 3, IDENTITY, (0.0, 0.0, 0.0, 8.0, 8.0, 8.0))
    block = Block(code, np.array([63], np.uint8))
    return Scene(header, {(0, 0): block}, ("occupancy", "mask"))


GOOD: dict[str, Callable[[], bytes]] = {
    "blocks-smallest": lambda: file_bytes(smallest_scene()),
    "blocks-all-columns": sound_file,
    "blocks-every-filter": every_filter,
    "blocks-no-voxels": lambda: file_bytes(tiny(blocks={})),
    "blocks-one-level": lambda: file_bytes(random_scene(voxels=30, lod=False)),
    "blocks-empty-block": lambda: rare.with_empty_blocks(1),
    "blocks-empty-branch": lambda: rare.with_empty_blocks(2),
    "blocks-table-pages": lambda: file_bytes(random_scene(64, voxels=40), paging=Paging(8, 4, 5)),
    "blocks-count-weighting": lambda: file_bytes(random_scene(16, voxels=20, weighting="count")),
    "blocks-without-weights": lambda: tiny_file(kept=ALL[:-1]),
    "blocks-metadata": lambda: tiny_file(meta={"crs": None, "units": "mm", "up": "z"}),
    "blocks-unknown-section": lambda: tiny_file(extra=[(b"note", b"hello"), (b"more", b"")]),
    "blocks-ignorable-features": lambda: patch().at(20, b"\1").at(24, b"\1").sealed(),
    "blocks-normal-bits-8": lambda: file_bytes(random_scene(16, voxels=20, bits=8)),
    "blocks-edge-256": lambda: file_bytes(random_scene(300, 8, 40)),
    "blocks-occupancy-only": lambda: tiny_file(kept=ALL[:1]),
    "blocks-newer-writer": lambda: patch().at(14, b"\xff\xff").sealed(),
    "blocks-other-settings": rare.other_settings,
    "blocks-full-64": lambda: rare.full_block(6, ALL[:4]),
    "blocks-full-256": lambda: rare.full_block(8, ALL[:2]),
    "blocks-resolution-1": lambda: rare.last_voxel(1, 1),
    "blocks-17-levels": lambda: rare.last_voxel(65_536, 17),
    "blocks-most-tables": rare.most_tables,
    "blocks-most-pages": lambda: file_bytes(rare.scattered(1400, 8), paging=Paging(1)),
    "blocks-full-page": lambda: file_bytes(rare.scattered(1032, 1)),
    **piece.GOOD,
}


def write_missing(folder: Path) -> None:
    """Write the vectors that are not there."""
    for kind, table in (("good", GOOD), ("bad", DAMAGE)):
        for name, make in table.items():
            path = folder / kind / f"{name}.gsb"
            if not path.exists():
                path.write_bytes(make())


if __name__ == "__main__":
    write_missing(Path(sys.argv[1]))
