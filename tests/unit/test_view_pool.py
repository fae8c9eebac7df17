"""tools/view_gl/pool: contents survive whatever is asked of it, and space goes by the rules."""

import inspect
from collections import OrderedDict
from random import Random

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from gstream_tools.view_gl import pool
from gstream_tools.view_gl.pool import Move, Pool

NOTHING = -1


class Buffer:
    """A pool with a buffer behind it, and what the rules say of both.

    Every block writes a number of its own to its items.
    """

    def __init__(self, capacity, pool_type=Pool):
        self.pool = pool_type(capacity)
        self.items = np.full(capacity, NOTHING)
        self.expected = np.full(capacity, NOTHING)  # of blocks in use or released
        self.number = {}  # key -> what it wrote
        self.used = {}  # key -> start, count
        self.released = OrderedDict()
        self.serial = 0

    def room(self, blocks):
        """The longest run of items that none of the blocks has."""
        taken = np.ones(self.pool.capacity + 2, bool)
        taken[1:-1] = False
        for start, count in blocks:
            taken[1 + start : 1 + start + count] = True
        return int(np.diff(np.flatnonzero(taken)).max()) - 1

    def allocate(self, key, count):
        before = self.pool.top
        start = self.pool.allocate(key, count)
        lost = self.take_evicted()
        kept = [*self.used.values(), *self.released.values()]
        if before + count <= self.pool.capacity:
            assert (start, lost) == (before, [])  # the upper end first
        elif lost:
            assert self.room([*kept, lost[-1]]) < count  # no more than was necessary
        if count > self.pool.capacity:
            assert (start, lost) == (None, [])
        if start is None:
            assert count > self.pool.capacity or not self.released
            assert self.room(kept) < count
            return
        assert 0 <= start <= start + count <= self.pool.capacity
        assert (self.expected[start : start + count] == NOTHING).all()
        self.serial += 1
        self.number[key], self.used[key] = self.serial, (start, count)
        self.items[start : start + count] = self.expected[start : start + count] = self.serial

    def release(self, key):
        self.pool.release(key)
        self.released[key] = self.used.pop(key)

    def resurrect(self, key):
        assert self.pool.resurrect(key) == (key in self.released)
        if key in self.released:
            self.used[key] = self.released.pop(key)

    def defragment(self):
        for move in self.pool.defragment():
            assert move.count > 0
            assert 0 <= move.target < move.source <= self.pool.capacity - move.count
            source = self.items[move.source : move.source + move.count].copy()
            self.items[move.target : move.target + move.count] = source
        self.take_evicted()
        assert not self.released
        self.expected[:] = NOTHING
        for key, (_, count) in self.used.items():
            start, now = self.pool.place(key)
            assert now == count
            self.used[key] = (start, count)
            self.expected[start : start + count] = self.number[key]
        taken = sum(count for _, count in self.used.values())
        assert (self.expected[:taken] != NOTHING).all()
        assert (self.pool.top, self.pool.used) == (taken, taken)

    def take_evicted(self):
        """The places of blocks that were lost: those that were released first, in that order."""
        keys = list(self.pool.evicted)
        self.pool.evicted.clear()
        assert keys == list(self.released)[: len(keys)]
        lost = [self.released.pop(key) for key in keys]
        for start, count in lost:
            self.expected[start : start + count] = NOTHING
        return lost

    def check(self):
        known = self.expected != NOTHING
        assert (self.items[known] == self.expected[known]).all()
        assert len(self.pool) == len(self.used)


class Pools(RuleBasedStateMachine):
    @initialize(capacity=st.integers(1, 40))
    def begin(self, capacity):
        self.buffer, self.next = Buffer(capacity), 0

    @rule(count=st.integers(0, 42))
    def allocate(self, count):
        self.next += 1
        self.buffer.allocate(self.next, count)

    @rule(data=st.data())
    def release(self, data):
        if self.buffer.used:
            self.buffer.release(data.draw(st.sampled_from(sorted(self.buffer.used))))

    @rule(data=st.data())
    def resurrect(self, data):
        asleep = set(range(1, self.next + 1)) - set(self.buffer.used)
        if asleep:
            self.buffer.resurrect(data.draw(st.sampled_from(sorted(asleep))))

    @rule()
    def defragment(self):
        self.buffer.defragment()

    @invariant()
    def contents_are_intact(self):
        if hasattr(self, "buffer"):
            self.buffer.check()


