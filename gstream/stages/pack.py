"""Pack: the blocks of all levels to one block file, copying compressed columns.

Nothing is decoded: the rows carry the lengths, CRCs and hashes that the directory and the content
id need.
"""

import json

import numpy as np

from gstream.formats.blockfile import Fetch, write_block_file
from gstream.formats.blockhead import BlockFileHeader
from gstream.formats.cells import SCENE, Scene
from gstream.formats.columns import hash64
from gstream.formats.directory import Rows
from gstream.formats.framing import CODEC_CONSTANT, crc32
from gstream.formats.rows import pipeline_columns, rows_from_bytes
from gstream.job import Job, Summary, Unit, VoxelizeSettings
from gstream.run.publish import Scratch, publish

NAME = "7-pack"
MERGED, ABOVE = "5-merge", "6-simplify"
PILES = "piles.json"


def plan(job: Job) -> list[Unit]:
    """One unit: a block file is written strictly forward."""
    return [Unit(NAME, "file")]


def work(job: Job, unit: Unit) -> None:
    """Lay out and write the block file, and publish it under its final name."""
    settings = job.voxelizing
    with Scratch(job) as scratch:
        scene = Scene.from_json(scratch.read(f"{MERGED}/{SCENE}"))
        header = _header(scene, settings)
        bits = header.vertex_bits if settings.keep_geometry else 0
        columns = pipeline_columns(scene.columns, settings.normal_bits, bits)
        rows, piles = rows_from_bytes(scratch.read(f"{MERGED}/blocks.rows"), columns), []
        piles += json.loads(scratch.read(f"{MERGED}/{PILES}"))
        if settings.lod:
            above = rows_from_bytes(scratch.read(f"{ABOVE}/levels.rows"), columns)
            above["pile"] += len(piles)
            rows = np.concatenate([rows, above])
            piles += json.loads(scratch.read(f"{ABOVE}/{PILES}"))
        keep = settings.keep_weights or not settings.lod
        kept = [column for column in columns if column.name != "weight" or keep]

        def fetch(pile: int, offset: int, length: int) -> bytes:
            return scratch.read(piles[pile], offset, length)

        if scene.weighted and keep and not settings.keep_weights:
            _seal_weights(rows, fetch)
        with publish(job.output, job) as file:
            write_block_file(
                file,
                header,
                rows,
                fetch,
                {**scene.metadata, "ledger": dict(scene.counts)},
                kept,
            )
            size = file.tell()
        scratch.mark_done(unit, _counts(rows, size), (job.output,))


def finish(job: Job) -> Summary:
    """The counts of the one unit."""
    with Scratch(job) as scratch:
        counts = scratch.finished(plan(job))[0]
    return Summary(NAME, counts)


def _seal_weights(rows: Rows, fetch: Fetch) -> None:
    """Set the CRC and hash of weights that were scratch for levels which are not made."""
    for row in rows:
        record = row["weight"]
        if record["codec"] == CODEC_CONSTANT:
            raw = np.full(int(row["count"]), record["constant"], "<u4").tobytes()
        else:
            raw = fetch(int(row["pile"]), int(record["offset"]), int(record["stored"]))
            record["crc"] = crc32(raw)
        row["hash"]["weight"] = hash64(raw)


def _header(scene: Scene, settings: VoxelizeSettings) -> BlockFileHeader:
    return BlockFileHeader(
        resolution=scene.grid.resolution,
        snap_bits=scene.grid.snap_bits,
        levels=scene.grid.level_count(settings.block) if settings.lod else 1,
        block_log2=settings.block.bit_length() - 1,
        matrix=scene.grid.matrix,
        box=(*scene.box[0], *scene.box[1]),
        sep=settings.sep,
        ties=settings.ties,
        faces=settings.faces,
        normals=settings.normals,
        lod_weighting="area" if scene.weighted else "count",
        normal_bits=settings.normal_bits,
    )


def _counts(rows: Rows, size: int) -> dict[str, int | float]:
    """Voxels per level, blocks, bytes, and file bytes per finest voxel."""
    voxels = {
        f"voxels_level_{level}": int(rows["count"][rows["level"] == level].sum())
        for level in np.unique(rows["level"])
    }
    finest = voxels.get("voxels_level_0", 0)
    per_voxel = round(size / finest, 3) if finest else 0.0
    return {**voxels, "blocks": len(rows), "bytes": size, "bytes_per_voxel": per_voxel}
