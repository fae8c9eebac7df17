"""The column filters: frozen bytes, and fast = plain = naive for every one of them."""

import numpy as np
import pytest
from hypothesis import given

import naive
from gstream.formats import filters as plain
from gstream.kernels import filters as fast
from strategies import columns, voxel_sets

BOTH = pytest.mark.parametrize("filters", [plain, fast], ids=["plain", "fast"])

MASK = [[21], [21], [5], [63], [1], [32], [32], [33], [33]]
NORMAL = [
    [0x3FF, 0x000],
    [0x400, 0x001],
    [0x3FE, 0x7FE],
    [0x7FF, 0x7FF],
    [0x3FF, 0x3FF],
    [0x400, 0x3FF],
    [0x401, 0x3FE],
    [0x401, 0x3FE],
    [0x000, 0x7FE],
]
COLOUR = [
    [255, 0, 0, 255],
    [254, 1, 0, 255],
    [128, 128, 128, 0],
    [10, 200, 30, 255],
    [10, 201, 30, 255],
    [10, 201, 31, 255],
    [0, 0, 0, 255],
    [255, 255, 255, 128],
    [1, 2, 3, 4],
]
WEIGHT = [[1], [1 << 20], [(1 << 20) + 1], [(1 << 32) - 1], [0x01020304], [5], [5], [5], [1 << 31]]

GOLDEN = {
    ("mask", 0): "1515053f0120202121",
    ("mask", 1): "1515053f0120202121",
    ("mask", 2): "9f01 0800 0f00 0800 0b00 e801",
    ("mask", 3): "0c00 ad00 3400 2d00 2400 2100",
    ("mask", 4): "a100 1800 1100 1800 1d00 3800",
    ("normal", 0): "ff030004fe03ff07ff03000401040104000000000100fe07ff07ff03ff03fe03fe03fe07",
    ("normal", 1): "ff00feffff00010100 030403070304040400 0001fefffffffefefe 000007070303030307",
    ("normal", 2): "d9001d001d001d001d001d001d001d001d001d00ea00"
    "3a00fc01fc01fc01fc01fc01fc01fc01fc01fc010c01",
    ("normal", 3): "1c00770119011901190119011901190119011901190154"
    "011a01140110011001100110011001100110011001",
    ("normal", 4): "6b012700270027002700270027002700270027003e01"
    "4e000400040004000400040004000400040004001401",
    ("colour", 1): "fffe800a0a0a00ff01 000180c8c9c900ff02 0000801e1e1f00ff03 ffff00ffffffff8004",
    ("colour", 2): "8101bb008300bb008300830083008700b20080018000b80080008000b800bc00"
    "a001b801b800b800b8008000800084007b007b007b017b007b007b007b00fb00",
    ("colour", 3): "cf004c0000010c0044000c000c000c0080005601440144000c00440044000c00"
    "cc002c0044004401440044000c000c0089010401800180008001800180018001",
    ("colour", 5): "80005601440144000c00440044000c0053010600 0c0000000000000000004800"
    "5200640108004800000048000000480089010401800180008001800180018001",
    ("weight", 0): "010000000000100001001000ffffffff0403020105000000050000000500000000000080",
    ("weight", 1): "010001ff0405050500 000000ff0300000000 001010ff0200000000 000000ff0100000080",
    ("weight", 3): "28001f01220132002201220122012201220112013201020102010201020102010201"
    "020132010201020108010001000100013001000100010001000100010001",
}
COLUMNS = {
    "mask": (np.array(MASK, np.uint8), 6),
    "normal": (np.array(NORMAL, np.uint16), 11),
    "colour": (np.array(COLOUR, np.uint8), 8),
    "weight": (np.array(WEIGHT, np.uint32), 32),
}


def lawful_filters(values):
    return range(6) if values.shape[1] == 4 else range(5)


@BOTH
@pytest.mark.parametrize(("column", "filter_id"), GOLDEN)
def test_a_filter_writes_and_reads_its_frozen_bytes(filters, column, filter_id):
    values, bits = COLUMNS[column]
    frozen = bytes.fromhex(GOLDEN[column, filter_id])
    assert filters.apply_filter(filter_id, values, bits).tobytes() == frozen
    data = np.frombuffer(frozen, np.uint8)
    back = filters.undo_filter(filter_id, data, values.shape, values.dtype, bits)
    np.testing.assert_array_equal(back, values)