TestNoSequenceHarmsAPool = Pools.TestCase


def history(operations, pool_type=Pool, capacity=300, seed=0):
    """Blocks come and go, as many as there are children, and come back under the same keys."""
    random, buffer = Random(seed), Buffer(capacity, pool_type)
    for _ in range(operations):
        key, choice = random.randrange(60), random.random()
        if key in buffer.used:
            buffer.release(key)
        elif choice < 0.02:
            buffer.defragment()
        elif key in buffer.released or choice < 0.1:
            buffer.resurrect(key)
        else:
            buffer.allocate(key, random.randrange(40))
        buffer.check()
    return buffer


def test_a_hundred_thousand_operations_leave_contents_intact():
    buffer = history(100_000)
    assert buffer.serial > 20_000


FAULTS = {
    "a place is not updated by moving": ("            self._used[key] = (end, count)\n", ""),
    "a move goes upwards": ("Move(start, end, count)", "Move(end, start, count)"),
    "a block comes back after its items were given up": ("        self._free.clear()\n", ""),
    "a gap outlives moving": ("        self._gaps.clear()\n", ""),
    "what was released last goes first": ("popitem(last=False)", "popitem()"),
    "nobody is told what was given up": ("        self.evicted.append(key)\n", ""),
    "what is left of a gap is lost": ("if size > count else []", "if False else []"),
    "a gap above is lost": ("count += self._gaps.pop(i)[1]", "self._gaps.pop(i)"),
    "a gap below is lost": ("            count += before\n", ""),
    "a gap at the top stays one": ("if start + count == self.top", "if False"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_the_history_finds_a_planted_fault(fault):
    source, (right, wrong) = inspect.getsource(pool), FAULTS[fault]
    assert source.count(right) == 1
    names = {"__name__": pool.__name__}
    exec(source.replace(right, wrong), names)
    with pytest.raises((AssertionError, ValueError, KeyError)):
        history(20_000, names["Pool"])


def test_a_block_that_left_and_returned_costs_nothing():
    pool = Pool(10)
    pool.allocate("a", 4)
    pool.release("a")
    assert "a" not in pool
    assert pool.resurrect("a")
    assert pool.place("a") == (0, 4)
    assert pool.top == 4


def test_a_block_whose_space_was_taken_does_not_return():
    pool = Pool(10)
    pool.allocate("a", 6)
    pool.release("a")
    assert pool.allocate("b", 7) == 0
    assert pool.evicted == ["a"]
    assert not pool.resurrect("a")
    assert pool.allocate("a", 3) == 7


def test_a_key_has_space_once():
    pool = Pool(10)
    pool.allocate("a", 1)
    with pytest.raises(ValueError, match="a has space already"):
        pool.allocate("a", 1)
    pool.release("a")
    with pytest.raises(ValueError, match="a has space already"):
        pool.allocate("a", 1)


def test_a_pool_can_be_exactly_full():
    pool = Pool(10)
    assert [pool.allocate(key, 5) for key in "ab"] == [0, 5]
    assert pool.allocate("c", 1) is None
    assert pool.allocate("nothing", 0) == 10
    assert not pool.nearly_full  # moving would gain nothing
    assert pool.defragment() == []


def test_a_block_larger_than_the_pool_is_refused_and_takes_nothing_from_others():
    pool = Pool(10)
    pool.allocate("used", 4)
    pool.allocate("released", 4)
    pool.release("released")
    assert pool.allocate("large", 11) is None
    assert pool.resurrect("released")


def test_every_block_moves_once_in_the_order_of_their_places():
    pool = Pool(10)
    for key, count in (("a", 1), ("b", 4), ("c", 0), ("d", 2), ("e", 3)):
        pool.allocate(key, count)
    pool.release("a")
    pool.release("d")
    assert pool.defragment() == [Move(1, 0, 4), Move(7, 4, 3)]


@pytest.mark.parametrize(
    ("counts", "released", "nearly_full"),
    [
        ([95], [], False),  # not above the watermark
        ([90, 5], [0], False),
        ([90, 6], [0], True),
        ([90, 6], [], False),  # nothing to be gained
        ([90, 10], [1], True),
    ],
)
def test_a_pool_asks_for_defragmentation_above_95_percent_when_it_helps(
    counts, released, nearly_full
):
    pool = Pool(100)
    for key, count in enumerate(counts):
        pool.allocate(key, count)
    for key in released:
        pool.release(key)
    assert pool.nearly_full is nearly_full
