"""Who works on what: a pure state machine, events in, decisions out; no processes, no clock.

Units are dealt by spatial neighbourhood into one queue per worker, heaviest first; an idle worker
steals from the back of the queue with the most work left. Model: dask/distributed's worker state
machine.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from gstream.job import Unit

ATTEMPTS = 3  # the first death of a unit's worker may be a neighbour's fault
MOST_QUARANTINED = 16  # beyond that it is no unit's fault, and each costs three workers


@dataclass(frozen=True, slots=True)
class Ready:
    """A worker is new, or has just been replaced: it holds no unit."""

    worker: int


@dataclass(frozen=True, slots=True)
class Done:
    """A worker finished the unit it held."""

    worker: int


@dataclass(frozen=True, slots=True)
class Died:
    """A worker's process ended while it held a unit, or while idle."""

    worker: int


@dataclass(frozen=True, slots=True)
class Run:
    """Hand `unit` (an index into the units) to `worker`."""

    worker: int
    unit: int


Event = Ready | Done | Died


class Schedule:
    """The queues of one stage; `handle` each event and carry out what it returns.

    A unit whose workers died ATTEMPTS times is quarantined: not handed out again, while the rest
    goes on. After MOST_QUARANTINED of them nothing more is begun.
    """

    def __init__(self, units: Sequence[Unit], workers: int) -> None:
        self._units = units
        self._queues = [deque(part) for part in deal(units, workers)]
        self._left = [sum(units[u].cost for u in queue) for queue in self._queues]
        self._running: dict[int, int] = {}
        self._idle: set[int] = set()
        self._deaths: dict[int, int] = {}
        self.quarantined: list[int] = []

    @property
    def finished(self) -> bool:
        """Whether no unit is running or waiting."""
        return not self._running and not any(self._queues)

    def running(self, worker: int) -> int | None:
        """The unit that `worker` holds, None when it holds none."""
        return self._running.get(worker)

    def handle(self, event: Event) -> list[Run]:
        match event:
            case Ready(worker):
                return self._feed(worker)
            case Done(worker):
                del self._running[worker]
                return self._feed(worker)
            case Died(worker):
                return self._bury(worker)

    def _feed(self, worker: int) -> list[Run]:
        unit = self._take(worker)
        if unit is None:
            self._idle.add(worker)
            return []
        self._idle.discard(worker)
        self._running[worker] = unit
        return [Run(worker, unit)]

    def _take(self, worker: int) -> int | None:
        if self._queues[worker]:
            return self._pop(worker, self._queues[worker].popleft())
        queues = range(len(self._queues))
        victim = max(queues, key=lambda q: (len(self._queues[q]) > 0, self._left[q]))
        if not self._queues[victim]:
            return None
        return self._pop(victim, self._queues[victim].pop())

    def _pop(self, queue: int, unit: int) -> int:
        self._left[queue] -= self._units[unit].cost
        return unit

    def _bury(self, worker: int) -> list[Run]:
        self._idle.discard(worker)
        unit = self._running.pop(worker, None)
        if unit is None:
            return []
        self._deaths[unit] = self._deaths.get(unit, 0) + 1
        if self._deaths[unit] == ATTEMPTS:
            self.quarantined.append(unit)
            if len(self.quarantined) == MOST_QUARANTINED:
                for queue in self._queues:
                    queue.clear()
            return []
        self._queues[worker].appendleft(unit)
        self._left[worker] += self._units[unit].cost
        return self._feed(min(self._idle)) if self._idle else []


def deal(units: Sequence[Unit], workers: int) -> list[list[int]]:
    """Indices of `units` per worker: neighbours together, costs about equal, heaviest first."""
    by_place = sorted(range(len(units)), key=lambda u: (units[u].place, units[u].name))
    total = sum(unit.cost for unit in units)
    parts: list[list[int]] = [[] for _ in range(workers)]
    passed = 0.0
    for u in by_place:
        middle = passed + units[u].cost / 2
        share = int(middle * workers / total) if total > 0 else u % workers
        parts[min(share, workers - 1)].append(u)
        passed += units[u].cost
    for part in parts:
        part.sort(key=lambda u: (-units[u].cost, units[u].place, units[u].name))
    return parts