def test_both_forms_number_the_filters_alike():
    for name in ("NONE", "BYTE_PLANES", "BIT_PLANES", "DELTA_BIT_PLANES", "XOR_BIT_PLANES"):
        assert getattr(plain, name) == getattr(fast, name)
    assert plain.GREEN_DELTA_BIT_PLANES == fast.GREEN_DELTA_BIT_PLANES == 5
    assert plain.FILTERS == fast.FILTERS


@given(columns())
def test_every_filter_agrees_with_the_naive_one_and_is_undone(column):
    values, bits = column
    for filter_id in lawful_filters(values):
        wanted = naive.apply_filter(filter_id, values.tolist(), values.itemsize, bits)
        length = plain.filtered_bytes(filter_id, *values.shape, values.itemsize, bits)
        assert length == len(wanted)
        for filters in (plain, fast):
            assert filters.apply_filter(filter_id, values, bits).tobytes() == wanted
            data = np.frombuffer(wanted, np.uint8)
            back = filters.undo_filter(filter_id, data, values.shape, values.dtype, bits)
            np.testing.assert_array_equal(back, values)
            assert back.flags.c_contiguous
            assert back.flags.writeable


@BOTH
def test_filtering_leaves_its_input_alone_whatever_its_layout(filters):
    rng = np.random.default_rng(3)
    values = np.asfortranarray(rng.integers(0, 256, (100, 4)), np.uint8)
    before = values.copy()
    for filter_id in plain.FILTERS:
        data = filters.apply_filter(filter_id, values, 8)
        np.testing.assert_array_equal(values, before)
        expected = plain.apply_filter(filter_id, before, 8)
        np.testing.assert_array_equal(data, expected)


@BOTH
def test_a_filter_that_does_not_exist_is_refused(filters):
    values = np.zeros((8, 1), np.uint8)
    with pytest.raises(ValueError, match="no filter 6"):
        filters.apply_filter(6, values, 8)
    with pytest.raises(ValueError, match="no filter 6"):
        filters.undo_filter(6, values.reshape(-1), (8, 1), np.uint8, 8)


@BOTH
def test_octree_masks_are_their_frozen_bytes(filters):
    codes = np.array([0, 1, 7, 8, 63, 64, 511], np.uint32)
    masks = filters.encode_occupancy(codes, 3)
    assert masks.tobytes() == bytes.fromhex("83 8301 80 8301 80 01 80")
    np.testing.assert_array_equal(filters.decode_occupancy(masks, 3, 7), codes)


@given(voxel_sets())
def test_occupancy_agrees_with_the_naive_octree_and_is_undone(voxels):
    log2_edge, codes = voxels
    wanted = bytes(naive.octree_masks(codes.tolist(), log2_edge))
    for filters in (plain, fast):
        assert filters.encode_occupancy(codes, log2_edge).tobytes() == wanted
        masks = np.frombuffer(wanted, np.uint8)
        assert filters.count_leaves(masks, log2_edge) == codes.size
        back = filters.decode_occupancy(masks, log2_edge, codes.size)
        assert back.dtype == np.uint32
        np.testing.assert_array_equal(back, codes)


@BOTH
@pytest.mark.parametrize("log2_edge", range(3, 9))
def test_single_corner_voxels_of_every_edge_survive(filters, log2_edge):
    for code in (0, 8**log2_edge - 1):
        masks = filters.encode_occupancy(np.array([code], np.uint32), log2_edge)
        assert masks.tolist() == [1 if code == 0 else 128] * log2_edge
        assert filters.decode_occupancy(masks, log2_edge, 1).tolist() == [code]


@BOTH
def test_a_full_block_of_edge_64_survives(filters):
    codes = np.arange(64**3, dtype=np.uint32)
    masks = filters.encode_occupancy(codes, 6)
    assert (masks == 255).all()
    assert masks.size == (64**3 - 1) // 7
    np.testing.assert_array_equal(filters.decode_occupancy(masks, 6, codes.size), codes)


@given(voxel_sets())
def test_damaged_octrees_are_counted_as_the_naive_walk_counts_them(voxels):
    log2_edge, codes = voxels
    whole = naive.octree_masks(codes.tolist(), log2_edge)
    damaged = [whole[:-1], [*whole, 1], [0, *whole[1:]], whole[::-1], [m ^ 1 for m in whole]]
    for masks in damaged:
        leaves = naive.octree_leaves(masks, log2_edge)
        for filters in (plain, fast):
            counted = filters.count_leaves(np.array(masks, np.uint8), log2_edge)
            assert counted == (0 if leaves is None else len(leaves))
