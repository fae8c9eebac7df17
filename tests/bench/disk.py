"""How fast a folder's disk writes and reads."""

import os
import tempfile
import time
from pathlib import Path

from tests.bench.figures import DiskRate

BYTES = 256 << 20
PIECE = 4 << 20


def measure_disk(folder: Path) -> DiskRate:
    """Write 256 MiB with fsync and read them back, having dropped them from the page cache."""
    piece = os.urandom(PIECE)  # a disk may compress
    with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
        start = time.perf_counter()
        for _ in range(BYTES // PIECE):
            file.write(piece)
        os.fsync(file.fileno())
        written = time.perf_counter() - start
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
        file.seek(0)
        start = time.perf_counter()
        while file.read(PIECE):
            pass
        read = time.perf_counter() - start
    return DiskRate(read=BYTES / read, write=BYTES / written)
