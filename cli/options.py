"""Every option, named once; commands stack them."""

import re
from collections.abc import Callable
from functools import partial
from typing import Any

import click

from gstream.errors import UsageError
from gstream.run.commands import RunOptions

Command = Callable[..., Any]

UNITS = {"": 1, "b": 1, "kib": 1 << 10, "mib": 1 << 20, "gib": 1 << 30, "tib": 1 << 40}
UNITS |= {"k": 1 << 10, "m": 1 << 20, "g": 1 << 30, "t": 1 << 40}
UNITS |= {"kb": 10**3, "mb": 10**6, "gb": 10**9, "tb": 10**12}


class Size(click.ParamType[int]):
    """A number of bytes: 512MiB, 2GiB, 1.5G (binary), 2GB (decimal)."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        if isinstance(value, int):
            return value
        match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([a-zA-Z]*)", value.strip())
        if match is None or match[2].lower() not in UNITS:
            self.fail(f"{value!r} is not a size; write it like 512MiB or 2GiB", param, ctx)
        return int(float(match[1]) * UNITS[match[2].lower()])


class Box(click.ParamType[tuple[float, ...]]):
    """Six numbers: the low corner, then the high one."""

    name = "box"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        try:
            numbers = tuple(float(part) for part in re.split(r"[,\s]+", value.strip()))
        except ValueError:
            numbers = ()
        if len(numbers) != 6 or any(numbers[i] >= numbers[i + 3] for i in range(3)):
            said = "is not a box; write it like 0,0,0,1,1,1: low x,y,z, then high x,y,z"
            self.fail(f"{value!r} {said}", param, ctx)
        return numbers


class Picture(click.ParamType[tuple[int, int]]):
    """WIDTHxHEIGHT in pixels."""

    name = "size"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        match = re.fullmatch(r"(\d{1,5})[xX](\d{1,5})", value)
        if match is None or not (0 < int(match[1]) <= 16384 and 0 < int(match[2]) <= 16384):
            self.fail(f"{value!r} is not a picture size; write it like 1280x720", param, ctx)
        return int(match[1]), int(match[2])


def stack(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """One decorator of several, applied so that --help shows them in this order."""

    def decorate(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


inputs = click.argument("inputs", nargs=-1, required=True, metavar="INPUT...")
output = click.option("-o", "--output", required=True, metavar="FILE", help="The file to write.")
as_json = click.option("--json", "as_json", is_flag=True, help="Print JSON for a program to read.")
quiet = click.option("-q", "--quiet", is_flag=True, help="No progress and no table.")
lz4 = click.option(
    "--lz4",
    type=click.Choice(["fast", "hc"]),
    default="fast",
    show_default=True,
    help="Compress fast, or slower and smaller (hc). Both read equally fast.",
)

workers = click.option(
    "--workers",
    type=click.IntRange(min=0, max=4096),
    default=None,
    help="Worker processes; 0 works in this process.  [default: one per processor]",
)
memory = partial(
    click.option,
    "--memory",
    type=Size(),
    help="Cap on the memory of all processes together; workers are reduced to fit.",
)
PARANOID = (
    "Resume only after reading all of every input and of what an earlier run has done, not samples "
    "and lengths."
)
force = partial(click.option, "--force", is_flag=True, help="Replace the output if it exists.")
watching = stack(
    click.option("--report", metavar="FILE", help="Write the report as JSON."),
    click.option(
        "--log",
        metavar="FILE",
        help="Append what happens to FILE, a line of JSON for each event: start, resumed, "
        "stage_begin, kernels, unit_done, unit_left_out, stage_end, memory, note, and stopped, "
        "error or end.",
    ),
    quiet,
)

running = stack(
    workers,
    memory(default="2GiB", show_default=True),
    click.option(
        "--tmp",
        metavar="DIR",
        help="Folder for scratch files.  [default: $TMPDIR, else the output's folder]",
    ),
    click.option("--dry-run", is_flag=True, help="Print the plan and estimates; write nothing."),
    force(),
    click.option(
        "--restart",
        is_flag=True,
        help="Drop what an earlier, stopped run for this output has done.",
    ),
    click.option("--paranoid", is_flag=True, help=PARANOID),
    watching,
)

resuming = stack(
    workers,
    memory(default=None),
    force(default=None),
    click.option("--paranoid", is_flag=True, default=None, help=PARANOID),
    watching,
)

ingesting = stack(
    click.option(
        "--order",
        type=click.Choice(["file", "spatial", "smallest"]),
        help="Keep the inputs' order from chunk to chunk, sort spatially within a bounded window, "
        "or take whichever of the two is smaller.  [default: file]",
    ),
    click.option(
        "--compact",
        is_flag=True,
        help="Make the geometry stream small: the smallest order, packed with hc. Scans take 4.6 "
        "bytes per triangle and not 8.3, and ingest takes about ten times the processor time.",
    ),
    click.option(
        "--chunk",
        type=click.IntRange(1, 65_536),
        default=65_536,
        show_default=True,
        help="Triangles of a chunk, at most.",
    ),
    click.option(
        "--bounds",
        type=Box(),
        metavar="X,Y,Z,X,Y,Z",
        help="Declare the scene's box: low corner, high corner.",
    ),
    click.option("--units", metavar="UNIT", help="Unit of length, kept as metadata (m, mm, …)."),
    click.option("--up", metavar="AXIS", help="Up axis, kept as metadata (x, y or z)."),
    click.option("--crs", metavar="CODE", help="Coordinate system, kept as metadata (EPSG:…)."),
)

scene = stack(
    click.option(
        "--scene",
        metavar="FILE",
        help="Store only the columns and levels that this scene (spec/scene.md) calls for.",
    ),
    click.option(
        "--explain",
        is_flag=True,
        help="Print what the scene calls for, and why; with --dry-run nothing else.",
    ),
)

voxelizing = stack(
    click.option("--resolution", type=int, help="Voxels along the longest axis, 1 to 65536."),
    click.option("--voxel-size", type=float, help="Edge of a voxel in the scene's units instead."),
    click.option(
        "--snap-bits",
        type=int,
        metavar="K",
        help="Snap vertices to voxel / 2^K.  [default: 12, or what is left of 26 bits]",
    ),
    click.option(
        "--sep",
        type=click.Choice(["6", "26", "conservative"]),
        default="6",
        show_default=True,
        help="Which voxels a triangle sets: 6-separating, 26-separating, or all it touches.",
    ),
    click.option(
        "--ties",
        type=click.Choice(["one-sided", "closed"]),
        default="one-sided",
        show_default=True,
        help="A face between two voxels sets one of them, or both.",
    ),
    click.option("--block", type=int, default=64, show_default=True, help="Voxels per block edge."),
    click.option(
        "--cell",
        type=int,
        default=256,
        show_default=True,
        help="Voxels per edge of a cell of work.",
    ),
    click.option("--no-lod", is_flag=True, help="Write level 0 alone, with its weights."),
    click.option("--keep-weights", is_flag=True, help="Write each voxel's surface area."),
    click.option(
        "--keep-geometry",
        is_flag=True,
        help="Write the source triangles too, cut at the borders of the finest blocks.",
    ),
    click.option(
        "--faces",
        type=click.Choice(["front", "both"]),
        default="front",
        show_default=True,
        help="Face masks of one-sided or of two-sided surfaces.",
    ),
    click.option(
        "--normals",
        type=click.Choice(["geometric", "input"]),
        default="geometric",
        show_default=True,
        help="Normals of the triangles, or those that the input brings.",
    ),
    click.option(
        "--normal-bits",
        type=click.IntRange(8, 12),
        default=11,
        show_default=True,
        help="Bits of each of a normal's two codes.",
    ),
)


def run_options(values: dict[str, Any]) -> RunOptions:
    """Take the options of `running` out of a command's values."""
    return RunOptions(
        workers=values["workers"],
        memory=values["memory"],
        tmp=values["tmp"],
        force=values["force"],
        paranoid=values["paranoid"],
        restart=values["restart"],
    )


def ingest_order(values: dict[str, Any]) -> dict[str, str]:
    """`order` and `lz4` of the stream; --compact is a name for the smallest that there is."""
    if not values["compact"]:
        return {"order": values["order"] or "file", "lz4": values["lz4"]}
    if values["order"] not in (None, "smallest"):
        said = f"--compact chooses the order and so does --order {values['order']}"
        raise UsageError(said, "give one of them")
    return {"order": "smallest", "lz4": "hc"}


def metadata(values: dict[str, Any]) -> dict[str, str | None]:
    """Only what was given: absent and empty are different things (formats, metadata)."""
    up = values["up"]
    if up is not None and up.lower() not in ("x", "y", "z"):
        raise UsageError(f"--up {up} is no axis", "give x, y or z")
    given = {"units": values["units"], "up": up.lower() if up else up, "crs": values["crs"]}
    return {name: value for name, value in given.items() if value is not None}
