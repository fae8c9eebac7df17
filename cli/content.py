"""Commands about the content of block files: export, diff."""

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from gstream.run.paths import check_reading

from . import options
from .progress import Blocks, watch

if TYPE_CHECKING:
    from gstream.diff import Difference, LevelDifference


@click.command()
@click.argument("path", metavar="FILE.gsb")
@click.option(
    "-o", "--output", required=True, metavar="OUT", help="The .ply, .npz or .zarr to write."
)
@click.option(
    "--level", type=click.IntRange(min=0), default=0, show_default=True, help="0 is the finest."
)
@click.option(
    "--bounds",
    type=options.Box(),
    metavar="X,Y,Z,X,Y,Z",
    help="Only voxels that touch this box of the world: low corner, high corner.",
)
@click.option("--cubes", is_flag=True, help="Of a PLY: cubes of six quads instead of points.")
@click.option("--geometry", is_flag=True, help="Of a PLY: the source triangles, where kept.")
@click.option("--force", is_flag=True, help="Replace the output if it exists.")
@options.as_json
@options.quiet
def export(
    path: str,
    output: str,
    level: int,
    bounds: tuple[float, ...] | None,
    cubes: bool,
    geometry: bool,
    force: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Write a level's voxels for other programs.

    \b
    .ply   centres as points with normals, colours, masks, weights; or cubes; or source triangles
    .npz   arrays positions (voxel indices), normal, colour, mask, weight, and matrix (to the world)
    .zarr  dense occupancy [z, y, x], 1 where there is a voxel

    \b
    gstream export scan.gsb -o scan.ply
    gstream export scan.gsb -o corner.ply --cubes --bounds 0,0,0,1,1,1
    gstream export scan.gsb -o scan.npz --level 2
    gstream export https://example.org/scan.gsb -o scan.zarr --level 3
    """
    from gstream.export import export as write
    from gstream.export import kind_of

    kind = kind_of(output, cubes, geometry)
    check_reading(path, output, force, folder=kind == ".zarr")
    with watch(quiet or as_json) as watcher:
        shown = Blocks(watcher, "export")
        made = write(path, output, level, bounds, cubes, shown, geometry=geometry)
    if as_json:
        click.echo(json.dumps(asdict(made), indent=1))
    elif not quiet:
        columns = f" with {', '.join(made.columns)}" if made.columns else ""
        without = f", without {', '.join(made.left_out)}" if made.left_out else ""
        click.echo(
            f"{output}: level {level}, {made.voxels:,} voxels of {made.blocks:,} blocks"
            f"{columns}{without}, {made.bytes:,} bytes"
        )


@click.command()
@click.argument("a", metavar="A.gsb")
@click.argument("b", metavar="B.gsb")
@options.as_json
@options.quiet
def diff(a: str, b: str, as_json: bool, quiet: bool) -> int:
    """Compare what two block files hold.

    Compares grid, levels, voxels and attributes, not bytes: size of blocks, compression and the
    settings of the build may differ. Exits with 0 where all is equal and with 7 where it is not.

    \b
    gstream diff old.gsb new.gsb
    gstream diff old.gsb https://example.org/new.gsb --json
    """
    from gstream.diff import DIFFERENT
    from gstream.diff import diff as compare

    with watch(quiet or as_json) as watcher:
        found = compare(a, b, Blocks(watcher, "diff"))
    if as_json:
        click.echo(json.dumps(found.as_dict(), indent=1))
    elif not quiet:
        for line in _lines(found):
            click.echo(line)
    return 0 if found.equal else DIFFERENT


def _lines(found: "Difference") -> Iterator[str]:
    """What differs, level by level, and one line of summary."""
    for side, names in zip("AB", found.columns, strict=True):
        if names:
            yield f"columns only in {side}: {', '.join(names)}"
    for level in found.levels:
        if not level.equal:
            yield from _level_lines(found, level)
    others = ", ".join(found.made_with)
    settings = f" (made with other settings: {others})" if others else ""
    if found.equal:
        voxels = sum(level.voxels[0] for level in found.levels)
        columns = ", ".join(found.compared) or "positions alone"
        held = f"equal: {voxels:,} voxels in {len(found.levels)} levels, {columns}"
    elif not found.same_grid:
        held = "DIFFERENT: the grids are, so the voxels were not compared"
    else:
        held = "DIFFERENT"
    yield f"{' and '.join(found.paths)}: {held}{settings}"


def _level_lines(found: "Difference", level: "LevelDifference") -> Iterator[str]:
    from gstream.diff import UNITS

    voxels = f"{level.voxels[0]:,} and {level.voxels[1]:,} voxels"
    yield f"level {level.level}: {voxels}, {level.only[0]:,} only in A, {level.only[1]:,} only in B"
    for name, column in level.columns.items():
        if column.differing:
            most = f", by at most {column.largest:.6g} {UNITS[name]}" if name in UNITS else ""
            yield f"  {name}: {column.differing:,} voxels differ{most}"
    box = found.box(level)
    if box is not None:
        low, high = (" ".join(f"{c:.6g}" for c in corner) for corner in (box[:3], box[3:]))
        yield f"  within {low} to {high}"
