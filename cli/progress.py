"""Progress as a person sees it: a bar on a terminal, a plain line every two seconds elsewhere."""

import sys
import time
from typing import Self, TextIO

from gstream.run.progress import Event, Note, StageBegins, StageEnds, UnitDone

LINE_SECONDS = 2.0
BLOCKS_SECONDS = 0.1


class Lines:
    """Plain lines, at most one each two seconds; a job that fails at once says only its error."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._notes: list[str] = []
        self._said_at = self._began = time.monotonic()
        self._units = self._done = 0
        self._cost = self._done_cost = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._out.flush()

    def __call__(self, event: Event) -> None:
        match event:
            case Note(said):
                self._notes.append(said)
            case StageBegins():
                self._began = time.monotonic()
                self._units, self._cost = event.units, event.cost
                self._done, self._done_cost = 0, 0.0
            case UnitDone():
                self._unit_done(event.stage, event.cost, event.units)
            case StageEnds():
                self._say(f"{event.stage}: done in {event.seconds:.1f} s")

    def _unit_done(self, stage: str, cost: float, units: int) -> None:
        self._done += units
        self._done_cost += cost
        spent = time.monotonic() - self._began
        rate = self._done / max(spent, 1e-9)
        part = self._done_cost / self._cost if self._cost else self._done / self._units
        left = spent * (1 - part) / part if part else 0
        counts = f"{self._done}/{self._units} units"
        self._say(f"{stage}: {counts}, {rate:.1f}/s, {clock(left)} left")

    def _say(self, line: str) -> None:
        now = time.monotonic()
        if now - self._said_at < LINE_SECONDS:
            return
        self._said_at = now
        for note in self._notes:
            print(note, file=self._out)
        self._notes.clear()
        print(line, file=self._out, flush=True)


class Bars:
    """One rich bar per stage: units, rate and time left, weighed by estimated cost."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as RichProgress

        self._bars = RichProgress(
            TextColumn("{task.description:>10}"),
            BarColumn(),
            TextColumn("{task.fields[done]}/{task.fields[units]} units"),
            TextColumn("{task.fields[rate]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=Console(stderr=True),
        )
        self._done = 0
        self._began = 0.0

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def __call__(self, event: Event) -> None:
        match event:
            case Note(said):
                self._bars.console.print(said, highlight=False, markup=False)
            case StageBegins():
                self._done, self._began = 0, time.monotonic()
                self._task = self._bars.add_task(
                    event.stage, total=max(event.cost, 1e-9), units=event.units, done=0, rate=""
                )
            case UnitDone():
                self._done += event.units
                rate = f"{self._done / max(time.monotonic() - self._began, 1e-9):.1f}/s"
                self._bars.update(self._task, advance=event.cost, done=self._done, rate=rate)
            case StageEnds():
                total = self._bars.tasks[self._task].total
                self._bars.update(self._task, completed=total, done=self._done)


class Quiet:
    """Progress for --quiet."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def __call__(self, event: Event) -> None:
        pass


Watcher = Lines | Bars | Quiet


class Blocks:
    """Called with (done, all) for each of millions of blocks; shows ten steps a second."""

    def __init__(self, watcher: Watcher, stage: str) -> None:
        self._watcher, self._stage = watcher, stage
        self._told_at = 0.0
        self._done: int | None = None

    def __call__(self, done: int, total: int) -> None:
        if self._done is None:
            self._watcher(StageBegins(self._stage, total, float(total)))
            self._done = 0
        now = time.monotonic()
        if now - self._told_at > BLOCKS_SECONDS or done == total:
            units = done - self._done
            self._watcher(UnitDone(self._stage, float(units), units=units))
            self._told_at, self._done = now, done


def watch(quiet: bool) -> Watcher:
    """The progress that fits stderr, as a context manager."""
    if quiet:
        return Quiet()
    return Bars() if sys.stderr.isatty() else Lines(sys.stderr)


def clock(seconds: float) -> str:
    """1:02:03 or 2:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
