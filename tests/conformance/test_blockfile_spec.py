"""spec/blockfile.md against the writer: its decoder, its dump and its tables.

The decoder is the spec's own; it imports numpy and lz4, and nothing of gstream.
"""

import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from damaged_block_files import smallest_scene
from small_block_files import ALL, Paging, Scene, file_bytes, random_scene

from gstream.blockcheck import iter_findings
from gstream.formats import blockhead, directory, lodrule
from gstream.formats.blockmeta import MAX_META_BYTES
from gstream.formats.framing import decompress
from gstream.formats.morton import encode_morton
from gstream.read import open_block_file

FOLDER = Path(__file__).parents[2] / "spec"
VECTORS = FOLDER / "vectors" / "good"
SPEC = (FOLDER / "blockfile.md").read_text()
DECODER = FOLDER / "reference_decoder.py"
NAMES = {
    1: "occupancy",
    2: "mask",
    3: "normal",
    4: "colour",
    5: "weight",
}  # column ids of section 7


def fenced(heading: str) -> str:
    """The code block behind a heading."""
    body = SPEC.split(f"\n{heading}", 1)[1]
    return body.split("```", 2)[1].split("\n", 1)[1]


@pytest.fixture(scope="module")
def decoder():
    return SimpleNamespace(**runpy.run_path(str(DECODER)))


@pytest.fixture(scope="module")
def viewer():
    names: dict[str, object] = {}
    exec(compile(fenced("What a viewer does"), "spec/blockfile.md", "exec"), names)
    return SimpleNamespace(**names)


def smallest_of_the_page() -> bytes:
    lines = [line.split("  ") for line in fenced("## 13. The smallest file").splitlines()]
    last_at, last = int(lines[-1][0], 16), bytes.fromhex(lines[-1][1])
    data = bytearray(last_at + len(last))
    for at, row in lines:
        data[int(at, 16) : int(at, 16) + 16] = bytes.fromhex(row)
    return bytes(data)


def decoded(decoder: SimpleNamespace, data: bytes) -> list[tuple[int, int, dict]]:
    """(level, key, {column: values as gstream has them}) of each block that the decoder yields."""
    found = []
    for level, counts, columns in decoder.blocks(data):
        key = int(columns.pop("key"))
        values = {
            name: v.T if len(v) > 1 and v.ndim > 1 else v.ravel()
            for name, v in columns.items()
            if v is not None
        }
        assert counts == {"blocks": 1, "voxels": len(values["occupancy"])}
        found.append((level, key, values))
    return found


def agrees(decoder: SimpleNamespace, data: bytes, scene: Scene) -> None:
    blocks = decoded(decoder, data)
    wanted = sorted(scene.blocks.items(), key=lambda item: (-item[0][0], item[0][1]))
    assert [block[:2] for block in blocks] == [place for place, _ in wanted]
    for (_, _, columns), (_, block) in zip(blocks, wanted, strict=True):
        np.testing.assert_array_equal(columns.pop("occupancy"), block.morton)
        for name, values in columns.items():
            np.testing.assert_array_equal(values, getattr(block, name), err_msg=name)


def test_the_decoder_is_shorter_than_200_lines_and_knows_nothing_of_gstream():
    text = DECODER.read_text()
    assert len(text.splitlines()) < 200
    assert set(re.findall(r"^(?:import|from) ([\w.]+)", text, re.MULTILINE)) == {
        "hashlib", "json", "struct", "sys", "zlib", "lz4.block", "numpy",
    }  # fmt: skip


def test_the_decoder_is_the_one_that_the_spec_prints():
    assert fenced("## 14. Reference decoder") == DECODER.read_text()


def test_the_dump_is_what_the_writer_writes_and_is_valid():
    data = smallest_of_the_page()
    assert data == file_bytes(smallest_scene())
    assert list(iter_findings(data)) == []


def test_the_decoder_reads_the_dump(decoder):
    ((level, key, columns),) = decoded(decoder, smallest_of_the_page())
    code = int(encode_morton(np.array([[1, 2, 3]]))[0])
    assert (level, key, columns["occupancy"], columns["mask"]) == (0, 0, [code], [63])


@pytest.mark.parametrize("log2", [3, 4, 6])
@pytest.mark.parametrize("bits", [8, 11, 12])
def test_the_decoder_reads_every_block_edge_and_normal_width(decoder, log2, bits):
    scene = random_scene(4 << log2, log2, 200, bits, bits=bits)
    agrees(decoder, file_bytes(scene), scene)


@pytest.mark.parametrize("paging", [Paging(8), Paging(8, 4, 5)])
def test_the_decoder_reads_both_depths_of_the_page_table(decoder, paging):
    scene = random_scene(64, 3, 150)
    agrees(decoder, file_bytes(scene, paging=paging), scene)


