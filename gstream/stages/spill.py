"""Stage 1: every input becomes a mesh of arrays on disk, mapped where it lies or spilled."""

import json
from collections import Counter
from pathlib import Path

from gstream.errors import StoppedError, UsageError
from gstream.job import IngestSettings, Job, Summary, Unit, scratch_name
from gstream.readers import needs_spill, open_mesh
from gstream.readers.warm import warm_readers
from gstream.run.fingerprint import fingerprint_if_any
from gstream.run.publish import BESIDE, Scratch

NAME = "1-spill"
UNIT_MEMORY = 64 << 20  # bytes of blocks and batches; measured: below 50 MiB over an idle process


def plan(job: Job) -> list[Unit]:
    """One unit per input, costed by its bytes; a mapped input costs next to nothing.

    For worker processes the text kernels are compiled here, in their parent, as many processes
    filling one numba cache is numba issue 4807, and `warm` knows no job: it would make each job
    that only maps its inputs pay 17 s of compiling once.
    """
    units, spilled = [], set()
    for index, path in enumerate(_settings(job).inputs):
        source = Path(path)
        spills = needs_spill(source)
        size = source.stat().st_size
        if spills:
            plain = source.stem if source.suffix.lower() == ".gz" else source.name
            spilled.add(Path(plain).suffix)
        cost, memory = (float(size), UNIT_MEMORY) if spills else (size / 100, UNIT_MEMORY // 8)
        units.append(Unit(NAME, str(index), cost, memory, index, (index, path)))
    if job.workers and spilled:
        warm_readers(spilled)
    return units


def work(job: Job, unit: Unit) -> None:
    """Open the unit's input and publish `1-spill/<index>.json`, the mesh."""
    with Scratch(job) as scratch:
        _open(scratch, unit)


def _open(scratch: Scratch, unit: Unit) -> None:
    index, path = unit.data
    names: list[str] = []

    def spill(label: str) -> Path:
        names.append(scratch_name(NAME, f"{index}-{label}"))
        return scratch.path(names[-1])

    scratch.path(NAME).mkdir(parents=True, exist_ok=True)
    mesh = open_mesh(Path(path), spill)
    kept = [name for name in names if mesh.lies_in(scratch.path(name))]
    for name in set(names) - set(kept):
        scratch.path(name).unlink(missing_ok=True)
    if mesh.beside:
        with scratch.write(scratch_name(NAME, f"{index}{BESIDE}")) as file:
            found = {name: fingerprint_if_any(name) for name in mesh.beside}
            file.write(json.dumps(found).encode())
    described = scratch_name(NAME, f"{index}.json")
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
    scratch.mark_done(unit, counts, (described, *kept))


def finish(job: Job) -> Summary:
    """The sums over all inputs; StoppedError when an input was not opened yet."""
    inputs = _settings(job).inputs
    with Scratch(job) as scratch:
        done = [scratch.done(Unit(NAME, str(index))) for index in range(len(inputs))]
    missing = [path for path, counts in zip(inputs, done, strict=True) if counts is None]
    if missing:
        said = f"{len(missing)} of {len(inputs)} inputs are not opened, the first is {missing[0]}"
        raise StoppedError(said, "run the same command again")
    total = Counter[str]()
    for counts in done:
        total.update(counts or {})
    return Summary(NAME, dict(sorted(total.items())))


def _settings(job: Job) -> IngestSettings:
    if job.ingest is None:
        raise UsageError("the job has no ingest settings", "report this as a bug")
    return job.ingest
