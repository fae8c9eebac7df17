"""A text file read in blocks: what a kernel did not use stays at the front of the next block."""

from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from gstream.errors import InputError

BLOCK = 2 << 20  # bytes
LONGEST = 64 << 20  # bytes that one line or facet may take


class TextBlocks:
    """A window `text[:stop]` on an open file; `use(n)` drops bytes from its front and reads on.

    Two line feeds are added to the end of the file, so that every line has an end, also one that
    a backslash before a return would join to the next.
    """

    def __init__(self, file: BinaryIO, name: str, first_line: int = 1) -> None:
        self.name, self.line = name, first_line
        self._file = file
        self._after_return = False
        self.text = np.empty(BLOCK, np.uint8)
        self.stop, self.ended, self._closed = 0, False, False
        self._fill()

    def use(self, count: int) -> bool:
        """Drop `count` bytes and read more; False when the last window is used up or stuck.

        A window that nothing was taken from grows, up to LONGEST.
        """
        if self.ended and count in (0, self.stop):
            return False
        self.line += self._line_ends(count)
        if count:
            self._after_return = bool(self.text[count - 1] == 13)
        elif self.stop == len(self.text):
            self._grow()
        self.text[: self.stop - count] = self.text[count : self.stop].copy()
        self.stop -= count
        self._fill()
        return True

    def line_of(self, at: int) -> int:
        """The line number, from 1, of byte `at` of the window."""
        return self.line + self._line_ends(at)

    def last(self) -> int:
        """The byte after the last one of the window that is no white space."""
        return len(self.text[: self.stop].tobytes().rstrip())

    def token(self, at: int) -> str:
        """The token at byte `at`, printable and short enough for an error."""
        words = bytes(self.text[at : min(at + 40, self.stop)]).split()
        return ascii(words[0].decode("latin-1")) if words else "the end of the file"

    def error(self, at: int, said: str, remedy: str) -> InputError:
        return InputError(self.name, f"line {self.line_of(at)}", said, remedy)

    def round_slow(self, values: npt.NDArray[np.float64], slow: npt.NDArray[np.int64]) -> None:
        """Let Python round what a kernel left: rows of place in `values`, first, end in `text`."""
        for place, first, end in slow:
            values[place] = float(self.text[first:end].tobytes())

    def _line_ends(self, count: int) -> int:
        text = self.text[:count]
        feeds, returns = text == 10, text == 13
        lines = int(np.count_nonzero(feeds))
        if returns.any():
            lines += int(np.count_nonzero(returns)) - int(
                np.count_nonzero(returns[:-1] & feeds[1:])
            )
        return lines - int(self._after_return and count > 0 and bool(feeds[0]))

    def _grow(self) -> None:
        if len(self.text) >= LONGEST:
            said = f"one line is longer than {LONGEST >> 20} MiB"
            raise InputError(self.name, f"line {self.line}", said, "is it text? export it again")
        self.text = np.concatenate([self.text, np.empty_like(self.text)])

    def _fill(self) -> None:
        while not self.ended and self.stop < len(self.text):
            read = self._file.readinto(self.text[self.stop :].data)  # type: ignore[attr-defined]
            self.ended = read == 0
            self.stop += read
        if self.ended and not self._closed:
            self._closed = True
            self.text = np.append(self.text[: self.stop], np.array([10, 10], np.uint8))
            self.stop += 2
