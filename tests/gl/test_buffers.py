"""Blocks in a buffer of the GPU keep their words, wherever the pool moves them."""

import numpy as np
import pytest

from gstream_tools.view_gl import buffers
from gstream_tools.view_gl.buffers import WORD, PoolBuffer


def filled(context, counts, stride=2):
    """A buffer that these blocks fill, and the words of each."""
    held = PoolBuffer(context, sum(counts), stride)
    rng = np.random.default_rng(1)
    words = {
        node: rng.integers(1 << 32, size=(count, stride), dtype=np.uint32)
        for node, count in enumerate(counts)
    }
    for node, count in enumerate(counts):
        held.pool.allocate(node, count)
    held.upload(list(words.items()))
    return held, words


def words_of(held, node):
    """What the GPU has of a block."""
    start, count = held.pool.place(node)
    size = held.stride * WORD
    data = held.buffer.read(count * size, offset=start * size)
    return np.frombuffer(data, np.uint32).reshape(-1, held.stride)


@pytest.mark.parametrize("staging", [buffers.STAGING_BYTES, 24])
def test_blocks_are_intact_after_moves_by_less_than_their_length(context, monkeypatch, staging):
    monkeypatch.setattr(buffers, "STAGING_BYTES", staging)
    held, words = filled(context, [1, 500, 3, 7, 2, 40])
    for node in (0, 3):
        held.pool.release(node)
    moves = held.pool.defragment()
    assert any(move.source - move.target < move.count for move in moves), "none overlaps"
    held.move(moves)
    for node in (1, 2, 4, 5):
        assert np.array_equal(words_of(held, node), words[node])
