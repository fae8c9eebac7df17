"""The scheduler as a machine: thousands of generated histories, no process.

A history is played the way the executor plays it, on a clock of its own: workers of any speed,
units that always kill their worker, workers that die of a neighbour's fault or while idle.
"""

import heapq
from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gstream.job import Unit
from gstream.run.schedule import (
    ATTEMPTS,
    MOST_QUARANTINED,
    Died,
    Done,
    Event,
    Ready,
    Run,
    Schedule,
    deal,
)

HISTORIES = 3000
START_SECONDS = 2.0  # of a worker that takes the place of a dead one


@dataclass
class History:
    """What happened to one stage: (what, worker, unit) in order; None is no unit."""

    units: list[Unit]
    speeds: list[int]  # cost per time, of each worker
    poison: set[int]
    death_rate: float
    log: list[tuple[str, int, int | None]] = field(default_factory=list)
    held: dict[int, int] = field(default_factory=dict)
    gone: set[int] = field(default_factory=set)  # died idle: not replaced before the next stage
    end: float = 0.0

    def play(self, random: Random) -> "History":
        self.schedule = Schedule(self.units, len(self.speeds))
        self.events = [(0.0, w) for w in range(len(self.speeds))]  # when one is ready, done or dead
        while not self.schedule.finished:
            assert len(self.log) < 9 * (len(self.units) + len(self.speeds)), "it goes on and on"
            if random.random() < self.death_rate:
                self._lose_an_idle_worker(random)
            self.end, worker = heapq.heappop(self.events)
            if worker not in self.held:
                self._note("ready", worker)
                self._tell(Ready(worker))
            elif self.held[worker] in self.poison or random.random() < self.death_rate:
                self._note("died", worker)
                self._tell(Died(worker))
                heapq.heappush(self.events, (self.end + START_SECONDS, worker))
            else:
                self._note("done", worker)
                self._tell(Done(worker))
        return self

    def _note(self, what: str, worker: int) -> None:
        self.log.append((what, worker, self.held.pop(worker, None)))

    def _lose_an_idle_worker(self, random: Random) -> None:
        busy = self.gone.union(worker for _, worker in self.events)
        idle = [worker for worker in range(len(self.speeds)) if worker not in busy]
        if idle:
            worker = random.choice(idle)
            self.gone.add(worker)
            self._note("died", worker)
            self._tell(Died(worker))

    def _tell(self, event: Event) -> None:
        for run in self.schedule.handle(event):
            self.log.append(("run", run.worker, run.unit))
            self.held[run.worker] = run.unit
            seconds = self.units[run.unit].cost / self.speeds[run.worker]
            heapq.heappush(self.events, (self.end + seconds, run.worker))

    def count(self, what: str) -> Counter[int | None]:
        return Counter(unit for kind, _, unit in self.log if kind == what)


