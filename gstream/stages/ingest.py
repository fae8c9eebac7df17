"""Ingest: slices of the input meshes become chunks, and the chunks one geometry stream.

A unit is a range of one input's triangles. Its chunks go to `2-ingest/<unit>.part`; `finish` puts
header, parts, directory and tail together. What a mesh file looks like is the readers' business.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from gstream.errors import InputError, UsageError
from gstream.formats.stream import Attribute, StreamWriter, encode_chunk
from gstream.formats.stream_chunk import (
    COLOUR,
    HEAD_READ,
    NORMAL,
    POSITION_F4,
    POSITION_F8,
    ChunkHead,
)
from gstream.formats.stream_parts import warm_filters
from gstream.job import IngestSettings, Job, Summary, Unit, scratch_name
from gstream.kernels import indexing
from gstream.readers.mesh import Mesh
from gstream.run.publish import Scratch, publish
from gstream.stages.slicing import Slice, chunks_of, slice_of, warm_slicing

NAME = "2-ingest"
UNIT_CHUNKS = 16  # a million triangles: seconds of work, little to redo after a kill
BASE_MEMORY = 64 << 20  # bytes beside what grows with the unit
TRIANGLE_MEMORY = {"file": 40, "spatial": 150, "smallest": 180}  # bytes
COUNTED = ("read", "stored", "non_finite", "degenerate", "vertices", "chunks", "bytes")


def plan(job: Job) -> list[Unit]:
    """Ranges of triangles of each input; they depend on the inputs and settings alone."""
    settings = _settings(job)
    if not 1 <= settings.chunk_triangles <= 65_536:
        said = f"--chunk-triangles {settings.chunk_triangles} is out of range"
        raise UsageError(said, "give 1 to 65536")
    step = UNIT_CHUNKS * settings.chunk_triangles
    units: list[Unit] = []
    for source, mesh in enumerate(_meshes(job)):
        for first in range(0, mesh.triangle_count, step):
            count = min(step, mesh.triangle_count - first)
            name = f"{source:05d}-{first // step:07d}"
            memory = BASE_MEMORY + count * TRIANGLE_MEMORY[settings.order]
            units.append(Unit(NAME, name, float(count), memory, len(units), (source, first, count)))
    return units


def work(job: Job, unit: Unit) -> None:
    """Write one unit's chunks, encoded, one after another."""
    settings = _settings(job)
    source, first, count = unit.data
    counts = dict.fromkeys(COUNTED, 0)
    counts["read"] = count
    part = _part(unit)
    with Scratch(job) as scratch:
        with scratch.write(part) as file:
            arranged = _arranged(_mesh(scratch, source), source, first, count, settings)
            for chunk in chunks_of(arranged, settings.chunk_triangles):
                data = encode_chunk(chunk, settings.lz4, indexing)
                file.write(data)
                counts["stored"] += chunk.triangle_count
                counts["non_finite"] += chunk.non_finite
                counts["degenerate"] += chunk.degenerate
                counts["vertices"] += len(chunk.positions)
                counts["chunks"] += 1
                counts["bytes"] += len(data)
        scratch.mark_done(unit, counts, (part,))


def finish(job: Job) -> Summary:
    """Join all parts into the stream; the totals per source are part of the file."""
    units, meshes = plan(job), _meshes(job)
    sources = [_source(mesh) for mesh in meshes]
    sums = dict.fromkeys(COUNTED, 0)
    with Scratch(job) as scratch:
        for unit, count in zip(units, scratch.finished(units), strict=True):
            for key in COUNTED:
                sums[key] += count[key]
            for key in ("read", "stored", "non_finite", "degenerate"):
                sources[unit.data[0]][key] += count[key]
        _refuse_nothing(meshes, sums)
        Path(job.stream).parent.mkdir(parents=True, exist_ok=True)
        with publish(job.stream, job) as file:
            writer = StreamWriter(file, _attributes(meshes), _metadata(_settings(job)))
            for unit in units:
                for data in _encoded(scratch, _part(unit)):
                    writer.add_chunk(data)
            sums["bytes"] = writer.finish({"sources": sources})
    return Summary(NAME, sums)


def warm() -> None:
    """Compile the kernels for the layouts that meshes usually have."""
    warm_slicing()
    warm_filters(indexing)


def _arranged(mesh: Mesh, source: int, first: int, count: int, settings: IngestSettings) -> Slice:
    """The unit's triangles in the order asked for; smallest: the better one, by fast packing."""
    if settings.order != "smallest":
        return slice_of(mesh, source, first, count, settings.order)

    def packed(work: Slice) -> int:
        chunks = chunks_of(work, settings.chunk_triangles)
        return sum(len(encode_chunk(chunk, "fast", indexing)) for chunk in chunks)

    orders = ("file", "spatial")
    return min((slice_of(mesh, source, first, count, order) for order in orders), key=packed)


def _settings(job: Job) -> IngestSettings:
    if job.ingest is None:
        raise UsageError("the job has no inputs", "give at least one mesh")
    return job.ingest


def _mesh(scratch: Scratch, source: int) -> Mesh:
    return Mesh.from_json(scratch.read(scratch_name("1-spill", f"{source}.json")))


def _meshes(job: Job) -> list[Mesh]:
    with Scratch(job) as scratch:
        return [_mesh(scratch, source) for source in range(len(_settings(job).inputs))]


def _part(unit: Unit) -> str:
    return scratch_name(NAME, f"{unit.name}.part")


def _source(mesh: Mesh) -> dict[str, Any]:
    """The totals of one input before its units are added; only its base name goes into the file."""
    skipped = {"skipped_faces": mesh.skipped_faces, **dict(mesh.notes)}
    counted = {"read": 0, "stored": 0, "non_finite": 0, "degenerate": 0}
    return {"name": Path(mesh.name).name, **skipped, **counted}


def _refuse_nothing(meshes: list[Mesh], sums: dict[str, int]) -> None:
    if sums["stored"]:
        return
    names = meshes[0].name if len(meshes) == 1 else f"{meshes[0].name} and {len(meshes) - 1} more"
    if sums["non_finite"]:
        said = f"all {sums['non_finite']} triangles have NaN or infinite coordinates"
    else:
        said = "there is not one triangle"
    raise InputError(names, "", said, "give a mesh that has faces with finite corners")


def _attributes(meshes: list[Mesh]) -> list[Attribute]:
    """What any chunk may carry; an attribute that only some inputs have is declared once."""
    found = set()
    for mesh in meshes:
        double = np.dtype(mesh.positions.dtype).itemsize == 8
        found.add(POSITION_F8 if double else POSITION_F4)
        if mesh.normals is not None:
            found.add(NORMAL)
        if mesh.colours is not None or mesh.triangle_colours is not None:
            found.add(COLOUR)
    return sorted(found, key=lambda attribute: attribute.id)


def _metadata(settings: IngestSettings) -> dict[str, Any]:
    """Absent, null and a value stay apart: a key that was not given is not written."""
    bounds = {} if settings.bounds is None else {"bounds": list(settings.bounds)}
    return {**dict(settings.metadata), **bounds}


def _encoded(scratch: Scratch, part: str) -> Iterator[bytes]:
    """The chunks of a part, one at a time."""
    at, end = 0, scratch.size(part)
    while at < end:
        head = ChunkHead.read(scratch.read(part, at, min(HEAD_READ, end - at)), part, at)
        data = scratch.read(part, at, head.size + head.payload)
        yield data
        at += len(data)
