"""Unpack: level 0 of a block file to the files that merge would have left.

It stands where merge stands when the levels of a finished file are (re)built, under merge's name.
"""

from gstream.blockview import BlockView
from gstream.compiled import compiled
from gstream.formats.cells import SCENE, Scene
from gstream.formats.columns import Block
from gstream.formats.pieces import NO_PIECES
from gstream.formats.pile import PileWriter, read_pile_rows
from gstream.formats.rows import names_json
from gstream.grid import Grid
from gstream.job import Job, Summary, Unit
from gstream.read import BlockFile, open_block_file
from gstream.run.publish import Scratch
from gstream.stages import levels
from gstream.stages.levels import LevelPile, job_columns

NAME = "5-merge"
ROWS, PILES, PILE = "blocks.rows", "piles.json", "level-0.gsp"


def plan(job: Job) -> list[Unit]:
    """One unit: the file is read from one end to the other."""
    return [Unit(NAME, "rows")]


def work(job: Job, unit: Unit) -> None:
    """Copy the finest blocks to a pile, and publish their rows and the scene."""
    settings = job.voxelizing
    names = {name: f"{NAME}/{name}" for name in (ROWS, PILES, PILE, SCENE)}
    with Scratch(job) as scratch, open_block_file(job.stream, choose=compiled) as source:
        scene = _scene(source)
        with (
            scratch.write(names[PILE]) as file,
            PileWriter(file, job_columns(settings, scene)) as pile,
        ):
            finest = LevelPile(pile, settings, scene, top=0)
            for view in source.blocks(0):
                pieces = view.pieces() if settings.keep_geometry else NO_PIECES
                finest.write(view.key, 0, _block(view, scene), pieces=pieces)
        rows = read_pile_rows(
            lambda at, n: scratch.read(names[PILE], at, n), scratch.size(names[PILE]), names[PILE]
        )
        with scratch.write(names[ROWS]) as file:
            file.write(rows.tobytes())
        with scratch.write(names[PILES]) as file:
            file.write(names_json([names[PILE]]))
        with scratch.write(names[SCENE]) as file:
            file.write(scene.to_json().encode())
        counts = {"blocks": finest.blocks, "voxels": finest.voxels}
        scratch.mark_done(unit, counts, tuple(names.values()))


def finish(job: Job) -> Summary:
    """The counts of the one unit."""
    with Scratch(job) as scratch:
        return Summary(NAME, scratch.finished(plan(job))[0])


def warm() -> None:
    """Compile the kernels of this stage."""
    levels.warm()


def _scene(source: BlockFile) -> Scene:
    header, metadata = source.header, dict(source.metadata)
    ledger = dict(metadata.pop("ledger"))
    del ledger["voxels"]
    m, box = header.matrix, header.box
    return Scene(
        grid=Grid(header.resolution, m[0], (m[3], m[7], m[11]), header.snap_bits),
        cell_bits=8,
        colours="colour" in source.columns,
        normals=header.normals == "input",
        box=((box[0], box[1], box[2]), (box[3], box[4], box[5])),
        metadata=metadata,
        counts=ledger,
        weighted="weight" in source.columns,
        normal_column="normal" in source.columns,
    )


def _block(view: BlockView, scene: Scene) -> Block:
    return Block(
        view.column("occupancy"),
        view.mask,
        view.normal_codes if scene.normal_column else None,
        view.colour if scene.colours else None,
        view.weight if scene.weighted else None,
    )
