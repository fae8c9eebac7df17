"""What the readers of this package and `gstream check` make of a file that may be hostile."""

import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any
from zlib import crc32

import numpy as np

from gstream.check import check_file
from gstream.compiled import compiled
from gstream.errors import CorruptFileError, UnsupportedError
from gstream.formats import stream_filters as plain_stream
from gstream.formats.arithmetic import Choice, plain
from gstream.formats.findings import ERROR, Finding
from gstream.formats.stream import StreamReader
from gstream.formats.stream_parts import warm_filters
from gstream.kernels import filters
from gstream.kernels import indexing as compiled_stream
from gstream.read import open_block_file

VECTORS = Path(__file__).parents[2] / "spec" / "vectors"
SECONDS = 2  # of CPU, for one file
DECODED = ("read", "GSB-04", "GST-01")  # outcomes that take decoding: the rest is common to readers
ALLOCATION = 65 << 20  # bytes that no single allocation may exceed, or four times the file


class HangError(TimeoutError):
    """A reader took longer than SECONDS."""


def _hang(*_: object) -> None:
    raise HangError(f"no answer after {SECONDS} s of CPU")


@contextmanager
def deadline() -> Iterator[Callable[[], None]]:
    """Gives a function that begins a new span of SECONDS; HangError where it runs out."""
    before = signal.signal(signal.SIGVTALRM, _hang)
    try:
        yield lambda: signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


@contextmanager
def limited_memory(more: int = ALLOCATION) -> Iterator[None]:
    """Leave this process `more` bytes of address space beyond what it has: MemoryError above."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + more, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def warm() -> None:
    """Compile what is compiled, before time and memory are limited."""
    filters.warm()
    for path in (VECTORS / "good").glob("*.gsb"):
        findings(path, compiled)
    warm_filters(compiled_stream)


def findings(path: Path, choose: Choice) -> list[Finding]:
    """What `gstream check` finds, with NumPy or compiled."""
    return check_file(path, choose=choose).findings


def verdict(path: Path) -> str:
    """What `gstream check` says: valid, unsupported, or the rules that are broken."""
    try:
        found = findings(path, plain)
    except UnsupportedError:
        return "unsupported"
    except CorruptFileError as error:
        return error.rule
    return " ".join({f.rule: 0 for f in found if f.severity == ERROR}) or "valid"


def outcome(path: Path, *, fast: bool) -> str:
    """What a reader makes of the whole file: a digest, `unsupported`, or the rule it refuses by."""
    with path.open("rb") as file:
        is_stream = file.read(4)[1:] == b"GST"
    try:
        if is_stream:
            return _read_stream(path, compiled_stream if fast else plain_stream)
        return _read_blocks(path, compiled if fast else plain)
    except UnsupportedError:
        return "unsupported"
    except CorruptFileError as error:
        return error.rule


def _read_stream(path: Path, filters: ModuleType) -> str:
    stream = StreamReader(path, filters)
    digest = 0
    for index in range(len(stream.chunks)):
        for _, values in sorted(stream.parts(index).items()):
            digest = _sum(values, digest)
    return f"read {digest:08x}"


def _read_blocks(path: Path, choose: Choice) -> str:
    digest = 0
    with open_block_file(path, choose=choose) as file:
        for level in reversed(range(file.levels)):
            for view in file.blocks(level, file.columns):
                for name in file.columns:
                    try:
                        digest = _sum(view.column(name), digest)
                    except UnsupportedError:
                        digest = _sum(None, digest)
    return f"read {digest:08x}"


def _sum(values: Any, digest: int) -> int:
    return crc32(b"-" if values is None else np.ascontiguousarray(values).data, digest)


def disagreement(path: Path) -> str | None:
    """How check and the two readers contradict each other; None if they do not."""
    checked = verdict(path)
    slow = outcome(path, fast=False)
    if slow.startswith(DECODED) and (fast := outcome(path, fast=True)) != slow:
        return f"NumPy's reader: {slow}, the compiled one: {fast}"
    if slow.startswith(DECODED) and path.suffix == ".gsb":
        found, fast_found = findings(path, plain), findings(path, compiled)
        if found != fast_found:
            return f"NumPy's check: {found}, the compiled one: {fast_found}"
    if checked == "valid" and not slow.startswith("read"):
        return f"check finds it valid, and the reader: {slow}"
    if checked == "unsupported" and slow != "unsupported" and not slow.startswith("read"):
        return f"check finds it unsupported, and the reader: {slow}"
    return None
