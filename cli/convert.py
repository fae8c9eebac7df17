"""Commands that run a job: ingest, voxelize, build, simplify."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

from gstream.errors import UsageError
from gstream.job import IngestSettings, VoxelizeSettings
from gstream.run import commands
from gstream.run.commands import Request
from gstream.run.log import Log
from gstream.run.paths import check_folder
from gstream.run.progress import Event, Progress, silent
from gstream.run.publish import publish
from gstream.scene import explain

from . import options
from .progress import watch
from .report import full_report, table


@click.command()
@options.inputs
@options.output
@options.ingesting
@options.lz4
@options.running
def ingest(inputs: tuple[str, ...], output: str, **values: Any) -> None:
    """Read meshes into one geometry stream.

    Reads PLY, STL, OBJ and OFF, each also as .gz; several inputs make one scene.

    \b
    gstream ingest scan.ply -o scan.gst
    gstream ingest a.obj b.stl.gz -o scene.gst --units mm --up z --compact
    """
    run(commands.ingest(_ingest(inputs, values), output, options.run_options(values)), values)


@click.command()
@click.argument("stream", metavar="SCENE.gst")
@options.output
@options.voxelizing
@options.scene
@options.lz4
@options.running
def voxelize(stream: str, output: str, **values: Any) -> None:
    """Voxelize a geometry stream into a block file.

    All levels of detail are built, down to a single block.

    \b
    gstream voxelize scene.gst -o scene.gsb --resolution 4096
    gstream voxelize scene.gst -o scene.gsb --voxel-size 0.01 --sep conservative --memory 1GiB
    """
    settings, running = _voxelize(values), options.run_options(values)
    run(commands.voxelize(stream, settings, output, running, values["scene"]), values)


@click.command()
@options.inputs
@options.output
@options.voxelizing
@options.scene
@options.ingesting
@options.lz4
@options.running
def build(inputs: tuple[str, ...], output: str, **values: Any) -> None:
    """Ingest meshes and voxelize them in one job.

    \b
    gstream build scan.ply -o scan.gsb --resolution 2048
    gstream build a.obj b.obj -o scene.gsb --voxel-size 0.5 --units mm --workers 4
    """
    meshes, voxels, running = (
        _ingest(inputs, values),
        _voxelize(values),
        options.run_options(values),
    )
    run(commands.build(meshes, voxels, output, running, values["scene"]), values)


@click.command()
@click.argument("blockfile", metavar="IN.gsb")
@options.output
@options.running
def simplify(blockfile: str, output: str, **values: Any) -> None:
    """Rebuild the coarser levels of a block file.

    Needs level 0 alone; uses its weights where they are stored.

    \b
    gstream simplify fine.gsb -o scene.gsb
    """
    run(commands.simplify(blockfile, output, options.run_options(values)), values)


def _ingest(inputs: tuple[str, ...], values: dict[str, Any]) -> IngestSettings:
    return IngestSettings(
        inputs=inputs,
        **options.ingest_order(values),
        chunk_triangles=values["chunk"],
        bounds=values["bounds"],
        metadata=options.metadata(values),
    )


def _voxelize(values: dict[str, Any]) -> VoxelizeSettings:
    return VoxelizeSettings(
        sep=values["sep"],
        ties=values["ties"],
        resolution=values["resolution"],
        voxel_size=values["voxel_size"],
        snap_bits=values["snap_bits"],
        block=values["block"],
        lod=not values["no_lod"],
        keep_weights=values["keep_weights"],
        keep_geometry=values["keep_geometry"],
        faces=values["faces"],
        normals=values["normals"],
        normal_bits=values["normal_bits"],
        lz4=values["lz4"],
        cell=values["cell"],
    )


def run(request: Request, values: dict[str, Any]) -> None:
    """Run the job or print its plan, then its report: data on stdout, talk on stderr."""
    if values.get("explain"):
        if request.called is None:
            raise UsageError("--explain explains a scene", "give one with --scene FILE")
        click.echo("\n".join(explain(request.called)))
    if values.get("dry_run"):
        for line in () if values.get("explain") else request.describe():
            click.echo(line)
        return
    if values["report"]:
        folder = os.path.dirname(os.path.abspath(values["report"]))
        check_folder(folder, "the report's folder")
    with _logged(values["log"]) as log, watch(values["quiet"]) as shown:

        def tell(event: Event) -> None:
            log(event)
            shown(event)

        report = full_report(request.run(tell))
    if values["report"]:
        with publish(values["report"]) as file:
            file.write(json.dumps(report, indent=1, sort_keys=True).encode() + b"\n")
    if not values["quiet"]:
        if not report["stages"]:
            click.echo(f"{request.output}: was finished by an earlier run", err=True)
        table(report)


@contextmanager
def _logged(path: str | None) -> Iterator[Progress]:
    """The log, if there is to be one; whatever happens, it is said when it is not complete."""
    if path is None:
        yield silent
        return
    with Log(path) as log:
        try:
            yield log
        finally:
            if log.failure is not None:
                click.echo(f"{path}: the log is not complete: {log.failure}", err=True)
