"""run/worker: how a worker starts, and what it has of the process that starts it."""

import os
import signal
import socket
import sys
import threading
import time

import pytest

from gstream.errors import UsageError
from gstream.run import worker
from gstream.run.local import locked_folder, stop_on_signals
from gstream.run.usage import MemorySampler
from gstream.run.worker import OURS, Fork, Worker, may_fork
from gstream_cli.progress import Bars

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="nothing is forked elsewhere")


@pytest.fixture
def beside(monkeypatch):
    """Threads of these names, and no others, run beside the main one."""
    over = threading.Event()
    threads = []

    def run(*names):
        threads.extend(threading.Thread(target=over.wait, name=name) for name in names)
        for thread in threads:
            thread.start()
        monkeypatch.setattr(threading, "enumerate", lambda: [threading.main_thread(), *threads])

    yield run
    over.set()
    for thread in threads:
        thread.join()


def test_a_process_with_threads_of_ours_alone_is_copied(beside):
    beside(f"{OURS}memory", f"{OURS}signals")
    assert may_fork()


def test_a_process_with_a_thread_that_nobody_knows_is_not_copied(beside, monkeypatch):
    beside(f"{OURS}memory", "heartbeat")
    assert not may_fork()
    monkeypatch.setattr(worker, "Fork", None)
    started = Worker()
    assert started.process.poll() is None
    assert started.kill() == -signal.SIGKILL


def test_a_thread_does_not_copy_its_process(beside):
    beside()
    said = []
    thread = threading.Thread(target=lambda: said.append(may_fork()))
    thread.start()
    thread.join()
    assert said == [False]


def answer_of(work):
    """What a copy writes to its pipe, and how it ends."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        process = Fork(work, theirs.fileno())
        theirs.close()
        return ours.makefile("rb").read(), process.wait()


def test_a_copy_has_no_descriptor_but_the_standard_ones_and_its_pipe():
    def work(pipe):
        held = sorted(int(name) for name in os.listdir("/proc/self/fd"))
        reading = next(fd for fd in held if fd > 2 and fd != pipe)  # of that folder itself
        told = f"{[fd for fd in held if fd != reading] == [0, 1, 2, pipe]}"
        os.write(pipe, f"{told} {os.readlink('/proc/self/fd/0')}".encode())

    assert answer_of(work) == (b"True /dev/null", 1)


def test_a_copy_ends_by_a_signal_that_its_parent_handles(monkeypatch):
    before = signal.signal(signal.SIGTERM, lambda *_: None)
    try:
        assert answer_of(lambda _: os.kill(os.getpid(), signal.SIGTERM)) == (b"", -signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_copy_prints_whatever_its_parent_s_streams_are_doing(capfd, monkeypatch):
    def work(_):
        print("said", file=sys.stderr)
        print("told")
        sys.stdout.flush()

    monkeypatch.setattr(sys, "stderr", None)
    monkeypatch.setattr(sys, "stdout", None)
    answer_of(work)
    assert capfd.readouterr() == ("told\n", "said\n")


def test_no_thread_of_a_run_keeps_its_process_from_being_copied():
    before = threading.enumerate()
    with Bars(), stop_on_signals(()), MemorySampler(lambda *_: None):
        names = {thread.name for thread in threading.enumerate() if thread not in before}
    assert names == {f"{OURS}bars", f"{OURS}signals", f"{OURS}memory"}


def test_an_error_of_a_copy_is_said_and_ends_it(capfd):
    def work(_):
        raise RuntimeError("nobody foresaw this")

    assert answer_of(work) == (b"", 1)
    assert capfd.readouterr().err.endswith("RuntimeError: nobody foresaw this\n")


def test_a_lock_that_a_dying_worker_still_has_is_waited_for(tmp_path):
    def work(pipe):
        with locked_folder(str(tmp_path)):
            os.write(pipe, b".")
            time.sleep(0.3)

    ours, theirs = socket.socketpair()
    with ours, theirs:
        dying = Fork(work, theirs.fileno())
        ours.recv(1)
        with (
            pytest.raises(UsageError, match="this job is running already"),
            locked_folder(str(tmp_path), patience=0.0),
        ):
            pass
        with locked_folder(str(tmp_path)):
            assert dying.wait() == 1
