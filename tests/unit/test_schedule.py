"""The scheduler as a machine: generated histories, no process."""

from hypothesis import given
from hypothesis import strategies as st

from gstream.job import Unit
from gstream.run.schedule import ATTEMPTS, Died, Done, GiveUp, Ready, Run, Schedule, deal

costs = st.floats(0, 1e6, allow_nan=False)
unit_lists = st.lists(st.tuples(costs, st.integers(0, 50)), max_size=30).map(
    lambda rows: [Unit("s", f"u{i:03}", cost=c, place=p) for i, (c, p) in enumerate(rows)]
)


class History:
    """Plays a schedule the way an executor does, with the next worker drawn by hypothesis."""

    def __init__(self, units, workers):
        self.schedule = Schedule(units, workers)
        self.units, self.workers = units, workers
        self.holds = {}
        self.done = []
        self.given_up = []
        for worker in range(workers):
            self.tell(Ready(worker))

    def tell(self, event):
        for decision in self.schedule.handle(event):
            if isinstance(decision, GiveUp):
                self.given_up.append(decision.unit)
            else:
                assert isinstance(decision, Run)
                assert decision.worker not in self.holds
                self.holds[decision.worker] = decision.unit

    def finish(self, worker):
        self.done.append(self.holds.pop(worker))
        self.tell(Done(worker))

    def die(self, worker):
        self.holds.pop(worker, None)
        self.tell(Died(worker))
        if not self.given_up:
            self.tell(Ready(worker))


@given(unit_lists, st.integers(1, 6), st.data())
def test_every_unit_is_done_exactly_once_whatever_the_order_of_events(units, workers, data):
    history = History(units, workers)
    while history.holds:
        history.finish(data.draw(st.sampled_from(sorted(history.holds))))
    assert sorted(history.done) == list(range(len(units)))
    assert history.schedule.finished


@given(unit_lists, st.integers(1, 6), st.data())
def test_no_worker_is_idle_while_a_unit_waits(units, workers, data):
    history = History(units, workers)
    while history.holds:
        waiting = len(units) - len(history.done) - len(history.holds)
        assert waiting == 0 or len(history.holds) == workers
        history.finish(data.draw(st.sampled_from(sorted(history.holds))))


@given(unit_lists, st.integers(1, 4), st.data())
def test_deaths_repeat_units_until_one_has_died_too_often(units, workers, data):
    history = History(units, workers)
    deaths = {}
    while history.holds and not history.given_up:
        worker = data.draw(st.sampled_from(sorted(history.holds)))
        if data.draw(st.booleans()):
            unit = history.holds[worker]
            deaths[unit] = deaths.get(unit, 0) + 1
            history.die(worker)
        else:
            history.finish(worker)
    worn_out = [unit for unit, count in deaths.items() if count == ATTEMPTS]
    assert history.given_up == worn_out
    if not worn_out:
        assert sorted(history.done) == list(range(len(units)))


@given(unit_lists, st.integers(1, 6), st.data())
def test_the_death_of_an_idle_worker_changes_nothing(units, workers, data):
    history = History(units, workers)
    while history.holds:
        idle = sorted(set(range(workers)) - set(history.holds))
        if idle:
            history.die(data.draw(st.sampled_from(idle)))
        history.finish(data.draw(st.sampled_from(sorted(history.holds))))
    assert sorted(history.done) == list(range(len(units)))


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
