"""A disk whose every operation can be made to fail: the calls of this process on files, replaced.

Each operation on what lies below one folder is numbered, and told before it happens: "open" (to
write, and of folders), "write", "fsync", "rename"; "mkdir", "unlink", "rmdir"; "read" (to open to
read, and `os.pread`). Writing to a map of a file is not seen.
"""

import builtins
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

import numpy as np

Told = Callable[[int, str, str], None]  # number, operation, path; raises what is to happen instead


class Disk:
    """The operations below `root` in this process, in order, and what of them a crash would lose.

    half : every write takes only half of what it is given, at least a byte
    """

    def __init__(self, root: Path, told: Told = lambda *_: None, half: bool = False) -> None:
        self.root, self.told, self.half = str(root), told, half
        self.log: list[tuple[str, str]] = []
        self._telling = False
        self.unsynced: set[str] = set()  # files whose bytes a crash may lose
        self.renamed: dict[str, bytes | None] = {}  # names a crash may undo -> what they stood for

    @contextmanager
    def installed(self) -> Iterator["Disk"]:
        """Everything that this process does below the root goes through here."""
        keep = {name: getattr(os, name) for name in ("open", "fsync", "pread", "replace")}
        plain_open, flush = builtins.open, np.memmap.flush

        def open_file(
            path: Any, mode: str = "r", buffering: int = -1, *more: Any, **named: Any
        ) -> Any:
            if self._ours(path):
                self._tell("read" if mode in ("r", "rb") else "open", path)
            if not self._ours(path) or mode not in ("wb", "ab"):
                return plain_open(path, mode, buffering, *more, **named)
            raw = _Raw(self, str(path), mode[0])
            # Not a BufferedWriter: numpy would find its descriptor, and write past it.
            return raw if buffering == 0 else io.BufferedRandom(raw, max(buffering, 8192))

        def open_descriptor(path: Any, flags: int, *more: Any, dir_fd: int | None = None) -> int:
            if dir_fd is None and self._ours(path):
                self._tell("open", path)
            return keep["open"](path, flags, *more, dir_fd=dir_fd)

        def fsync(descriptor: int) -> None:
            path = os.readlink(f"/proc/self/fd/{descriptor}")
            if self._ours(path):
                self._tell("fsync", path)
            keep["fsync"](descriptor)
            self.unsynced.discard(path)
            for name in [name for name in self.renamed if os.path.dirname(name) == path]:
                del self.renamed[name]

        def flush_map(array: Any) -> None:
            flush(array)
            self.unsynced.discard(str(array.filename))

        def read(descriptor: int, length: int, offset: int) -> bytes:
            path = os.readlink(f"/proc/self/fd/{descriptor}")
            if self._ours(path):
                self._tell("read", path)
            return keep["pread"](descriptor, length, offset)

        def rename(source: Any, target: Any) -> None:
            if not self._ours(target):
                return keep["replace"](source, target)
            self._tell("rename", target)
            if os.path.isfile(source):
                self.renamed[str(target)] = None
                if os.path.exists(target):
                    with plain_open(target, "rb") as old:
                        self.renamed[str(target)] = old.read()
            keep["replace"](source, target)
            if str(source) in self.unsynced:
                self.unsynced.remove(str(source))
                self.unsynced.add(str(target))
            return None

        def told_first(name: str) -> Callable[..., Any]:
            plain = getattr(os, name)

            def call(path: Any, *more: Any, dir_fd: int | None = None, **named: Any) -> Any:
                if dir_fd is None and self._ours(path):
                    self._tell(name, path)
                return plain(path, *more, dir_fd=dir_fd, **named)

            return call

        replaced = {
            "open": open_descriptor,
            "fsync": fsync,
            "pread": read,
            "replace": rename,
            "rename": rename,
            **{name: told_first(name) for name in ("mkdir", "unlink", "rmdir")},
        }
        with (
            patch.multiple(os, **replaced),
            patch.object(builtins, "open", open_file),
            patch.object(io, "open", open_file),
            patch.object(np.memmap, "flush", flush_map),
        ):
            yield self

    def lose_power(self, random: Random) -> None:
        """Damage what was not synced, as file systems do: bytes are zero or cut, names undone."""
        for name in filter(os.path.exists, sorted(self.unsynced)):
            size = os.path.getsize(name)
            match random.randrange(3):
                case 0:  # the length was on disk, the bytes were not
                    os.truncate(name, 0)
                    os.truncate(name, size)
                case 1:
                    os.truncate(name, random.choice((0, 1, size // 2, size - 1)) if size else 0)
        for name, held in sorted(self.renamed.items()):
            if os.path.exists(name) and random.randrange(3) == 0:
                os.unlink(name)
                if held is not None:
                    Path(name).write_bytes(held)

    def _ours(self, path: Any) -> bool:
        return not isinstance(path, int) and os.fspath(path).startswith(self.root)

    def _tell(self, operation: str, path: Any) -> None:
        if not self._telling:  # what is done while being told is no operation
            self._telling = True
            self.log.append((operation, str(path)))
            try:
                self.told(len(self.log) - 1, operation, str(path))
            finally:
                self._telling = False


class _Raw(io.FileIO):
    """A file open for writing whose writes are operations; one that fails has written half."""

    def __init__(self, disk: Disk, path: str, mode: str) -> None:
        super().__init__(path, f"{mode}+")
        self._disk, self._path = disk, path
        disk.unsynced.add(path)

    def write(self, data: Any) -> int:
        data = memoryview(data).cast("B")
        some = data[: max(1, len(data) // 2)]
        try:
            self._disk._tell("write", self._path)
        except OSError:
            super().write(some)
            raise
        self._disk.unsynced.add(self._path)
        return super().write(some if self._disk.half else data)
