"""Commands that look at a file: info, check, preview."""

import json
from collections.abc import Iterator
from typing import Any

import click

from gstream.errors import CorruptFileError
from gstream.run.paths import check_reading

from . import options
from .facts import facts
from .progress import Blocks, watch
from .shown import shown

file_argument = click.argument("path", metavar="FILE")


@click.command()
@file_argument
@click.option("--digests", is_flag=True, help="Decode everything; add a digest of each column.")
@options.as_json
def info(path: str, digests: bool, as_json: bool) -> None:
    """Say what a file holds.

    Reads head and directories alone, of a block file or a geometry stream, but for --digests.

    \b
    gstream info scan.gsb
    gstream info scan.gst --json
    gstream info scan.gsb --digests
    gstream info https://example.org/scan.gsb
    """
    held = facts(path, digests)
    if as_json:
        click.echo(json.dumps(held, indent=1, allow_nan=False))
        return
    for name, value in _lines(held):
        click.echo(shown(f"{name:<16} {value}".rstrip()))


@click.command()
@file_argument
@click.option("--quick", is_flag=True, help="Structure and indexes alone; decode no payload.")
@click.option(
    "--plain",
    is_flag=True,
    help="Share no compiled code with what wrote the file: slower, in NumPy from end to end.",
)
@options.as_json
@options.quiet
def check(path: str, quick: bool, plain: bool, as_json: bool, quiet: bool) -> int:
    """Check a file against the spec.

    Prints every broken rule of a block file or geometry stream, and then exits with 4.

    \b
    gstream check scan.gsb
    gstream check scan.gsb --quick --json
    gstream check scan.gsb --plain
    """
    from gstream.check import check_file
    from gstream.compiled import CHECKING
    from gstream.formats import arithmetic

    choose = arithmetic.plain if plain else CHECKING
    with watch(quiet or as_json) as watcher:
        report = check_file(path, quick, Blocks(watcher, "check"), choose)
    if as_json:
        click.echo(json.dumps(report.as_dict(), indent=1))
    else:
        for finding in report.findings:
            line = f"{finding.rule} {finding.severity} {finding.place}: {finding.said}"
            click.echo(shown(line))
        how = ", structure and indexes" if quick else ""
        verdict = "valid" if report.ok else "INVALID"
        click.echo(shown(f"{path}: {report.format}{how}: {verdict}"))
    if report.ok:
        return 0
    rules = ", ".join(sorted({f.rule for f in report.findings if f.severity == "error"}))
    said = f"gstream: {path}: {report.errors} errors against {rules}; rebuild or recopy the file"
    click.echo(said, err=True)
    return CorruptFileError.exit_code


@click.command()
@click.argument("path", metavar="FILE.gsb")
@click.option("-o", "--output", required=True, metavar="PICTURE.png", help="The picture to write.")
@click.option(
    "--size",
    type=options.Picture(),
    default="1280x720",
    show_default=True,
    metavar="WxH",
    help="Width and height in pixels.",
)
@click.option(
    "--view",
    default="three-quarter",
    show_default=True,
    help="three-quarter, front, right, back, left, top, bottom, or AZIMUTH,ELEVATION in degrees.",
)
@click.option("--level", type=click.IntRange(min=0), help="Level to draw.  [default: as it fits]")
@click.option(
    "--up", type=click.Choice(["y", "z"]), help="Axis that points up.  [default: the file's, or z]"
)
@click.option("--force", is_flag=True, help="Replace the picture if it exists.")
@options.quiet
def preview(
    path: str,
    output: str,
    size: tuple[int, int],
    view: str,
    level: int | None,
    up: str | None,
    force: bool,
    quiet: bool,
) -> None:
    """Draw a block file.

    Takes the level whose voxels match the pixels, and reads only the blocks it needs.

    \b
    gstream preview scan.gsb -o scan.png
    gstream preview scan.gsb -o top.png --view top --size 1920x1080
    gstream preview scan.gsb -o scan.png --up y --view 30,15
    """
    from gstream.preview import render

    check_reading(path, output, force)
    drawn = render(path, output, size, view, level, up=up)
    if not quiet:
        click.echo(
            f"{output}: {drawn.width}x{drawn.height}, level {drawn.level}, "
            f"{drawn.blocks_read} of {drawn.blocks} blocks, {drawn.voxels:,} voxels"
        )


def _lines(held: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Name and value of each line, nested values spelt out."""
    for name, value in held.items():
        label = name.replace("_", " ")
        if name == "levels":
            for level in value:
                counts = f"{level['voxels']:,} voxels in {level['blocks']:,} blocks"
                yield f"level {level['level']}", f"{counts} of {level['block_edge']}^3"
        elif name == "columns":
            yield label, ", ".join(f"{c['name']} {c['components']}x{c['bits']}" for c in value)
        elif name == "content":
            for level in value["levels"]:
                for column, digest in level["columns"].items():
                    yield f"digest {level['level']}", f"{column} {_text(digest)}"
        elif name == "sources":
            for source in value:
                yield "source", _pairs(source)
        elif isinstance(value, dict):
            yield label, _pairs(value)
        elif isinstance(value, list):
            yield label, " ".join(map(_text, value))
        else:
            yield label, _text(value)


def _pairs(value: dict[str, Any]) -> str:
    return ", ".join(f"{name} {_text(item)}" for name, item in value.items())


def _text(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value)
