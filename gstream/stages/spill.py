"""Stage 1: every input becomes a mesh of arrays on disk, mapped where it lies or spilled to scratch."""

from collections import Counter
from pathlib import Path

from gstream.errors import StoppedError, UsageError
from gstream.job import IngestSettings, Job, Summary, Unit
from gstream.readers import open_mesh
from gstream.readers.warm import warm_readers
from gstream.run.publish import Scratch

NAME = "1-spill"
UNIT_MEMORY = 160 << 20  # bytes: a reader's blocks and batches, measured below 120 MiB of anonymous memory


def plan(job: Job) -> list[Unit]:
    """One unit per input, costed by its bytes."""
    units = []
    for index, path in enumerate(_settings(job).inputs):
        try:
            size = Path(path).stat().st_size
        except OSError as error:
            said = f"{path}: cannot be read ({error.strerror})"
            raise UsageError(said, "give a path that exists and that you may read") from error
        units.append(Unit(NAME, str(index), float(size), UNIT_MEMORY, index, (index, path)))
    return units


def work(job: Job, unit: Unit) -> None:
    """Open the unit's input and publish `1-spill/<index>.json`, the mesh."""
    scratch, (index, path) = Scratch(job), unit.data
    files: list[str] = []

    def spill(name: str) -> Path:
        files.append(f"{NAME}/{index}-{name}")
        return scratch.path(files[-1])

    mesh = open_mesh(Path(path), spill)
    described = f"{NAME}/{index}.json"
    with scratch.write(described) as file:
        file.write(mesh.to_json())
    counts = {
        "inputs": 1,
        "faces": mesh.faces,
        "triangles": mesh.triangle_count,
        "vertices": mesh.vertex_count,
        "skipped_faces": mesh.skipped_faces,
        **mesh.notes,
    }
    kept = [name for name in files if mesh.lies_in(scratch.path(name))]
    scratch.mark_done(unit, counts, (described, *kept))


def finish(job: Job) -> Summary:
    """The sums over all inputs; StoppedError when an input was not opened yet."""
    scratch, total = Scratch(job), Counter[str]()
    done = [(unit, scratch.done(unit)) for unit in plan(job)]
    missing = [unit.data[1] for unit, counts in done if counts is None]
    if missing:
        said = f"{len(missing)} of {len(done)} inputs are not opened, the first is {missing[0]}"
        raise StoppedError(said, "run the same command again")
    for _, counts in done:
        total.update(counts or {})
    return Summary(NAME, dict(sorted(total.items())))


def warm() -> None:
    """Compile or load the readers' kernels."""
    warm_readers()


def _settings(job: Job) -> IngestSettings:
    if job.ingest is None:
        raise UsageError("the job has no ingest settings", "report this as a bug")
    return job.ingest
