"""`gstream report accuracy`: what accuracy costs, measured here."""

import json
from pathlib import Path

import click

from gstream.errors import UsageError
from gstream.run.publish import publish

from . import options
from .progress import watch


@click.group()
def report() -> None:
    """Measure gstream on this machine.

    \b
    gstream report accuracy -o accuracy --scenes small
    """


@report.command()
@click.argument("file", required=False)
@click.option(
    "-o", "--output", required=True, metavar="FOLDER", help="The folder of the report; may exist."
)
@click.option(
    "--scenes",
    default="small",
    show_default=True,
    metavar="small|all",
    help="The sphere alone at 96 voxels, or every built-in scene at 256.",
)
@click.option("--knob", "knobs", multiple=True, metavar="NAME", help="Only this one; repeatable.")
@click.option(
    "--runs", default=3, show_default=True, help="Fresh processes of each point, one after another."
)
@options.as_json
@options.quiet
def accuracy(
    file: str | None,
    output: str,
    scenes: str,
    knobs: tuple[str, ...],
    runs: int,
    as_json: bool,
    quiet: bool,
) -> None:
    """Measure what accuracy costs in time.

    Turns every knob on scenes whose surface is known exactly, or on FILE, a mesh or a geometry
    stream, which is then its own true surface; one process after another. Writes report.json,
    report.md and report.html; prints the price of each knob. The plots of the page need matplotlib:
    pip install 'gstream[report]'. Knobs of the viewer need OpenGL and 'gstream[gl]'; on the small
    scenes only those are turned that --knob names: pixel-error, samples, sraa, occlusion, refine,
    upload-per-frame.

    \b
    gstream report accuracy -o accuracy
    gstream report accuracy bunny.ply -o accuracy --knob resolution
    gstream report accuracy -o accuracy --scenes all --knob sep --knob normal-bits --runs 5
    """
    from gstream.report.accuracy import measure, plan_of
    from gstream.report.page import html
    from gstream.report.results import as_dict
    from gstream.report.words import markdown, price

    plan = plan_of(scenes, file, knobs, runs)
    folder = _made(Path(output))
    with watch(quiet) as progress:
        found = measure(plan, progress)
    prices = [price(series) for series in found.series]
    written = json.dumps(as_dict(found, prices), indent=1, allow_nan=False)
    texts = {"json": written, "md": markdown(found), "html": html(found)}
    for form, text in texts.items():
        with publish(folder / f"report.{form}") as out:
            out.write(text.encode())
    if as_json:
        click.echo(written)
    elif not quiet:
        for series, said in zip(found.series, prices, strict=True):
            click.echo(f"{series.knob.title}, {series.scene}: {said}")
        for note in found.notes:
            click.echo(note)


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        said = f"{folder}: cannot be made: {error.strerror}"
        raise UsageError(said, "name another folder") from error
    return folder