@pytest.mark.parametrize("kept", [ALL[:2], ALL[:3], ("occupancy", "mask", "colour")])
def test_the_decoder_reads_files_with_fewer_columns(decoder, kept):
    scene = random_scene(32, 3, 100)
    agrees(decoder, file_bytes(scene, kept=kept, extra=[(b"note", b"hello")]), scene)


def test_the_decoder_reads_smooth_columns_whatever_filter_they_took(decoder):
    scene = random_scene(64, 4, 4000)
    for block in scene.blocks.values():
        ramp = np.arange(block.count)
        block.mask[:] = 1 + ramp % 3
        block.colour[:] = (ramp[:, None] // 7 + np.arange(4)) % 256
        block.weight[:] = 1 + ramp * 70_001
    agrees(decoder, file_bytes(scene), scene)


@pytest.mark.parametrize("path", sorted(VECTORS.glob("blocks-*.gsb")), ids=lambda path: path.stem)
def test_the_decoder_reads_every_good_vector_as_the_reader_does(decoder, path):
    with open_block_file(path) as file:
        views = [view for level in range(file.levels)[::-1] for view in file.blocks(level)]
        for view, (level, key, columns) in zip(
            views, decoded(decoder, path.read_bytes()), strict=True
        ):
            assert (level, key) == (view.level, view.key)
            for name, values in columns.items():
                np.testing.assert_array_equal(values, view.column(name))


def test_the_viewers_places_are_the_morton_codes_inverse(viewer):
    xyz = np.random.default_rng(1).integers(0, 1 << 16, (1000, 3))
    np.testing.assert_array_equal(viewer.places(encode_morton(xyz)), xyz)


def test_the_decoder_finds_a_cut_and_a_flip(decoder):
    data = file_bytes(random_scene(16, 3, 10))
    for damaged in (data[:-1], data[:-500], data[:20] + b"\1" + data[21:]):
        with pytest.raises(ValueError, match=r"GSB-010[23]"):
            list(decoder.blocks(damaged))


def test_the_lz4_library_takes_a_match_at_offset_0_for_zeros():
    block = bytes([0x1F, ord("a"), 0, 0, 0, 0x50]) + b"bcdef"
    assert decompress(block, 25, "", "", 0) == b"a" + bytes(19) + b"bcdef"


@pytest.mark.parametrize("bits", [8, 11])
def test_the_viewers_directions_are_the_lod_rules(viewer, bits):
    fields = np.random.default_rng(2).integers(0, (1 << bits) - 1, (2000, 2)).astype(np.uint16)
    fields = fields[lodrule.canonical_normals(fields, bits)]
    fields[0] = (1 << bits) - 1
    np.testing.assert_array_equal(
        viewer.directions(fields.astype(np.int64), bits), lodrule.decode_normals(fields, bits)
    )


def test_the_colour_table_of_the_page_is_the_one_in_use():
    printed = [int(word) for word in fenced("### 8.4 Colours").split()]
    assert printed == lodrule.LINEAR_OF_CODE.tolist()


@pytest.mark.parametrize(
    ("heading", "kind"),
    [
        ("### 5.2 Entry", directory.entry_dtype([])),
        ("### 5.3 Column record", directory.RECORD_DTYPE),
        ("**LEVL**", directory.LEVEL_DTYPE),
        ("**COLM**", directory.COLUMN_DTYPE),
        ("**PAGE**", directory.PAGE_DTYPE),
    ],
)
def test_byte_tables_of_the_page_are_the_layouts_in_use(heading, kind):
    table = SPEC.split(f"\n{heading}", 1)[1].split("\n|", 1)[1].split("\n\n", 1)[0]
    printed = [
        (int(at), int(size)) for at, size in re.findall(r"^\| (\d+) \| (\d+) \|", table, re.M)
    ]
    used = [(at, field.itemsize) for field, at in (f[:2] for f in kind.fields.values())]
    assert printed == used


def test_limits_of_the_page_are_the_ones_in_use():
    limits = SPEC.split("## 10. Limits", 1)[1].split("\n## ", 1)[0]
    for text in (
        f"| levels | 1 | {blockhead.MAX_LEVELS} |",
        f"| columns | 1 | {directory.MAX_COLUMNS} |",
        f"| sections | 4 | {blockhead.MAX_SECTIONS} |",
        f"| META | 13 | {MAX_META_BYTES:,} bytes |".replace(",", " "),
        f"| rows of PAGE | 0 | {blockhead.PAGE_CAPACITY:,} |".replace(",", " "),
    ):
        assert text in limits
    assert f"2^{blockhead.MAX_BLOCKS.bit_length() - 1}" in limits


def test_the_head_holds_the_largest_tables_that_the_limits_allow():
    rows = blockhead.MAX_SECTIONS + blockhead.MAX_LEVELS + directory.MAX_COLUMNS
    used = 256 + 32 * (rows + blockhead.PAGE_CAPACITY) + MAX_META_BYTES
    assert used <= directory.MAX_HEAD_BYTES - 4
