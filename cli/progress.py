"""Progress as a person sees it: bars on a terminal, a plain line every two seconds elsewhere."""

import sys
import threading
import time
from typing import Self, TextIO

from gstream.run.progress import (
    Event,
    Memory,
    Note,
    StageBegins,
    StageEnds,
    Start,
    UnitDone,
    UnitLeftOut,
)
from gstream.run.worker import OURS

from .pace import STALL_SECONDS, Pace, clock

LINE_SECONDS = 2.0
BLOCKS_SECONDS = 0.1
REFRESH_SECONDS = 0.1


class Lines:
    """Plain lines, at most one each two seconds; a job that fails at once says only its error."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._notes: list[str] = []
        self._pace = Pace()
        self._stage = ""
        self._said_at = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._out.flush()

    def __call__(self, event: Event) -> None:
        self._pace(event)
        match event:
            case Note(said):
                self._notes.append(said)
            case StageBegins():
                self._stage = event.stage
            case UnitDone():
                left = self._pace.job_left
                job = f"; job: about {clock(left)} left" if left is not None else ""
                self._say(f"{self._stage}: {self._pace}{job}")
            case UnitLeftOut():
                self._say(_left_out(event), 0.0)
            case StageEnds():
                self._say(f"{event.stage}: done in {event.seconds:.1f} s")
            case Memory() if self._pace.stalled is not None:
                self._say(f"{self._stage}: {self._pace}", STALL_SECONDS)

    def _say(self, line: str, seconds: float = LINE_SECONDS) -> None:
        now = time.monotonic()
        if now - self._said_at < seconds:
            return
        self._said_at = now
        for note in self._notes:
            print(note, file=self._out)
        self._notes.clear()
        print(line, file=self._out, flush=True)


class Bars:
    """One rich bar per stage, and one for the job: units, rate and time left."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as RichProgress

        self._bars = RichProgress(
            TextColumn("{task.description:>10}"),
            BarColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[said]}"),
            console=Console(stderr=True),
            auto_refresh=False,  # its own thread has a name that worker.may_fork does not know
        )
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._refresh, name=f"{OURS}bars", daemon=True)
        self._pace = Pace()
        self._job = self._stage = self._bars.add_task("job", total=1.0, said="", visible=False)

    def __enter__(self) -> Self:
        self._bars.start()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._bars.stop()

    def _refresh(self) -> None:
        while not self._over.wait(REFRESH_SECONDS):
            self._bars.refresh()

    def __call__(self, event: Event) -> None:
        self._pace(event)
        match event:
            case Note(said):
                self._bars.console.print(said, highlight=False, markup=False)
            case Start():
                self._bars.update(self._job, visible=True)
            case StageBegins():
                self._stage = self._bars.add_task(event.stage, total=1.0, said="")
            case UnitDone():
                left = self._pace.job_left
                said = f"about {clock(left)} left" if left is not None else ""
                self._bars.update(self._job, completed=self._pace.job_part, said=said)
                self._bars.update(self._stage, completed=self._pace.part, said=str(self._pace))
            case UnitLeftOut():
                self._bars.console.print(_left_out(event), highlight=False, markup=False)
            case StageEnds():
                said = f"{self._pace.done}/{self._pace.units} units"
                self._bars.update(self._stage, completed=1.0, said=said)
                self._bars.update(self._job, completed=self._pace.job_part)
            case Memory() if self._pace.stalled is not None:
                self._bars.update(self._stage, said=str(self._pace))


def _left_out(event: UnitLeftOut) -> str:
    return f"{event.stage}: unit {event.unit} keeps killing its worker ({event.cause}), left out"


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
