"""Commands on the folder of a job that was stopped: status, resume, clean."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from gstream.run import commands, jobs
from gstream.run.jobs import JobStatus

from . import options
from .convert import run
from .pace import clock

FOLDER = click.Path(path_type=Path)
job = click.argument("job", metavar="JOB", type=FOLDER)


@click.command()
@job
@options.as_json
def status(job: Path, as_json: bool) -> None:
    """Show how far a job is.

    JOB is the job's folder, which a run names while it works and when it is stopped.

    \b
    gstream status gstream-0123456789abcdef
    """
    found = jobs.status(job)
    if as_json:
        click.echo(json.dumps(found.as_dict(), indent=1, sort_keys=True))
        return
    for name, value in _rows(found):
        click.echo(f"{name:<11}{value}")


@click.command()
@job
@options.resuming
def resume(job: Path, **values: Any) -> None:
    """Go on with a job that was stopped, as it was asked for.

    The same as running its command again. Refused with exit code 2 where an input has changed.

    \b
    gstream resume gstream-0123456789abcdef
    gstream resume gstream-0123456789abcdef --workers 1 --memory 8GiB
    """
    names = ("workers", "memory", "force", "paranoid")
    changes = {name: values[name] for name in names if values[name] is not None}
    run(commands.resume(job, changes), values)


@click.command()
@click.argument(
    "folders", metavar="JOB...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
def clean(folders: tuple[Path, ...]) -> None:
    """Remove the folders of jobs that are not wanted any more.

    Refuses a job that is running, and folders that are no job's.

    \b
    gstream clean gstream-0123456789abcdef
    """
    for folder in folders:
        click.echo(f"{folder}: {jobs.clean(folder):,} bytes freed")


def _rows(found: JobStatus) -> Iterator[tuple[str, str]]:
    yield "state", "running" if found.running else "stopped"
    yield "output", found.job["output"]
    for path, fingerprint in found.job["inputs"]:
        yield "input", f"{path}  {fingerprint}"
    for group, settings in found.job["settings"].items():
        said = (f"{name} {value}" for name, value in settings.items() if value not in (None, {}))
        if settings:
            yield group, ", ".join(said)
    memory = found.options["memory"] // (1 << 20)
    yield "run with", f"{found.options['workers']} workers, {memory} MiB of memory"
    for stage in found.stages:
        counts = "".join(f", {value:,} {name}" for name, value in stage.counts.items())
        yield stage.stage, f"{stage.done}/{stage.units} units{counts}"
    for name in found.job["stages"][len(found.stages) :]:
        yield name, "not begun"
    yield "scratch", f"{found.scratch_bytes:,} bytes"
    if found.last_unit_seconds is not None:
        yield "last unit", f"finished {clock(found.last_unit_seconds)} ago"
    if not found.running:
        yield "go on", f"gstream resume {found.folder}"
        yield "drop it", f"gstream clean {found.folder}"
