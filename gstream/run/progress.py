"""What a running job tells whoever watches it. What that looks like is the business of `cli/`."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from gstream.run.usage import Usage


@dataclass(frozen=True, slots=True)
class Note:
    """One line of talk: what is estimated, where the job's folder is."""

    NAME: ClassVar = "note"
    said: str


@dataclass(frozen=True, slots=True)
class Start:
    """The job is about to run its first stage."""

    NAME: ClassVar = "start"
    job: Mapping[str, Any]  # stages, settings, inputs, output, version
    folder: str
    workers: int
    memory: int  # bytes that all processes may take
    resumed: bool


@dataclass(frozen=True, slots=True)
class Resumed:
    """Units of a stage were done by an earlier run."""

    NAME: ClassVar = "resumed"
    stage: str
    units: int


@dataclass(frozen=True, slots=True)
class StageBegins:
    """Units of a total estimated cost are still to be done; `share` of all the stage's cost."""

    NAME: ClassVar = "stage_begin"
    stage: str
    units: int
    cost: float
    share: float = 1.0


@dataclass(frozen=True, slots=True)
class Kernels:
    """A stage's kernels are loaded, or compiled where no run has done it before; then `ready`."""

    NAME: ClassVar = "kernels"
    stage: str
    ready: bool


@dataclass(frozen=True, slots=True)
class UnitDone:
    """A unit of that estimated cost is finished; or several small ones, told of together."""

    NAME: ClassVar = "unit_done"
    stage: str
    cost: float
    seconds: float = 0.0  # of its worker
    unit: str = ""
    units: int = 1


@dataclass(frozen=True, slots=True)
class UnitLeftOut:
    """A unit has killed so many workers that it is not tried again; the stage's others are."""

    NAME: ClassVar = "unit_left_out"
    stage: str
    unit: str
    cause: str  # how the last worker ended: `signal 9`


@dataclass(frozen=True, slots=True)
class StageEnds:
    """All units are done and the stage has counted them."""

    NAME: ClassVar = "stage_end"
    stage: str
    seconds: float
    usage: Usage = field(default_factory=Usage)
    peak_memory: int = 0  # bytes


@dataclass(frozen=True, slots=True)
class Memory:
    """A sample of the process tree's memory, two each second."""

    NAME: ClassVar = "memory"
    used: int  # bytes
    peak: int


@dataclass(frozen=True, slots=True)
class Stopped:
    """The job stopped midway and can be resumed."""

    NAME: ClassVar = "stopped"
    said: str


@dataclass(frozen=True, slots=True)
class Failed:
    """The job failed: its input, what it was given, or an error of ours."""

    NAME: ClassVar = "error"
    kind: str
    said: str


@dataclass(frozen=True, slots=True)
class End:
    """The output is there."""

    NAME: ClassVar = "end"
    output: str
    output_bytes: int
    seconds: float
    cpu_seconds: float
    peak_memory: int  # bytes


Event = (
    Note
    | Start
    | Resumed
    | StageBegins
    | Kernels
    | UnitDone
    | UnitLeftOut
    | StageEnds
    | Memory
    | Stopped
    | Failed
    | End
)
Progress = Callable[[Event], None]  # told of one event at a time, from any thread


def silent(event: Event) -> None:
    """Progress for nobody."""


def in_turn(progress: Progress) -> Progress:
    """The same progress for several threads: memory is sampled in one of its own."""
    lock = threading.Lock()

    def tell(event: Event) -> None:
        with lock:
            progress(event)

    return tell
