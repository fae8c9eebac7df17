"""Files as batches of numbers, from text or from binary records: what a record walk reads."""

from typing import BinaryIO, Protocol

import numpy as np
import numpy.typing as npt

from gstream.kernels import records as kernel
from gstream.kernels.text import BAD_TOKEN, SLOW_TOKEN, parse_numbers
from gstream.readers.ply_header import Element
from gstream.readers.text_blocks import TextBlocks

BATCH = 1 << 17  # numbers
BYTES = 1 << 20


class NumberSource(Protocol):
    """`values[at:stop]` wait to be used; `refill()` replaces them when they are."""

    values: npt.NDArray[np.float64]
    flags: npt.NDArray[np.uint8]
    at: int
    stop: int

    def begin(self, element: Element) -> None:
        """The numbers that follow are records of `element`."""

    def refill(self) -> bool:
        """Read on; False at the end of the file."""

    def place(self, at: int) -> str:
        """Where in the file number `at` of the batch stands, for an error."""

    def said(self, at: int) -> str:
        """Number `at` of the batch as the file has it."""


class TextNumbers:
    """The white-space separated numbers of a text file."""

    def __init__(self, blocks: TextBlocks, hashes: bool) -> None:
        self.blocks, self.hashes = blocks, hashes
        self.values = np.empty(BATCH)
        self.starts = np.empty(BATCH, np.int64)
        self.flags = np.empty(BATCH, np.uint8)
        self.at = self.stop = self._count = self._used = 0

    def begin(self, element: Element) -> None:
        """Text needs no types."""

    def refill(self) -> bool:
        if self.stop < self._count:
            said = f"{self.said(self.stop)} is not a number"
            raise self.blocks.error(int(self.starts[self.stop]), said, "correct the line")
        self.at = self.stop = self._count = 0
        while self._count == 0:
            if self._used and not self.blocks.use(self._used):
                return False
            count, used = self._parse()
            if not used and not self.blocks.use(0):
                return False
            self._count, self._used = count, used
        bad = np.flatnonzero(self.flags[: self._count] & BAD_TOKEN)
        self.stop = int(bad[0]) if len(bad) else self._count
        for i in np.flatnonzero(self.flags[: self.stop] & SLOW_TOKEN):
            self.values[i] = float(self._token(int(i)))
        return True

    def _parse(self) -> tuple[int, int]:
        text, stop = self.blocks.text, self.blocks.stop
        out = (self.values, self.starts, self.flags)
        count, used = parse_numbers(text, 0, stop, self.hashes, *out)
        return int(count), int(used)

    def _token(self, i: int) -> bytes:
        after = i + 1 < self._count
        end = int(self.starts[i + 1]) if after else min(self._used, self.blocks.stop)
        return self.blocks.text[self.starts[i] : end].tobytes().split()[0].split(b"#")[0]

    def place(self, at: int) -> str:
        here = int(self.starts[at]) if at < self._count else self.blocks.last()
        return f"line {self.blocks.line_of(here)}"

    def said(self, at: int) -> str:
        return self.blocks.token(int(self.starts[at]))


class BinaryNumbers:
    """The numbers of binary records, as `begin` says what they are."""

    def __init__(self, file: BinaryIO, name: str, order: str) -> None:
        self._file, self._name = file, name
        self._swap = np.dtype(order + "i4") != np.dtype("i4")
        self._data = np.empty(BYTES, np.uint8)
        self._have = self._used = 0
        self.values, self.flags = np.empty(BATCH), np.zeros(BATCH, np.uint8)
        self._views = kernel.number_views()
        self.at = self.stop = 0
        self.tell = file.tell()  # byte of the first number that was not yet decoded

    def begin(self, element: Element) -> None:
        self._file.seek(self.tell)
        self._have = self._used = self.at = self.stop = 0
        codes = {kind: i for i, kind in enumerate(kernel.KINDS)}
        self._counts = np.array([codes.get(p.count, -1) for p in element.properties], np.int64)
        self._kinds = np.array([codes[p.kind] for p in element.properties], np.int64)
        self._rows = element.rows
        self._state = kernel.new_state()

    def refill(self) -> bool:
        rest = self._data[self._used : self._have].copy()
        self._data[: len(rest)] = rest
        self._have = len(rest) + self._file.readinto(self._data[len(rest) :].data)  # type: ignore[attr-defined]
        schema = (self._counts, self._kinds, self._rows, self._state, self.values, self._views)
        count, used = kernel.decode_records(self._data, 0, self._have, self._swap, *schema)
        self.at, self.stop, self._used = 0, int(count), int(used)
        self.tell += self._used
        return self.stop > 0

    def place(self, at: int) -> str:
        return f"byte {self.tell}" if at >= self.stop else f"before byte {self.tell}"

    def said(self, at: int) -> str:
        return f"{self.values[at]:.17g}"
