"""`--log`: what a job tells, as one line of JSON for each event, flushed at once."""

import json
import os
import time
from dataclasses import asdict
from datetime import UTC, datetime
from types import TracebackType
from typing import Self

from gstream.errors import UsageError
from gstream.run.progress import Event, Memory

MEMORY_SECONDS = 5.0  # between two samples: 100 KB of them in an hour


class Log:
    """A Progress that appends to a file; the job goes on where that cannot be written.

    A line: `event`, one of start, resumed, stage_begin, kernels, unit_done, unit_left_out,
    stage_end, memory, note, stopped, error, end; `time`, UTC; and the fields of the event
    (`gstream.run.progress`). The last line of a run is stopped, error or end, unless it was killed.
    """

    def __init__(self, path: str) -> None:
        """errors : UsageError when the file cannot be opened"""
        self.failure: str | None = None  # why nothing more was written
        self._sampled_at = float("-inf")
        try:
            self._file = open(path, "ab", buffering=0)  # noqa: SIM115  __exit__
        except OSError as error:
            said = f"{path}: cannot be written: {os.strerror(error.errno or 0)}"
            raise UsageError(said, "give another file for --log") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: object, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def __call__(self, event: Event) -> None:
        if isinstance(event, Memory):
            now = time.monotonic()
            if now - self._sampled_at < MEMORY_SECONDS:
                return
            self._sampled_at = now
        fields = asdict(event)
        fields |= fields.pop("usage", {})
        moment = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"event": event.NAME, "time": moment, **fields})
        if self.failure is None:
            try:
                self._file.write(line.encode() + b"\n")
            except OSError as error:
                self.failure = os.strerror(error.errno or 0)
