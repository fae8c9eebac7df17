"""Workers that are forked from this process, as starting Python and numba takes two seconds."""

import os
import signal
from collections.abc import Callable

MOST_FILES = 1 << 16


class Forked:
    """What `gstream.run.local` needs of a `subprocess.Popen`, whose process does `serve`."""

    def __init__(self, serve: Callable[[int], None], pipe: int) -> None:
        self.returncode: int | None = None
        self.pid = os.fork()
        if self.pid == 0:
            try:
                os.closerange(3, pipe)  # the job folder's lock is one of them
                os.closerange(pipe + 1, MOST_FILES)
                serve(pipe)
            finally:
                os._exit(1)

    def poll(self) -> int | None:
        return self._ended(os.WNOHANG)

    def wait(self) -> int | None:
        return self._ended(0)

    def kill(self) -> None:
        if self.returncode is None:
            os.kill(self.pid, signal.SIGKILL)

    def _ended(self, how: int) -> int | None:
        if self.returncode is None and (ended := os.waitpid(self.pid, how))[0]:
            self.returncode = os.waitstatus_to_exitcode(ended[1])
        return self.returncode


def forked(serve: Callable[[int], None]) -> Callable[..., Forked]:
    """To be put in the place of `subprocess.Popen` while workers are started."""

    def popen(command: object, *, pass_fds: list[int], stdin: int) -> Forked:
        return Forked(serve, pass_fds[0])

    return popen
