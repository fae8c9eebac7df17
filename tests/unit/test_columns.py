"""Whole columns: what a writer chooses, what a reader gives back, and what it refuses."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats import columns as c
from gstream.formats import filters as plain
from gstream.formats.framing import CODEC_CONSTANT, CODEC_LZ4, CODEC_RAW, compress, crc32
from gstream.kernels import filters as fast
from strategies import columns, voxel_sets

BOTH = pytest.mark.parametrize("filters", [plain, fast], ids=["plain", "fast"])
SPECS = c.column_specs(11)
LOG2_EDGE = 6


def sheet(count=2_000, seed=1):
    """A block with every column: smooth enough for LZ4, and nothing in it constant."""
    rng = np.random.default_rng(seed)
    morton = np.sort(rng.choice(8**LOG2_EDGE, count, replace=False)).astype(np.uint32)
    ramp = np.arange(count)
    normal = np.stack((1023 + ramp // 7 % 50, 900 + ramp // 9 % 50), axis=1)
    colour = np.stack(
        (ramp // 20 % 256, ramp // 30 % 256, ramp // 40 % 256, 255 - ramp % 2), axis=1
    )
    return c.Block(
        morton,
        (1 + ramp // 100 % 63).astype(np.uint8),
        normal.astype(np.uint16),
        colour.astype(np.uint8),
        rng.integers(1, 1 << 21, count).astype(np.uint32),
        (ramp // 300).astype(np.uint32),
        (ramp % 200).astype(np.uint8),
    )


def decoded(name, column, count, filters=plain, log2_edge=LOG2_EDGE, data=None, specs=SPECS):
    data = column.data if data is None else data
    return c.decode_column(
        specs[name], column, data, count, log2_edge, filters=filters, path="a.gsb", at=96
    )


def assert_refused(rule, name, column, count, **changes):
    for filters in (plain, fast):
        with pytest.raises(CorruptFileError) as caught:
            decoded(name, column, count, filters, **changes)
        assert (caught.value.rule, caught.value.path, caught.value.at) == (rule, "a.gsb", 96)
        assert "\n" not in str(caught.value)


def test_columns_have_the_ids_sizes_and_order_of_the_spec():
    rows = [(s.id, s.name, s.components, s.bits, s.item_bytes) for s in SPECS.values()]
    assert rows == [
        (1, "occupancy", 1, 8, 1),
        (2, "mask", 1, 6, 1),
        (3, "normal", 2, 11, 2),
        (4, "colour", 4, 8, 1),
        (5, "weight", 1, 32, 4),
        (6, "label", 1, 32, 4),
        (7, "spread", 1, 8, 1),
    ]
    assert tuple(SPECS) == c.COLUMN_NAMES
    assert c.column_specs(8)["normal"].bits == 8
    assert [c.COLUMN_IDS[s.id] for s in SPECS.values()] == list(c.COLUMN_NAMES)


@BOTH
@pytest.mark.parametrize("lz4", ["fast", "hc"])
def test_a_block_survives_encoding_and_decoding(filters, lz4):
    block = sheet()
    encoded = c.encode_block(block, LOG2_EDGE, block.names(), 11, lz4, filters=filters)
    assert tuple(encoded) == c.COLUMN_NAMES
    for name, column in encoded.items():
        wanted = block.morton if name == "occupancy" else getattr(block, name)
        got = decoded(name, column, block.count, filters)
        assert got.dtype == wanted.dtype
        assert got.flags.writeable
        np.testing.assert_array_equal(got, wanted)


def test_both_forms_of_the_filters_write_the_same_columns():
    block = sheet()
    for names in (block.names(), ("mask", "occupancy")):
        one = c.encode_block(block, LOG2_EDGE, names, 11, "fast", filters=plain)
        assert one == c.encode_block(block, LOG2_EDGE, names, 11, "fast", filters=fast)


def test_the_smaller_candidate_is_stored_and_its_entry_describes_it():
    block = sheet()
    encoded = c.encode_block(block, LOG2_EDGE, block.names(), 11, "fast")
    for name, column in encoded.items():
        spec = SPECS[name]
        assert column.crc == crc32(column.data)
        if name == "occupancy":
            raw = plain.encode_occupancy(block.morton, LOG2_EDGE).tobytes()
        else:
            values = c.column_values(block, spec)
            raw = plain.apply_filter(plain.NONE, values, spec.bits).tobytes()
            sizes = [
                min(len(compress(whole, "fast")), len(whole))
                for f in spec.candidates
                for whole in [plain.apply_filter(f, values, spec.bits).tobytes()]
            ]
            assert len(column.data) == min(sizes)
            assert column.filter == spec.candidates[sizes.index(min(sizes))]
        assert column.raw_bytes == len(raw)
        assert column.hash64 == c.hash64(raw)


def test_normals_that_deltas_cannot_halve_are_tried_with_nothing_else():
    block = sheet()
    tried = []

    def recorded(filter_id, values, bits):
        tried.append(filter_id)
        return plain.apply_filter(filter_id, values, bits)

    filters = SimpleNamespace(apply_filter=recorded)
    c.encode_block(block, LOG2_EDGE, ("normal",), 11, "fast", filters=filters)
    assert tried == [plain.DELTA_BIT_PLANES, plain.BYTE_PLANES]
    tried.clear()
    block.normal = np.random.default_rng(2).integers(0, 1 << 11, (block.count, 2), np.uint16)
    c.encode_block(block, LOG2_EDGE, ("normal",), 11, "fast", filters=filters)
    assert tried == [plain.DELTA_BIT_PLANES]


def test_the_hash_is_blake2b_of_8_bytes_read_little_endian():
    assert c.hash64(b"") == int.from_bytes(bytes.fromhex("e4a6a0577479b2b4"), "little")


def test_a_column_that_lz4_cannot_shrink_is_stored_raw():
    rng = np.random.default_rng(5)
    block = sheet()
    block.weight = rng.integers(0, 1 << 32, block.count, dtype=np.uint32)
    column = c.encode_block(block, LOG2_EDGE, ("weight",), 11, "fast")["weight"]
    assert (column.codec, len(column.data)) == (CODEC_RAW, 4 * block.count)
    np.testing.assert_array_equal(decoded("weight", column, block.count), block.weight)


@pytest.mark.parametrize(
    ("name", "value", "packed"),
    [
        ("mask", [37], 37),
        ("normal", [2047, 1023], 2047 | 1023 << 16),
        ("colour", [1, 2, 3, 255], 0xFF030201),
        ("weight", [0xFFFFFFFF], 0xFFFFFFFF),
        ("label", [0], 0),
        ("spread", [200], 200),
    ],
)
@pytest.mark.parametrize("count", [1, 2, 999])
def test_a_column_of_one_value_is_a_constant_without_bytes(name, value, packed, count):
    spec = SPECS[name]
    values = np.tile(np.array(value, spec.dtype), (count, 1))
    block = c.Block(np.arange(count, dtype=np.uint32), np.ones(count, np.uint8))
    setattr(block, name, values.reshape(-1) if spec.components == 1 else values)
    column = c.encode_block(block, LOG2_EDGE, (name,), 11, "fast")[name]
    raw = plain.apply_filter(plain.NONE, values, spec.bits).tobytes()
    wanted = c.EncodedColumn(b"", len(raw), 0, packed, CODEC_CONSTANT, 0, c.hash64(raw))
    assert column == wanted
    scratch = c.encode_block(block, LOG2_EDGE, (name,), 11, "fast", stored={name})[name]
    assert scratch == replace(wanted, hash64=0)
    np.testing.assert_array_equal(decoded(name, column, count), getattr(block, name))


def test_occupancy_is_never_a_constant():
    block = c.Block(np.arange(8**3, dtype=np.uint32), np.ones(8**3, np.uint8))
    column = c.encode_block(block, 3, ("occupancy",), 11, "fast")["occupancy"]
    assert column.codec in (CODEC_RAW, CODEC_LZ4)
    assert decoded("occupancy", column, 8**3, log2_edge=3).tolist() == list(range(8**3))


def test_columns_named_as_stored_are_neither_filtered_nor_compressed_nor_summed():
    block = sheet()
    encoded = c.encode_block(block, LOG2_EDGE, block.names(), 11, "hc", stored={"weight", "normal"})
    assert encoded["weight"].data == block.weight.tobytes()
    assert encoded["normal"].data == block.normal.T.tobytes()
    assert (encoded["normal"].codec, encoded["normal"].filter) == (CODEC_RAW, plain.NONE)
    assert (encoded["normal"].crc, encoded["normal"].hash64) == (0, 0)
    assert encoded["mask"].codec == CODEC_LZ4
    for name in ("weight", "normal"):
        got = decoded(name, encoded[name], block.count, fast)
        np.testing.assert_array_equal(got, getattr(block, name))


def test_asking_for_a_column_that_the_block_has_not_is_an_error():
    block = c.Block(np.zeros(1, np.uint32), np.ones(1, np.uint8))
    assert block.names() == ("occupancy", "mask")
    with pytest.raises(ValueError, match="no column normal"):
        c.encode_block(block, LOG2_EDGE, ("normal",), 11, "fast")


@given(voxel_sets(), st.sampled_from(["fast", "hc"]))
def test_any_set_of_voxels_survives(voxels, lz4):
    log2_edge, codes = voxels
    block = c.Block(codes, np.ones(codes.size, np.uint8))
    column = c.encode_block(block, log2_edge, ("occupancy",), 11, lz4)["occupancy"]
    for filters in (plain, fast):
        got = decoded("occupancy", column, codes.size, filters, log2_edge)
        np.testing.assert_array_equal(got, codes)


@given(columns(), st.sampled_from(["fast", "hc"]), st.booleans())
def test_any_values_survive_whatever_is_chosen_for_them(column, lz4, stored):
    values, bits = column
    names = {(1, 1, 6): "mask", (1, 1, 8): "spread", (4, 1, 8): "colour", (1, 4, 32): "label"}
    name = names.get((values.shape[1], values.itemsize, bits), "normal")
    values = values.reshape(-1) if values.shape[1] == 1 else values
    block = c.Block(np.arange(len(values), dtype=np.uint32), np.ones(len(values), np.uint8))
    setattr(block, name, values)
    specs = c.column_specs(bits if name == "normal" else 11)
    normal_bits = specs["normal"].bits
    kept = {name} if stored else frozenset()
    encoded = c.encode_block(block, LOG2_EDGE, (name,), normal_bits, lz4, stored=kept)
    for filters in (plain, fast):
        got = decoded(name, encoded[name], len(values), filters, specs=specs)
        np.testing.assert_array_equal(got, values)


@pytest.mark.parametrize("name", [n for n in c.COLUMN_NAMES if n != "label"])
def test_a_column_cut_short_or_lengthened_anywhere_is_refused(name):
    block = sheet(301)
    for stored in (frozenset(), {name}):
        encoded = c.encode_block(block, LOG2_EDGE, (name,), 11, "fast", stored=stored)
        data = encoded[name].data
        for size in {0, 1, 2, len(data) // 2, len(data) - 1}:
            assert_refused(c.RULE_LENGTH, name, encoded[name], 301, data=data[:size])
        assert_refused(c.RULE_LENGTH, name, encoded[name], 301, data=data + b"\0")


@pytest.mark.parametrize("name", c.COLUMN_NAMES)
def test_no_flip_of_a_bit_does_worse_than_a_refusal(name):
    block = sheet(75)
    column = c.encode_block(block, LOG2_EDGE, (name,), 11, "fast")[name]
    for bit in range(0, 8 * len(column.data), 3):
        data = bytearray(column.data)
        data[bit // 8] ^= 1 << bit % 8
        for filters in (plain, fast):
            try:
                got = decoded(name, column, 75, filters, data=bytes(data))
            except CorruptFileError:
                continue
            assert len(got) == 75


@pytest.mark.parametrize("name", c.COLUMN_NAMES)
@pytest.mark.parametrize("count", [0, 1, 300, 302, 8**6, 8**6 + 1, -1])
def test_a_wrong_count_of_voxels_is_refused(name, count):
    column = c.encode_block(sheet(301), LOG2_EDGE, (name,), 11, "fast")[name]
    impossible = not 1 <= count <= 8**6
    rule = c.RULE_COUNT if impossible else c.RULE_RAW_BYTES
    if name == "occupancy" and not impossible and column.raw_bytes <= 6 * count:
        rule = c.RULE_TREE
    assert_refused(rule, name, column, count)


def test_a_length_beyond_the_limits_is_refused_before_anything_is_allocated():
    column = c.encode_block(sheet(301), LOG2_EDGE, ("weight",), 11, "fast")["weight"]
    bomb = replace(column, raw_bytes=4 * 8**8, data=b"\x1f" * 40, codec=CODEC_LZ4, filter=0)
    assert_refused(c.RULE_LENGTH, "weight", bomb, 8**8, log2_edge=8)
    bomb = replace(bomb, raw_bytes=48_000_000)
    assert_refused(c.RULE_LENGTH, "occupancy", bomb, 8**8, log2_edge=8)


def occupancy(masks):
    data = bytes(masks)
    return c.EncodedColumn(data, len(data), crc32(data), 0, CODEC_RAW, 0, 0)


def test_octree_masks_that_are_no_tree_of_the_count_are_refused():
    whole = [0b10000001, 0b11, 0b1, 1, 2, 4]
    column = occupancy(whole)
    assert decoded("occupancy", column, 3, log2_edge=3).tolist() == [0, 9, 450]
    for count in (1, 2, 4, 5):
        rule = c.RULE_RAW_BYTES if len(whole) > 3 * count else c.RULE_TREE
        assert_refused(rule, "occupancy", column, count, log2_edge=3)
    assert_refused(c.RULE_TREE, "occupancy", occupancy(whole[:-1]), 3, log2_edge=3)
    assert_refused(c.RULE_TREE, "occupancy", occupancy([*whole, 1]), 3, log2_edge=3)
    assert_refused(c.RULE_TREE, "occupancy", occupancy([255] * 6), 3, log2_edge=3)
    for i in range(len(whole)):
        empty = [*whole[:i], 0, *whole[i + 1 :]]
        assert_refused(c.RULE_EMPTY_MASK, "occupancy", occupancy(empty), 3, log2_edge=3)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("occupancy", {"filter": 1}),
        ("occupancy", {"codec": CODEC_CONSTANT}),
        ("mask", {"filter": 5}),
        ("normal", {"filter": 5}),
        ("mask", {"codec": CODEC_CONSTANT, "filter": 4}),
    ],
)
def test_a_filter_that_the_column_may_not_have_is_refused(name, changes):
    column = c.encode_block(sheet(), LOG2_EDGE, (name,), 11, "fast")[name]
    assert_refused(c.RULE_FILTER, name, replace(column, **changes), 2_000)


@pytest.mark.parametrize("changes", [{"codec": 3}, {"filter": 6}, {"filter": 255}])
def test_an_unknown_codec_or_filter_is_unsupported_not_corrupt(changes):
    column = c.encode_block(sheet(), LOG2_EDGE, ("mask",), 11, "fast")["mask"]
    with pytest.raises(UnsupportedError, match=r"column mask has (codec|filter)"):
        decoded("mask", replace(column, **changes), 2_000)


def test_a_constant_with_bytes_or_out_of_range_is_refused():
    mask = c.EncodedColumn(b"", 5, 0, 63, CODEC_CONSTANT, 0, 0)
    assert decoded("mask", mask, 5).tolist() == [63] * 5
    assert_refused(c.RULE_CONSTANT, "mask", mask, 5, data=b"\0")
    assert_refused(c.RULE_CONSTANT, "mask", replace(mask, constant=64), 5)
    assert_refused(c.RULE_CONSTANT, "mask", replace(mask, constant=256), 5)
    normal = c.EncodedColumn(b"", 20, 0, 2048, CODEC_CONSTANT, 0, 0)
    assert_refused(c.RULE_CONSTANT, "normal", normal, 5)
    assert_refused(c.RULE_CONSTANT, "normal", replace(normal, constant=2048 << 16), 5)


@pytest.mark.parametrize("filter_id", [0, 1])
def test_a_value_beyond_its_bits_is_refused(filter_id):
    values = np.array([[64], [1], [2]], np.uint8)
    data = plain.apply_filter(filter_id, values, 8).tobytes()
    column = c.EncodedColumn(data, 3, crc32(data), 0, CODEC_RAW, filter_id, 0)
    assert_refused(c.RULE_RANGE, "mask", column, 3)


@pytest.mark.parametrize("plane", range(22))
def test_a_bit_after_the_last_voxel_of_any_plane_is_refused(plane):
    values = np.tile(np.array([[5, 2_000]], np.uint16), (11, 1))
    whole = bytearray(plain.apply_filter(3, values, 11).tobytes())
    whole[2 * plane + 1] |= 0b1000
    column = c.EncodedColumn(bytes(whole), 44, 0, 0, CODEC_RAW, 3, 0)
    assert_refused(c.RULE_PADDING, "normal", column, 11)
