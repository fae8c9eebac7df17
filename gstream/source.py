"""Where the bytes of a block file come from: a path, memory, a callable, or a URL through fsspec.

Here: opening, and ranges that are kept. Not here: the network (gstream/remote.py), what bytes mean.
"""

import os
import re
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gstream.errors import CorruptFileError, UsageError

ReadAt = Callable[[int, int], bytes]  # (offset, length) -> bytes, fewer only at the file's end
Source = str | os.PathLike[str] | bytes | ReadAt

KEPT_BYTES: Final = 64 << 20  # of runs: eight siblings of 64^3 take 0.1 to 2 MB


def is_url(source: object) -> bool:
    """Whether a source is the name of something that fsspec opens: https://, s3://, …"""
    return isinstance(source, str) and re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", source) is not None


def _nothing() -> None:
    """What there is to close of memory and callables."""


@dataclass(slots=True)
class Ranges:
    """Byte ranges of one open file; the runs that were read to be kept cost nothing again."""

    read_at: ReadAt
    name: str  # for messages
    size: Callable[[], int | None]  # None where nobody says; asked after the first read
    release: Callable[[], None] = _nothing
    distant: bool = False  # a request takes a round trip: fewer and larger ones pay
    _runs: "OrderedDict[int, bytes]" = field(default_factory=OrderedDict)  # by offset

    def begin(self, length: int) -> bytes:
        """The first bytes, fewer where the file is shorter; kept."""
        self._runs[0] = bytes(self.read_at(0, length))
        return self._runs[0]

    def read(self, offset: int, length: int) -> bytes:
        """Exactly `length` bytes; a shorter read means a truncated file (GSB-0102)."""
        at = self._run_of(offset, length)
        if at is not None:
            self._runs.move_to_end(at)
            return self._runs[at][offset - at : offset - at + length]
        data = bytes(self.read_at(offset, length)) if length else b""
        if len(data) != length:
            said = f"wanted {length} bytes and got {len(data)}: truncated"
            raise CorruptFileError("GSB-0102", self.name, offset, said)
        return data

    def keep(self, offset: int, length: int) -> None:
        """Read a run in one request, or none if it is there; the oldest ones make room."""
        if self._run_of(offset, length) is None:
            self._runs[offset] = self.read(offset, length)
            while len(self._runs) > 1 and sum(map(len, self._runs.values())) > KEPT_BYTES:
                self._runs.popitem(last=False)

    def holds(self, offset: int, length: int) -> bool:
        """Whether reading these bytes takes no request."""
        return self._run_of(offset, length) is not None

    def _run_of(self, offset: int, length: int) -> int | None:
        for at, run in self._runs.items():
            if at <= offset and offset + length <= at + len(run):
                return at
        return None

    def close(self) -> None:
        """Forget all; a second call does nothing."""
        self.release()
        self.release, self.read_at = _nothing, _closed
        self._runs.clear()


def _closed(offset: int, length: int) -> bytes:
    raise UsageError("the block file is closed", "read it before closing it")


def open_ranges(source: Source, name: str = "") -> Ranges:
    """Open a source; close it afterwards.

    source : path, URL, the file's bytes, or a callable (offset, length) -> bytes
    name : for messages, where the source is no path
    errors : UsageError for what cannot be read
    """
    if isinstance(source, bytes):
        data = source
        return Ranges(lambda at, n: data[at : at + n], name or "memory", lambda: len(data))
    if not isinstance(source, str | os.PathLike):
        return Ranges(source, name or "remote file", lambda: None)
    if is_url(source):
        from gstream.remote import open_url

        name = name or str(source)
        read_at, size, release = open_url(str(source), name)
        return Ranges(read_at, name, size, release, distant=True)
    try:
        descriptor = os.open(source, os.O_RDONLY)
    except OSError as error:
        raise UsageError(f"{source}: {error.strerror}", "give a block file") from error
    return Ranges(
        _from_descriptor(descriptor),
        name or os.fspath(source),
        lambda: os.fstat(descriptor).st_size,
        lambda: os.close(descriptor),
    )


def _from_descriptor(descriptor: int) -> ReadAt:
    def read_at(offset: int, length: int) -> bytes:
        parts = []
        while length > 0:
            part = os.pread(descriptor, length, offset)
            if not part:
                break
            parts.append(part)
            offset, length = offset + len(part), length - len(part)
        return parts[0] if len(parts) == 1 else b"".join(parts)

    return read_at
