"""How fast a job goes and how long it will take: arithmetic on its events, for the progress."""

import time
from collections import deque

from gstream.run.progress import Event, Kernels, Resumed, StageBegins, StageEnds, Start, UnitDone

# Seconds of each stage per hundred seconds, measured: 4 M triangles at 2048^3 with two workers, and
# the levels of what came out. Other jobs differ, but their own time scales it.
SHARES = {
    "spill": 1,
    "ingest": 16,
    "presort": 9,
    "voxelize": 67,
    "merge": 1,
    "simplify": 3,
    "pack": 3,
}
SHARES_OF_SIMPLIFY = {"unpack": 30, "simplify": 67, "pack": 3}
LEAST_PART = 0.05  # of a job, to tell from it how long the rest takes
STALL_SECONDS = 10.0


class Pace:
    """Rate and time left of the running stage, and of the job where its stages are known.

    The job's time left is that of the running stage by its own pace, and that of the stages ahead
    by the job's time so far and the usual shares: an estimate, better the more of the job is done.
    """

    def __init__(self) -> None:
        self.units = self.done = 0  # of the running stage, those of earlier runs included
        self._before = 0  # units of earlier runs
        self._cost = self._done_cost = 0.0
        self._compiling = False
        self._began = self._last = self._job_began = time.monotonic()
        self._ahead: deque[float] = deque()  # shares of the stages that have not begun
        self._share = self._passed = 0.0  # of the running stage, of those that have ended

    def __call__(self, event: Event) -> None:
        now = time.monotonic()
        match event:
            case Start():
                self._job_began = now
                stages = event.job["stages"]
                shares = SHARES_OF_SIMPLIFY if stages[0] in SHARES_OF_SIMPLIFY else SHARES
                self._ahead.extend(shares[stage] for stage in stages)
            case Resumed():
                self._before = event.units
            case StageBegins():
                self._began = self._last = now
                self.units, self.done = self._before + event.units, self._before
                self._cost, self._done_cost = event.cost, 0.0
                self._share = event.share * (self._ahead.popleft() if self._ahead else 0.0)
            case Kernels():
                self._compiling, self._last = not event.ready, now
            case UnitDone():
                if self.done == self._before and event.seconds:
                    self._skip_start(now - event.seconds)
                self._last = now
                self.done += event.units
                self._done_cost += event.cost
            case StageEnds():
                self._passed += self._share
                self._share, self._before = 0.0, 0

    def _skip_start(self, first: float) -> None:
        """Leave out what comes before the first unit: kernels are compiled, workers start."""
        self._job_began += max(first - self._began, 0.0)
        self._began = max(first, self._began)

    @property
    def part(self) -> float:
        """Of the running stage, 0 to 1, by estimated cost."""
        if self._cost:
            return self._done_cost / self._cost
        left = self.units - self._before
        return (self.done - self._before) / left if left else 1.0

    @property
    def job_part(self) -> float:
        """Of what this run has to do, 0 to 1."""
        done = self._passed + self._share * self.part
        whole = self._passed + self._share + sum(self._ahead)
        return done / whole if whole else 0.0

    @property
    def stage_left(self) -> float:
        """Seconds; 0 before the first unit is done."""
        return _left(time.monotonic() - self._began, self.part)

    @property
    def job_left(self) -> float | None:
        """Seconds; None while too little is done to tell."""
        if self.job_part < LEAST_PART:
            return None
        done = self._passed + self._share * self.part
        each = (time.monotonic() - self._job_began) / done  # seconds of one share
        running = self.stage_left if self._done_cost else self._share * each
        return running + sum(self._ahead) * each

    @property
    def rate(self) -> str:
        """Units per second or, of large ones, per minute."""
        each_second = (self.done - self._before) / max(time.monotonic() - self._began, 1e-9)
        return f"{each_second:.1f}/s" if each_second >= 0.1 else f"{60 * each_second:.1f}/min"

    @property
    def stalled(self) -> float | None:
        """Seconds since the last unit, where units are left and it was long ago."""
        since = time.monotonic() - self._last
        return since if since >= STALL_SECONDS and self.done < self.units else None

    def __str__(self) -> str:
        counts = f"{self.done}/{self.units} units"
        if self.stalled is not None:
            if self._compiling:
                return f"{counts}, compiling for {clock(self.stalled)}, once after an installation"
            if self.done == self._before:
                return f"{counts}, none finished in {clock(self.stalled)}"
            return f"{counts}, the last one was finished {clock(self.stalled)} ago"
        return f"{counts}, {self.rate}, {clock(self.stage_left)} left"


def _left(spent: float, part: float) -> float:
    return spent * (1 - part) / part if part else 0.0


def clock(seconds: float) -> str:
    """1:02:03 or 2:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
