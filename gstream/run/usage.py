"""What a process and all its descendants take: memory, processor time, bytes; from /proc.

Nothing where there is no /proc: zeros. What a dead child took is its parent's, once waited for.
"""

import contextlib
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from gstream.run.worker import OURS

SAMPLE_SECONDS = 0.5
TICK = os.sysconf("SC_CLK_TCK")  # the unit of processor time in /proc


@dataclass(frozen=True, slots=True)
class Usage:
    """Processor time and bytes of a process tree, all that it ever took."""

    cpu_seconds: float = 0.0  # user and system
    read_bytes: int = 0  # by calls, from disk or cache: mapped files are not among them
    written_bytes: int = 0  # by calls
    disk_read_bytes: int = 0  # that a disk had to deliver, mapped files included
    disk_written_bytes: int = 0

    def since(self, earlier: "Usage") -> "Usage":
        """What was taken between `earlier` and this."""
        return Usage(
            self.cpu_seconds - earlier.cpu_seconds,
            self.read_bytes - earlier.read_bytes,
            self.written_bytes - earlier.written_bytes,
            self.disk_read_bytes - earlier.disk_read_bytes,
            self.disk_written_bytes - earlier.disk_written_bytes,
        )


def tree_usage(pid: int) -> Usage:
    """What process `pid`, all its descendants, and those of them that have ended took so far."""
    ticks, io = 0, {"rchar": 0, "wchar": 0, "read_bytes": 0, "write_bytes": 0}
    for member in processes(pid):
        with contextlib.suppress(OSError):
            with open(f"/proc/{member}/stat", "rb") as stat:
                # Behind the name, which may hold anything: utime, stime, cutime, cstime.
                ticks += sum(map(int, stat.read().rpartition(b")")[2].split()[11:15]))
            with open(f"/proc/{member}/io") as counters:
                for line in counters:
                    name, _, value = line.partition(":")
                    if name in io:
                        io[name] += int(value)
    return Usage(ticks / TICK, *io.values())


def tree_memory(pid: int) -> int:
    """Bytes of Σ (Pss_Anon + Pss_Shmem) over process `pid` and all its descendants."""
    total = 0
    for member in processes(pid):
        with contextlib.suppress(OSError), open(f"/proc/{member}/smaps_rollup", "rb") as rollup:
            for line in rollup:
                if line.startswith((b"Pss_Anon:", b"Pss_Shmem:")):
                    total += int(line.split()[1]) * 1024
    return total


def processes(pid: int) -> Iterator[int]:
    """`pid` and all its descendants that still run."""
    yield pid
    with contextlib.suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            with open(f"/proc/{pid}/task/{task}/children", "rb") as children:
                for child in children.read().split():
                    yield from processes(int(child))


class MemorySampler:
    """Samples the memory of this process tree every half second, from a thread of its own.

    told : called there with (bytes now, peak so far)
    """

    def __init__(self, told: Callable[[int, int], None]) -> None:
        self._told = told
        self._peaks = [0]  # of each stage; the last one is running
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._loop, name=f"{OURS}memory", daemon=True)

    @property
    def peak(self) -> int:
        """Bytes; 0 without /proc."""
        return max(self._peaks)

    def stage_peak(self) -> int:
        """The peak since the last call, in bytes."""
        self._sample()
        self._peaks.append(0)
        return self._peaks[-2]

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: object, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _sample(self) -> int:
        memory = tree_memory(os.getpid())
        self._peaks[-1] = max(self._peaks[-1], memory)
        return memory

    def _loop(self) -> None:
        while True:
            self._told(self._sample(), self.peak)
            if self._over.wait(SAMPLE_SECONDS):
                return
