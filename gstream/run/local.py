"""Processes of this machine: workers, signals and locks.

Nothing else but `worker.py` knows any of these. Decisions are made in `schedule.py`.
"""

import contextlib
import fcntl
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import wait
from time import perf_counter, sleep
from types import FrameType, TracebackType
from typing import Self

from gstream.errors import StoppedError, UsageError
from gstream.job import Job, Unit
from gstream.run.schedule import ATTEMPTS, Died, Done, Event, Ready, Schedule
from gstream.run.worker import HANDLED, OURS, RESUME, Worker, WorkingStage, attempt

LOCK_FILE = "lock"
LOCK_SECONDS = 1.0  # a worker that was starting when its run was killed may have it for a moment
STOP_SECONDS = 1.5  # a kernel in this process cannot be interrupted: leave without it


Finished = Callable[[Unit, float], None]  # told of each unit that is done, and its seconds
LeftOut = Callable[[Unit, str], None]  # told of each unit that is not tried again, and its cause


# --- workers ------------------------------------------------------------------------------------


class Workers:
    """The workers of one job: started when first needed; copies anew for each stage."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._workers: list[Worker] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: object, trace: TracebackType | None
    ) -> None:
        for worker in self._workers:
            worker.kill()  # a unit is idempotent and names appear by rename: nothing to wait for
        self._workers.clear()

    def run(
        self,
        stage: WorkingStage,
        job: Job,
        units: Sequence[Unit],
        done: Finished,
        left_out: LeftOut,
        lone: bool,
    ) -> None:
        """Run every unit; `done` or `left_out` is called in this process after each.

        lone : the stage has no other unit: it is not worth the start of a worker. One that an
            earlier run has left over is, as it may be what that run died of
        errors : the first GstreamError of a unit; StoppedError, when all others are done, for those
            that keep killing their worker
        """
        wanted = min(self._count, len(units))
        if wanted == 0 or (lone and not self._workers):
            _run_here(stage, job, units, done)
            return
        for index, worker in enumerate(self._workers):
            if not worker.is_current:
                worker.kill()
                self._workers[index] = Worker()
        while len(self._workers) < wanted:
            self._workers.append(Worker())
        _Round(self._workers, stage, job, units, done, left_out).play()


def _run_here(stage: WorkingStage, job: Job, units: Sequence[Unit], done: Finished) -> None:
    for unit in units:
        error, seconds = attempt(stage, job, unit)
        if error is not None:
            raise error
        done(unit, seconds)


class _Round:
    """One stage's units over the workers: events from pipes in, the schedule's decisions out."""

    def __init__(
        self,
        workers: list[Worker],
        stage: WorkingStage,
        job: Job,
        units: Sequence[Unit],
        done: Finished,
        left_out: LeftOut,
    ) -> None:
        self._workers, self._units = workers, units
        self._done, self._left_out = done, left_out
        self._stage, self._job = stage.__name__, job
        self._schedule = Schedule(units, len(workers))
        self._ends: dict[int, int] = {}  # how the last worker of a unit ended, of those that died

    def play(self) -> None:
        for index in range(len(self._workers)):
            self._tell(Ready(index))
        while not self._schedule.finished:
            ready = wait([worker.pipe for worker in self._workers if not worker.pipe.closed])
            for index in [i for i, worker in enumerate(self._workers) if worker.pipe in ready]:
                self._hear(index)
        if self._schedule.quarantined:
            raise self._incomplete()

    def _hear(self, index: int) -> None:
        """Take in what worker `index` has sent: an outcome, or the end of its pipe."""
        try:
            error, seconds = self._workers[index].pipe.recv()
        except (EOFError, OSError):
            self._replace(index)
            return
        if error is not None:
            raise error
        unit = self._schedule.running(index)
        self._tell(Done(index))
        if unit is not None:
            self._done(self._units[unit], seconds)

    def _replace(self, index: int) -> None:
        """Bury worker `index`; one that died idle is replaced when a stage needs it again."""
        unit = self._schedule.running(index)
        status = self._workers[index].kill()
        self._tell(Died(index))
        if unit is not None:
            self._ends[unit] = status
            if unit in self._schedule.quarantined:
                self._left_out(self._units[unit], _cause(status))
            self._workers[index] = Worker()
            self._tell(Ready(index))

    def _tell(self, event: Event) -> None:
        for run in self._schedule.handle(event):
            # A worker that has died by now is noticed by `wait`, not here.
            with contextlib.suppress(BrokenPipeError):
                message = (self._stage, self._job, self._units[run.unit])
                self._workers[run.worker].pipe.send(message)

    def _incomplete(self) -> StoppedError:
        """What to say of the units that are quarantined."""
        poison = [(self._units[unit], self._ends[unit]) for unit in self._schedule.quarantined]
        names = ", ".join(f"{unit.name} (by {_cause(status)})" for unit, status in poison)
        said = (
            f"stage {poison[0][0].stage}: each of these units has killed {ATTEMPTS} workers and is "
            f"left out: {names}"
        )
        killed = any(status == -signal.SIGKILL for _, status in poison)
        hint = "out of memory? give fewer --workers, " if killed else ""
        return StoppedError(said, f"{hint}{RESUME}")


def _cause(status: int) -> str:
    return f"signal {-status}" if status < 0 else f"exit status {status}"


# --- locks --------------------------------------------------------------------------------------


@contextlib.contextmanager
def locked_folder(path: str, patience: float = LOCK_SECONDS) -> Iterator[None]:
    """Make the folder `path` if need be and hold its lock, which a killed process lets go.

    patience : seconds to try
    errors : UsageError when another process holds it
    """
    name, end = os.path.join(path, LOCK_FILE), perf_counter() + patience
    while True:
        os.makedirs(path, exist_ok=True)
        with contextlib.suppress(FileNotFoundError), open(name, "ab") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if perf_counter() < end:
                    sleep(0.02)
                    continue
                said = f"{path}: this job is running already in another process"
                raise UsageError(said, "wait for it, or stop it") from None
            if os.path.samestat(os.fstat(file.fileno()), os.stat(name)):  # else just removed
                yield
                return


# --- signals ------------------------------------------------------------------------------------


@contextlib.contextmanager
def stop_on_signals(half_written: Sequence[str]) -> Iterator[None]:
    """Turn Ctrl-C, SIGTERM and SIGHUP into a StoppedError; leave within two seconds in any case.

    half_written : files to remove if this process has to leave without unwinding
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may set handlers; its owner decides about signals
        return
    before = {number: signal.signal(number, _stop) for number in HANDLED}
    woken, wake = socket.socketpair()
    wake.setblocking(False)
    wakeup_before = signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
    over = threading.Event()
    watch = threading.Thread(
        target=_leave_anyway, args=(woken, over, half_written), name=f"{OURS}signals", daemon=True
    )
    watch.start()
    try:
        yield
    finally:
        over.set()
        signal.set_wakeup_fd(wakeup_before)
        for number, handler in before.items():
            signal.signal(number, handler)
        wake.close()
        watch.join()
        woken.close()


def _stop(number: int, frame: FrameType | None) -> None:
    for other in HANDLED:
        signal.signal(other, signal.SIG_IGN)  # a second one would interrupt the unwinding
    raise StoppedError(f"stopped by {signal.Signals(number).name}", RESUME)


def _leave_anyway(woken: socket.socket, over: threading.Event, half_written: Sequence[str]) -> None:
    """Wait for a signal; if Python has not unwound soon after, a kernel holds it: leave."""
    if not woken.recv(1) or over.wait(STOP_SECONDS):
        return
    for path in half_written:
        with contextlib.suppress(OSError):
            os.unlink(path)
    show_cursor = "\x1b[?25h" if os.isatty(2) else ""
    os.write(2, f"{show_cursor}gstream: stopped by a signal; {RESUME}\n".encode())
    os._exit(StoppedError.exit_code)
