"""--memory is a promise: the job ends well where the system allows no more."""

import contextlib
import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from e2e.program import PROGRAM, succeed

from tests.bench.meshes import write_sphere

MEMORY = 800 << 20
V1, V2 = Path("/sys/fs/cgroup/memory"), Path("/sys/fs/cgroup")


@pytest.fixture
def limited() -> Iterator[Path]:
    """A control group whose processes get MEMORY bytes together."""
    root, limit = (V1, "memory.limit_in_bytes") if V1.is_dir() else (V2, "memory.max")
    group = root / f"gstream-test-{os.getpid()}"
    try:
        group.mkdir()
        (group / limit).write_text(str(MEMORY))
    except OSError as error:
        with contextlib.suppress(OSError):
            group.rmdir()
        pytest.skip(f"no control group with a limit of memory can be made: {error.strerror}")
    yield group
    group.rmdir()


@pytest.mark.parametrize("more", [("--sep", 26), ("--keep-geometry",)])
def test_a_job_ends_well_in_a_control_group_of_the_memory_that_it_was_given(
    limited, tmp_path, more
):
    write_sphere(tmp_path / "a.ply", 400_000)
    build = ("build", "a.ply", "--resolution", 500, "--workers", 2, *more)
    succeed(tmp_path, *build, "-o", "free.gsb")  # compiles, if need be: not what is tested
    done = subprocess.run(
        [PROGRAM, *map(str, build), "-o", "a.gsb", "--memory", f"{MEMORY}", "--report", "r.json"],
        cwd=tmp_path,
        preexec_fn=lambda: (limited / "cgroup.procs").write_text(str(os.getpid())),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "r.json").read_text())["peak_memory"] <= MEMORY
    assert (tmp_path / "a.gsb").read_bytes() == (tmp_path / "free.gsb").read_bytes()
