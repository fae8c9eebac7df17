"""A pool: where blocks lie in one buffer of the GPU (Chajdas 2014, 4.4). Bookkeeping alone, no GL.

Allocations go to the upper end. What is released stays where it is, on the free list, and comes
back for nothing when it is wanted again; under pressure the free list gives up space, and when that
is too scattered, or the buffer nearly full, everything is moved together.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import OrderedDict
from dataclasses import dataclass

HIGH_WATERMARK = 0.95  # of the pool: above it, moving together is better done early (thesis, 4.8)


@dataclass(frozen=True, slots=True)
class Move:
    """A copy within the buffer, of items; source and target may overlap."""

    source: int
    target: int
    count: int


class Pool:
    """Space for `capacity` items, which blocks take by key."""

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.top = 0  # the upper end of what is taken: where the next allocation goes
        self._used: dict[int, tuple[int, int]] = {}  # key -> start, count
        self._free: OrderedDict[int, tuple[int, int]] = OrderedDict()  # oldest first
        self._gaps: list[tuple[int, int]] = []  # start, count, ascending, apart from each other
        self.evicted: list[int] = []  # blocks whose items are lost; whoever reads it clears it

    def place(self, key: int) -> tuple[int, int] | None:
        """Start and count of a block in use."""
        return self._used.get(key)

    def __contains__(self, key: int) -> bool:
        return key in self._used

    def blocks(self) -> list[int]:
        """The blocks in use."""
        return list(self._used)

    def __len__(self) -> int:
        return len(self._used)

    @property
    def used(self) -> int:
        """Items of blocks in use."""
        return sum(count for _, count in self._used.values())

    @property
    def nearly_full(self) -> bool:
        """Is it time to defragment: above the watermark, with something to be gained by it?"""
        return self.top > HIGH_WATERMARK * self.capacity and bool(self._free or self._gaps)

    def resurrect(self, key: int) -> bool:
        """Take a block back that was released, if its items are still there."""
        place = self._free.pop(key, None)
        if place is not None:
            self._used[key] = place
        return place is not None

    def release(self, key: int) -> None:
        """Put a block on the free list: no longer in use, still uploaded."""
        self._free[key] = self._used.pop(key)

    def allocate(self, key: int, count: int) -> int | None:
        """The start of new space, or None: then defragment, use less, or do without.

        Raises ValueError for a key that has space, in use or released.
        """
        if key in self._used or key in self._free:
            raise ValueError(f"{key} has space already")
        if count > self.capacity:  # giving up the free list would not help
            return None
        start = self._at_top(count)
        while start is None:
            start = self._in_gap(count)
            if start is None:
                if not self._free:
                    return None
                self._evict()
                start = self._at_top(count)
        self._used[key] = (start, count)
        return start

    def defragment(self) -> list[Move]:
        """Forget the free list and move all blocks down, in order of their places."""
        self.evicted += self._free
        self._free.clear()
        self._gaps.clear()
        moves: list[Move] = []
        end = 0
        for key, (start, count) in sorted(self._used.items(), key=lambda item: item[1]):
            if start > end and count:
                moves.append(Move(start, end, count))
            self._used[key] = (end, count)
            end += count
        self.top = end
        return moves

    def _at_top(self, count: int) -> int | None:
        if self.top + count > self.capacity:
            return None
        start, self.top = self.top, self.top + count
        return start

    def _in_gap(self, count: int) -> int | None:
        for i, (start, size) in enumerate(self._gaps):
            if size >= count:
                self._gaps[i : i + 1] = [(start + count, size - count)] if size > count else []
                return start
        return None

    def _evict(self) -> None:
        """Give up what was released first; gaps that touch become one, one at the top the top."""
        key, (start, count) = self._free.popitem(last=False)
        self.evicted.append(key)
        if count == 0:  # an empty block lies between two items, or within another block by now
            return
        i = bisect_left(self._gaps, (start, count))
        if i < len(self._gaps) and start + count == self._gaps[i][0]:
            count += self._gaps.pop(i)[1]
        if i > 0 and sum(self._gaps[i - 1]) == start:
            i -= 1
            start, before = self._gaps.pop(i)
            count += before
        if start + count == self.top:
            self.top = start
        else:
            self._gaps.insert(i, (start, count))
