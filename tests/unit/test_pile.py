"""Piles: what is added comes back, and a damaged one is refused by a rule."""

import io

import numpy as np
import pytest
from small_block_files import pile_bytes, random_scene

from gstream.errors import CorruptFileError
from gstream.formats.columns import column_specs, decode_column, hash64, raw_form
from gstream.formats.directory import stacked
from gstream.formats.filters import encode_occupancy
from gstream.formats.framing import crc32
from gstream.formats.pile import FOOTER, HEAD, PileWriter, pile_dtype, read_pile_rows


def rows_of(data: bytes):
    return read_pile_rows(lambda at, n: data[at : at + n], len(data))


def test_rows_come_back_in_the_order_of_add_with_the_fields_that_were_given():
    scene = random_scene(seed=3)
    rows = rows_of(pile_bytes(scene))
    assert [(int(r["level"]), int(r["key"])) for r in rows] == list(scene.blocks)
    assert [int(r["count"]) for r in rows] == [b.count for b in scene.blocks.values()]
    assert (rows["state"] == 1).all()
    assert (rows["pile"] == 0).all()


def test_every_column_decodes_from_its_place_in_the_pile_and_has_its_hash():
    scene = random_scene(seed=4)
    data = pile_bytes(scene)
    specs = column_specs(11)
    for row, block in zip(rows_of(data), scene.blocks.values(), strict=True):
        for name in scene.names:
            record = row[name]
            at, stored = int(record["offset"]), int(record["stored"])
            payload = data[at : at + stored]
            assert crc32(payload) == record["crc"]
            wanted = block.morton if name == "occupancy" else getattr(block, name)
            values = decode_column(
                specs[name], _Record(record), payload, block.count, 3, path="pile", at=at
            )
            np.testing.assert_array_equal(values, wanted)
            raw = encode_occupancy(values, 3) if name == "occupancy" else values
            assert row["hash"][name] == hash64(raw_form(raw).data)


class _Record:
    def __init__(self, record):
        self.codec, self.filter = int(record["codec"]), int(record["filter"])
        self.constant, self.raw_bytes = int(record["constant"]), int(record["raw"])


def test_rows_of_several_piles_concatenate_and_are_told_apart_by_their_pile():
    parts = [rows_of(pile_bytes(random_scene(seed=s))) for s in (1, 2)]
    for number, part in enumerate(parts):
        part["pile"] = number
    rows = np.concatenate(parts)
    assert rows.dtype == pile_dtype([column_specs(11)[n] for n in random_scene().names])
    assert set(rows["pile"]) == {0, 1}


def test_an_empty_block_has_a_row_without_columns():
    columns = [column_specs(11)["occupancy"]]
    file = io.BytesIO()
    with PileWriter(file, columns) as pile:
        pile.add(7, 0, 0, (0, 0, 0), (0, 0, 0), 0, {})
    row = rows_of(file.getvalue())[0]
    assert (row["state"], row["count"], row["occupancy"]["stored"]) == (0, 0, 0)


def test_a_pile_without_blocks_has_no_rows():
    file = io.BytesIO()
    PileWriter(file, [column_specs(11)["mask"]]).close()
    rows = rows_of(file.getvalue())
    assert len(rows) == 0
    assert stacked(rows, [column_specs(11)["mask"]], "stored").shape == (0, 1)


def test_the_writer_only_appends():
    class Forward(io.BytesIO):
        def seek(self, *_):
            raise AssertionError("the writer went back")

    with PileWriter(Forward(), [column_specs(11)["mask"]]) as pile:
        pile.add(1, 0, 0, (0, 0, 0), (0, 0, 0), 0, {})


def test_leaving_by_an_error_writes_no_footer():
    file = io.BytesIO()
    writer = PileWriter(file, [column_specs(11)["mask"]])
    with pytest.raises(RuntimeError), writer:
        raise RuntimeError
    assert file.getvalue() == HEAD


@pytest.mark.parametrize("size", [0, 10, 63])
def test_a_pile_cut_short_is_refused(size):
    data = pile_bytes(random_scene())
    with pytest.raises(CorruptFileError, match="GSP-0001"):
        rows_of(data[:size])


def test_every_bit_flip_of_the_footer_is_refused():
    data = pile_bytes(random_scene(voxels=3))
    for bit in range(8 * (len(data) - FOOTER.size), 8 * len(data)):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(CorruptFileError, match="GSP-0001"):
            rows_of(bytes(damaged))


def test_a_flip_in_the_index_is_refused():
    data = bytearray(pile_bytes(random_scene(voxels=3)))
    data[-FOOTER.size - 1] ^= 1
    with pytest.raises(CorruptFileError, match="GSP-0002"):
        rows_of(bytes(data))
