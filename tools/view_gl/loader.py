"""The I/O thread: reads what the last frame asked for, and nothing that an earlier one did.

Once per frame the caller takes what is finished and hands over a new list, which replaces the old
one (Chajdas 2014, 4.6). What was being read at that moment is finished and taken all the same.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..reader_py import BlockFile
from .buffers import Words
from .hybrid import COLUMNS, Pieces, SourceTriangles

BATCH_BYTES = 1 << 20  # read at once: what the thread cannot be called back from


@dataclass(frozen=True, slots=True)
class Wish:
    """What a frame lacks: pages of the directory first, then blocks in order of need."""

    pages: frozenset[int] = frozenset()
    nodes: Sequence[int] = ()
    sources: Sequence[int] = ()  # blocks whose source triangles are wanted, after all others

    def __bool__(self) -> bool:
        return bool(self.pages or self.nodes or self.sources)


@dataclass(slots=True)
class Loaded:
    """What was read since it was last taken."""

    pages: list[int] = field(default_factory=list)
    blocks: list[tuple[int, Words]] = field(default_factory=list)  # row of the tree, (n, stride)
    sources: list[Pieces] = field(default_factory=list)
    failure: Exception | None = None


class Loader:
    """Reads blocks in a thread of its own, or at once.

    columns : what a voxel's words hold after the first, which is place and mask: normal, colour
    source : reads source triangles, of a scene that calls for them
    """

    def __init__(
        self, file: BlockFile, columns: Sequence[str], source: SourceTriangles | None = None
    ) -> None:
        self._file = file
        self._source = source
        self._names = ["occupancy", "mask", *columns]
        self._changed = threading.Condition()
        self._wish = Wish()
        self._entries: Sequence[Any] = ()
        self._done = Loaded()
        self._reading = Wish()
        self._closed = False
        self._thread: threading.Thread | None = None

    @property
    def stride(self) -> int:
        """Words of a voxel."""
        return len(self._names) - 1

    def read(self, entries: Sequence[Any], nodes: Sequence[int]) -> list[tuple[int, Words]]:
        """Read blocks now; entries by row of the tree."""
        found = self._file.load([entries[node] for node in nodes], self._names)
        return [(node, self._words(block)) for node, block in zip(nodes, found, strict=True)]

    def ask(self, wish: Wish, entries: Sequence[Any]) -> None:
        """Replace what was asked for; what is being read or was not taken yet is not read again."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="reader", daemon=True)
            self._thread.start()
        with self._changed:
            known = {*self._reading.nodes, *(node for node, _ in self._done.blocks)}
            nodes = [node for node in wish.nodes if node not in known]
            known = {*self._reading.sources, *(pieces.node for pieces in self._done.sources)}
            sources = [node for node in wish.sources if node not in known]
            self._wish, self._entries = Wish(wish.pages, nodes, sources), entries
            self._changed.notify()

    def take(self) -> Loaded:
        """What was read since; raises what the thread met, once, and what was read can wait."""
        with self._changed:
            failure, self._done.failure = self._done.failure, None
            if failure is None:
                done, self._done = self._done, Loaded()
                return done
        raise failure

    @property
    def idle(self) -> bool:
        """Is nothing asked for, being read or to be taken?"""
        with self._changed:
            read = self._done.pages or self._done.blocks or self._done.sources
            done = read or self._done.failure
            return not (self._wish or self._reading or done)

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._reading = Wish()
                while not (self._closed or self._wish):
                    self._changed.wait()
                if self._closed:
                    return
                self._reading, self._wish = self._split(self._wish)
                reading, entries = self._reading, self._entries
            done = Loaded()
            try:
                for page in sorted(reading.pages):
                    self._file.page(page)
                    done.pages.append(page)
                if reading.nodes:
                    done.blocks = self.read(entries, reading.nodes)
                if reading.sources and self._source is not None:
                    done.sources = self._source.read(entries, reading.sources)
            except Exception as error:  # told to the main thread, whatever it is
                done.failure = error
            with self._changed:
                self._done.pages += done.pages
                self._done.blocks += done.blocks
                self._done.sources += done.sources
                self._done.failure = self._done.failure or done.failure
                if done.failure is not None:
                    self._wish = Wish()

    def _split(self, wish: Wish) -> tuple[Wish, Wish]:
        """The front of a list, all its pages or blocks up to the size of a batch, and the rest."""
        nodes, sources = wish.nodes, wish.sources
        if wish.pages:
            return Wish(pages=wish.pages), Wish(nodes=nodes, sources=sources)
        if nodes:
            count = self._batch(nodes, self._names)
            return Wish(nodes=nodes[:count]), Wish(nodes=nodes[count:], sources=sources)
        count = self._batch(sources, COLUMNS)
        return Wish(sources=sources[:count]), Wish(sources=sources[count:])

    def _batch(self, nodes: Sequence[int], names: Sequence[str]) -> int:
        """How many blocks from the front make a batch."""
        size, count = 0, 0
        while count < len(nodes) and size < BATCH_BYTES:
            size += stored_bytes(self._entries[nodes[count]], names)
            count += 1
        return count

    def _words(self, block: dict[str, NDArray[Any]]) -> Words:
        """(n, stride) u32: place and mask, then normal x | y << 16, colour R | … | A << 24."""
        words = np.empty((len(block["words"]), self.stride), np.uint32)
        words[:, 0] = block["words"]
        for i, name in enumerate(self._names[2:], 1):
            words[:, i] = np.ascontiguousarray(block[name]).view(np.uint32).reshape(-1)
        return words


def stored_bytes(entry: Any, names: Sequence[str]) -> int:
    """What the columns of a block take in the file."""
    return sum(int(entry[name]["stored"]) for name in names)
