"""One worker: a process that does units, and how it starts.

It talks over one pipe and dies with its parent. It is a copy of that process, with the kernels that
this has loaded; where a copy would not be safe, a fresh interpreter.
"""

import contextlib
import errno
import gc
import importlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from time import perf_counter
from typing import Protocol

from gstream.errors import GstreamError, StoppedError
from gstream.job import Job, Unit

RESUME = "run the same command again to resume"
DISK_ERRORS = {errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EACCES, errno.EROFS}
HANDLED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # by the parent: see local.py
OURS = "gstream "  # how the names of this package's threads begin


class WorkingStage(Protocol):
    """What an executor needs of a stage."""

    __name__: str

    def work(self, job: Job, unit: Unit) -> None: ...


class UnitError(Exception):
    """A unit failed in a way that nobody foresaw: an error of ours."""

    def __init__(self, where: str, said: str, trace: str) -> None:
        super().__init__(where, said, trace)
        self.where, self.said, self.trace = where, said, trace

    def __str__(self) -> str:
        return f"{self.where}: {self.said}"


# --- errors of the system, made ours ------------------------------------------------------------


@contextlib.contextmanager
def disk_errors(job: Job, where: str) -> Iterator[None]:
    """Turn a full or failing disk and exhausted memory into a StoppedError that names `where`."""
    try:
        yield
    except OSError as error:
        if error.errno not in DISK_ERRORS:
            raise
        place = error.filename or _fullest(job)
        denied = error.errno in (errno.EACCES, errno.EROFS)
        remedy = "allow writing there" if denied else "free some space"
        said = f"{place}: {os.strerror(error.errno or 0)} in {where}"
        raise StoppedError(said, f"{remedy}, then {RESUME}") from error
    except MemoryError as error:
        said = f"out of memory in {where}"
        raise StoppedError(said, f"give fewer --workers, then {RESUME}") from error


def _fullest(job: Job) -> str:
    """The one of the job's two folders with less space left: a write error names no file."""
    folders = (job.folder, os.path.dirname(os.path.abspath(job.output)))
    return min(folders, key=lambda folder: shutil.disk_usage(folder).free)


# --- its side of the pipe ------------------------------------------------------------------------


def serve(descriptor: int) -> None:
    """A worker: receive (stage, job, unit), answer (error or None, seconds) until the pipe ends."""
    _die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all of us; the parent decides
    with Connection(descriptor) as pipe, contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            name, job, unit = pipe.recv()
            pipe.send(attempt(importlib.import_module(name), job, unit))


def attempt(stage: WorkingStage, job: Job, unit: Unit) -> tuple[Exception | None, float]:
    """Do a unit: its error, if there was one, and its seconds."""
    began = perf_counter()
    error = _error_of(stage, job, unit)
    return error, perf_counter() - began


def _error_of(stage: WorkingStage, job: Job, unit: Unit) -> Exception | None:
    where = f"stage {unit.stage}, unit {unit.name}"
    try:
        with disk_errors(job, where):
            stage.work(job, unit)
    except GstreamError as error:
        return error
    except Exception as error:
        return UnitError(where, f"{type(error).__name__}: {error}", traceback.format_exc())
    return None


def _die_with_parent() -> None:
    """Ask Linux for SIGKILL when the parent ends: an orphan would disturb the job's next run."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(1, int(signal.SIGKILL))  # 1 = PR_SET_PDEATHSIG


# --- how it starts -------------------------------------------------------------------------------


class Process(Protocol):
    """What is needed of a `subprocess.Popen`."""

    def poll(self) -> int | None: ...
    def wait(self) -> int: ...
    def kill(self) -> None: ...


class Fork:
    """A copy of this process that does `work(pipe)` and ends."""

    def __init__(self, work: Callable[[int], None], pipe: int) -> None:
        self._status: int | None = None
        # Until the copy has its own handlers it has this process', which would unwind the job.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, HANDLED)
        with warnings.catch_warnings():
            # Python 3.12 warns of every fork beside a thread: see `may_fork`.
            warnings.simplefilter("ignore", DeprecationWarning)
            self.pid = os.fork()
        if self.pid:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            return
        try:
            signal.set_wakeup_fd(-1)
            for number in HANDLED:
                signal.signal(number, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            # A thread that the copy does not have may have held the locks of the old ones.
            self._kept = sys.stdout, sys.stderr  # else they might end, and close 1 and 2
            sys.stdout, sys.stderr = (os.fdopen(fd, "w", 1, closefd=False) for fd in (1, 2))
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.closerange(3, pipe)  # the lock of the job's folder, the pipes of other workers
            os.closerange(pipe + 1, os.sysconf("SC_OPEN_MAX"))
            # What is inherited is never collected: a file among it would close a descriptor that is
            # another file's by then. Its memory stays shared, too.
            gc.freeze()
            work(pipe)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)

    def poll(self) -> int | None:
        """How it ended; None while it runs."""
        if self._status is None and (ended := os.waitpid(self.pid, os.WNOHANG))[0]:
            self._status = os.waitstatus_to_exitcode(ended[1])
        return self._status

    def wait(self) -> int:
        """How it ended, when it has."""
        if self._status is None:
            self._status = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return self._status

    def kill(self) -> None:
        if self._status is None:
            os.kill(self.pid, signal.SIGKILL)


def may_fork() -> bool:
    """Would a copy of this process find every lock open that it needs?

    It has no other thread, but their locks as they were. Ours hold none that a worker needs: those
    of the streams that they print to are not used. What others hold, nobody knows. Apple's
    libraries do not survive a fork.
    """
    others = [thread for thread in threading.enumerate() if thread is not threading.main_thread()]
    here = threading.current_thread() is threading.main_thread()
    return sys.platform == "linux" and here and all(t.name.startswith(OURS) for t in others)


def fresh(pipe: int) -> Process:
    """A worker that starts as an interpreter of its own: 1.3 s, and the kernels that it needs."""
    code = f"import sys; sys.path[:] = {sys.path!r}; from gstream.run.worker import serve; "
    # Not multiprocessing.Process: its spawn imports the caller's __main__ again, so that a
    # script calling gstream.build() without a main guard would start itself in a loop.
    return subprocess.Popen(
        [sys.executable, "-P", "-c", f"{code}serve({pipe})"],
        pass_fds=[pipe],
        stdin=subprocess.DEVNULL,
    )


def start(pipe: int) -> Process:
    """A process that serves the other end of `pipe`."""
    return Fork(serve, pipe) if may_fork() else fresh(pipe)


class Worker:
    """One worker process and the parent's end of its pipe."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self.process = start(theirs.fileno())
        self.pipe = Connection(ours.detach())

    @property
    def is_current(self) -> bool:
        """Does it live, and lack no kernel that this process has loaded since?"""
        return not isinstance(self.process, Fork) and self.process.poll() is None

    def kill(self) -> int:
        """End it, if it has not ended; how it did."""
        self.process.kill()
        self.pipe.close()
        return self.process.wait()
