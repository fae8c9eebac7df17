"""One tiny job for all tests of faults."""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from faults.tiny import TinyJob, tiny_job

# The job runs some 600 times; on a disk, waiting for it took two thirds of the time.
IN_MEMORY = "/dev/shm" if os.path.isdir("/dev/shm") else None


@pytest.fixture(scope="session")
def tiny() -> Iterator[TinyJob]:
    with tempfile.TemporaryDirectory(prefix="gstream-faults-", dir=IN_MEMORY) as folder:
        yield tiny_job(Path(folder))