@cache
def histories(death_rate: float, poisoned: float) -> list[History]:
    """HISTORIES / 3 of them: up to 40 units of whole costs, up to 6 workers."""
    played = []
    for seed in range(HISTORIES // 3):
        random = Random(f"{seed} {death_rate} {poisoned}")
        units = [
            Unit("s", f"u{i:02}", cost=float(random.randrange(9)), place=random.randrange(50))
            for i in range(random.randrange(41))
        ]
        speeds = [random.choice((1, 1, 1, 10)) for _ in range(random.randint(1, 6))]
        poison = {unit for unit in range(len(units)) if random.random() < poisoned}
        played.append(History(units, speeds, poison, death_rate).play(random))
    return played


QUIET, DYING, POISONED = (0.0, 0.0), (0.2, 0.0), (0.05, 0.1)
KINDS = pytest.mark.parametrize("kind", [QUIET, DYING, POISONED])


@KINDS
def test_every_unit_is_done_once_or_has_killed_three_workers(kind):
    for history in histories(*kind):
        done, died = history.count("done"), history.count("died")
        left_out = history.schedule.quarantined
        assert set(done.values()) <= {1}
        assert sorted([*done, *left_out]) == list(range(len(history.units)))
        assert {unit for unit in done | died if died[unit] == ATTEMPTS} - {None} == set(left_out)
        assert set(left_out) >= history.poison


@KINDS
def test_no_unit_is_held_by_two_workers_and_no_worker_holds_two(kind):
    for history in histories(*kind):
        held: dict[int, int | None] = {}  # of each worker that lives
        for what, worker, unit in history.log:
            if what == "run":
                assert held[worker] is None
                assert unit not in held.values()
                held[worker] = unit
            elif what == "died":
                assert held.pop(worker) == unit
            else:
                assert held.get(worker) == unit
                held[worker] = None
        assert set(held.values()) <= {None}


@KINDS
def test_no_worker_is_idle_while_a_unit_waits(kind):
    for history in histories(*kind):
        waiting, deaths = len(history.units), Counter[int | None]()
        idle = set[int]()
        for number, (what, worker, unit) in enumerate(history.log):
            if what == "run":
                idle.remove(worker)
                waiting -= 1
            elif what == "died":
                idle.discard(worker)
                deaths[unit] += 1
                waiting += unit is not None and deaths[unit] < ATTEMPTS
            else:
                idle.add(worker)
            if number + 1 == len(history.log) or history.log[number + 1][0] != "run":
                assert waiting == 0 or not idle


@KINDS
def test_a_worker_takes_its_heaviest_unit_or_the_lightest_of_the_queue_with_most_left(kind):
    for history in histories(*kind):
        queues, deaths = deal(history.units, len(history.speeds)), Counter[int]()
        for what, worker, unit in history.log:
            if what == "died" and unit is not None:
                deaths[unit] += 1
                if deaths[unit] < ATTEMPTS:
                    queues[worker].insert(0, unit)
            if what == "run" and queues[worker]:
                assert unit == queues[worker].pop(0)
            elif what == "run":
                left = [sum(history.units[u].cost for u in queue) for queue in queues]
                most = max(left[q] for q in range(len(queues)) if queues[q])
                fullest = [q for q, queue in enumerate(queues) if queue and left[q] == most]
                assert unit == queues[fullest[0]].pop()


def test_a_stage_ends_at_most_one_slow_unit_after_all_workers_were_busy():
    for history in histories(*QUIET):
        costs = [unit.cost for unit in history.units]
        last_unit = max(costs, default=0.0) / min(history.speeds)
        assert history.end <= sum(costs) / sum(history.speeds) + last_unit + 1e-9


@pytest.mark.parametrize("workers", [1, 2, 6])
def test_nothing_is_begun_after_sixteen_units_have_killed_three_workers_each(workers):
    units = [Unit("s", f"u{i}", cost=1.0, place=i) for i in range(100)]
    history = History(units, [1] * workers, set(range(100)), 0.0).play(Random(workers))
    left_out = len(history.schedule.quarantined)
    assert MOST_QUARANTINED <= left_out < MOST_QUARANTINED + workers
    assert history.count("run").total() == ATTEMPTS * left_out


costs = st.floats(0, 1e6, allow_nan=False)
unit_lists = st.lists(st.tuples(costs, st.integers(0, 50)), max_size=30).map(
    lambda rows: [Unit("s", f"u{i:03}", cost=c, place=p) for i, (c, p) in enumerate(rows)]
)


@given(unit_lists, st.integers(1, 6))
def test_deal_gives_each_unit_to_one_worker_heaviest_first(units, workers):
    parts = deal(units, workers)
    assert sorted(u for part in parts for u in part) == list(range(len(units)))
    for part in parts:
        assert [units[u].cost for u in part] == sorted((units[u].cost for u in part), reverse=True)


def test_deal_keeps_neighbours_together():
    units = [Unit("s", f"u{i}", cost=1.0, place=i % 2) for i in range(8)]
    parts = deal(units, 2)
    assert [{units[u].place for u in part} for part in parts] == [{0}, {1}]


def test_an_idle_worker_steals_the_lightest_unit_of_the_fullest_queue():
    units = [Unit("s", "near", cost=4, place=0)]
    units += [Unit("s", f"far{i}", cost=c, place=9) for i, c in enumerate((4, 3, 1))]
    schedule = Schedule(units, 3)
    assert deal(units, 3) == [[0], [1], [2, 3]]
    assert [schedule.handle(Ready(w)) for w in range(3)] == [[Run(0, 0)], [Run(1, 1)], [Run(2, 2)]]
    assert schedule.handle(Done(0)) == [Run(0, 3)]
