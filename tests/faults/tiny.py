"""A job of a hundred triangles that sends bytes to disk in every way, run in this process."""

import gzip
import io
import shutil
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from e2e.meshes import sphere, write_ply
from faults.disk import Disk, Told

from gstream_cli.main import status

OBJ = """v -1 -1 0 1 0 0
v 1 -1 0 0 1 0
v 0 1 0 0 0 1
vn 0 0 1
vn 0 1 0
f 1//1 2//2 3//1
"""
SETTINGS = ("--resolution", 16, "--block", 8, "--cell", 8, "--workers", 0, "--quiet")


@dataclass(frozen=True, slots=True)
class TinyJob:
    """A sphere to be unpacked and a coloured triangle to be read as text, and what they become."""

    meshes: tuple[Path, ...]
    place: Path  # folder of output and scratch, emptied for each trial
    whole: bytes  # the output of an undisturbed run
    log: Sequence[tuple[str, str]]  # its operations

    @property
    def output(self) -> Path:
        return self.place / "out.gsb"

    def held(self) -> bytes | None:
        """The output as it stands; None when there is none."""
        return self.output.read_bytes() if self.output.exists() else None

    def empty(self) -> None:
        shutil.rmtree(self.place, ignore_errors=True)
        self.place.mkdir()

    def build(self, *more: object) -> tuple[int, str]:
        """Exit status of a run, and what it said."""
        arguments = ("build", *self.meshes, "-o", self.output, "--tmp", self.place, *SETTINGS)
        with redirect_stderr(io.StringIO()) as said, redirect_stdout(said):
            code = status([str(argument) for argument in (*arguments, *more)])
        return code, said.getvalue()

    def build_on(self, told: Told, *more: object, half: bool = False) -> tuple[int, str]:
        """The same on a disk that tells its operations."""
        with Disk(self.place, told, half).installed():
            return self.build(*more)

    def numbers(self, *operations: str) -> list[int]:
        """Where in an undisturbed run these operations are, until the last unit is done."""
        return [n for n, (kind, _) in enumerate(self.log[: self.end]) if kind in operations]

    @property
    def end(self) -> int:
        """How many operations there are until the last unit is done; then the job's folder goes."""
        return 1 + max(n for n, (_, path) in enumerate(self.log) if path.endswith(".done"))


def tiny_job(folder: Path) -> TinyJob:
    """The job below `folder`, run once."""
    ply, packed, obj = folder / "a.ply", folder / "a.ply.gz", folder / "b.obj"
    packed.write_bytes(gzip.compress(write_ply(ply, *sphere(5)).read_bytes(), mtime=0))
    obj.write_text(OBJ)
    job = TinyJob((packed, obj), folder / "place", b"", [])
    job.empty()
    with Disk(job.place).installed() as disk:
        assert job.build() == (0, "")
    return TinyJob(job.meshes, job.place, job.output.read_bytes(), disk.log)
