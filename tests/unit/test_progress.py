"""What a watcher makes of a job's events: rate, time left, silence, and the lines of the log."""

import json
import os
import re
import sys
import threading
from dataclasses import fields
from pathlib import Path
from typing import get_args

import pytest

from gstream.errors import UsageError
from gstream.run.log import Log
from gstream.run.progress import (
    Event,
    Failed,
    Memory,
    Note,
    Resumed,
    StageBegins,
    StageEnds,
    Start,
    UnitDone,
    UnitLeftOut,
    in_turn,
)
from gstream.run.usage import Usage
from gstream_cli import pace
from gstream_cli.pace import Pace
from gstream_cli.progress import Bars, Lines

README = Path(__file__).parents[2] / "README.md"
SHARES = {"presort": 20, "voxelize": 60, "pack": 20}


class Clock:
    """time.monotonic, by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch):
    hand = Clock()
    for module in ("gstream_cli.pace", "gstream_cli.progress", "gstream.run.log"):
        monkeypatch.setattr(f"{module}.time", hand)
    monkeypatch.setattr(pace, "SHARES", SHARES)
    return hand


def start(*stages: str) -> Start:
    return Start({"stages": list(stages)}, "/x", 2, 2 << 30, resumed=False)


def test_a_stage_s_time_left_is_by_cost_and_without_what_came_before_its_first_unit(clock):
    of = Pace()
    of(StageBegins("4-voxelize", 3, 10.0))
    clock.now += 60  # kernels are compiled
    clock.now += 4
    of(UnitDone("4-voxelize", 4.0, seconds=4.0))
    assert of.stage_left == pytest.approx(6)
    assert str(of) == "1/3 units, 0.2/s, 0:06 left"
    clock.now += 4
    of(UnitDone("4-voxelize", 4.0, seconds=4.0))
    assert of.stage_left == pytest.approx(2)


def test_a_job_s_time_left_is_by_the_running_stage_s_pace_and_the_shares_of_those_ahead(clock):
    of = Pace()
    of(start("presort", "voxelize", "pack"))
    assert of.job_left is None
    of(StageBegins("3-presort", 1, 1.0))
    clock.now += 10
    of(UnitDone("3-presort", 1.0, seconds=10.0))
    of(StageEnds("3-presort", 10.0))
    assert of.job_left == pytest.approx(40)
    of(StageBegins("4-voxelize", 4, 4.0))
    assert of.job_left == pytest.approx(40)
    clock.now += 30  # presort was no measure of it
    of(UnitDone("4-voxelize", 1.0, seconds=30.0))
    assert of.job_part == pytest.approx(0.35)
    assert of.job_left == pytest.approx(90 + 20 * 40 / 35)


def test_what_an_earlier_run_has_done_is_no_part_of_a_resumed_job(clock):
    of = Pace()
    of(start("presort", "voxelize", "pack"))
    of(Resumed("3-presort", 9))
    of(StageBegins("3-presort", 0, 0.0, share=0.0))
    assert str(of) == "9/9 units, 0.0/min, 0:00 left"
    of(StageEnds("3-presort", 0.0))
    of(Resumed("4-voxelize", 4))
    of(StageBegins("4-voxelize", 2, 2.0, share=1 / 3))
    for _ in range(2):
        clock.now += 10
        of(UnitDone("4-voxelize", 1.0, seconds=10.0))
    assert str(of) == "6/6 units, 0.1/s, 0:00 left"
    assert of.job_part == pytest.approx(0.5)
    assert of.job_left == pytest.approx(20)
    of(StageEnds("4-voxelize", 20.0))
    of(StageBegins("7-pack", 1, 1.0))
    assert (of.done, of.units) == (0, 1)


def test_a_job_s_time_left_is_not_told_from_less_than_a_twentieth_of_it(clock):
    of = Pace()
    of(start("presort", "voxelize", "pack"))
    of(StageBegins("3-presort", 10, 10.0))
    clock.now += 1
    of(UnitDone("3-presort", 1.0, seconds=1.0))
    assert of.job_left is None
    assert of.stage_left == pytest.approx(9)


def test_slow_units_are_counted_by_the_minute(clock):
    of = Pace()
    of(StageBegins("4-voxelize", 2, 2.0))
    clock.now += 30
    of(UnitDone("4-voxelize", 1.0, seconds=30.0))
    assert of.rate == "2.0/min"


def test_a_stage_without_units_has_nothing_left(clock):
    of = Pace()
    of(StageBegins("6-simplify", 0, 0.0))
    clock.now += 100
    assert str(of) == "0/0 units, 0.0/min, 0:00 left"


def test_lines_say_when_no_unit_was_finished_for_ten_seconds(capsys, clock):
    lines = Lines(sys.stderr)
    lines(Note("working in x"))
    lines(StageBegins("4-voxelize", 2, 2.0))
    for _ in range(50):
        clock.now += 0.5
        lines(Memory(1, 1))
    lines(UnitDone("4-voxelize", 1.0, seconds=25.0))
    for _ in range(25):
        clock.now += 0.5
        lines(Memory(1, 1))
    lines(UnitDone("4-voxelize", 1.0, seconds=12.5))
    for _ in range(50):
        clock.now += 0.5
        lines(Memory(1, 1))
    assert capsys.readouterr().err.splitlines() == [
        "working in x",
        "4-voxelize: 0/2 units, none finished in 0:10",
        "4-voxelize: 0/2 units, none finished in 0:20",
        "4-voxelize: 1/2 units, 2.4/min, 0:25 left",
        "4-voxelize: 1/2 units, the last one was finished 0:10 ago",
        "4-voxelize: 2/2 units, 3.2/min, 0:00 left",
    ]


@pytest.mark.parametrize("watcher", [lambda: Lines(sys.stderr), Bars])
def test_a_unit_that_is_left_out_is_told_of_at_once(capsys, clock, watcher):
    with watcher() as shown:
        shown(StageBegins("4-voxelize", 2, 2.0))
        shown(UnitLeftOut("4-voxelize", "000007", "signal 9"))
    assert "unit 000007 keeps killing its worker (signal 9), left out" in capsys.readouterr().err


def test_bars_say_when_no_unit_was_finished_for_ten_seconds(capsys, clock):
    with Bars() as bars:
        bars(start("voxelize"))
        bars(StageBegins("4-voxelize", 2, 2.0))
        clock.now += 8
        bars(UnitDone("4-voxelize", 1.0, seconds=8.0))
        clock.now += 13
        bars(Memory(1, 1))
    said = capsys.readouterr().err
    assert "1/2 units, the last one was finished 0:13 ago" in said
    assert "about 0:08 left" in said


def read(path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_the_log_has_a_line_for_each_event_as_soon_as_it_happens(tmp_path):
    path = tmp_path / "log"
    usage = Usage(1.5, 10, 20, 30, 40)
    events: list[Event] = [
        Note('a "note"\nof two lines'),
        start("voxelize"),
        UnitDone("4-voxelize", 2.0, 0.5, "000007"),
        StageEnds("4-voxelize", 3.0, usage, 99),
        Failed("InputError", "a.ply: is empty"),
    ]
    with Log(str(path)) as log:
        for number, event in enumerate(events, 1):
            log(event)
            assert len(read(path)) == number
    lines = read(path)
    assert [line["event"] for line in lines] == ["note", "start", "unit_done", "stage_end", "error"]
    assert lines[0]["said"] == 'a "note"\nof two lines'
    assert (lines[2]["unit"], lines[2]["seconds"]) == ("000007", 0.5)
    assert (lines[3]["cpu_seconds"], lines[3]["written_bytes"]) == (1.5, 20)
    assert lines[3]["peak_memory"] == 99


def test_the_readme_has_every_event_of_the_log_and_every_field():
    text = README.read_text()
    rows = dict(re.findall(r"^\| (`[a-z_`, ]+`) \| (`.+) \|$", text, re.M))
    told = {name: row for names, row in rows.items() for name in re.findall("`([a-z_]+)`", names)}
    for event in get_args(Event):
        for name in (field.name for field in fields(event) if field.name != "usage"):
            assert f"`{name}`" in told[event.NAME], (event.NAME, name)
    for field in fields(Usage):
        assert f"`{field.name}`" in told["stage_end"]


def test_the_log_of_a_second_run_follows_that_of_the_first(tmp_path):
    path = str(tmp_path / "log")
    for said in ("first", "second"):
        with Log(path) as log:
            log(Note(said))
    assert [line["said"] for line in read(tmp_path / "log")] == ["first", "second"]


def test_the_log_keeps_one_sample_of_memory_in_five_seconds(tmp_path, clock):
    with Log(str(tmp_path / "log")) as log:
        for sample in range(21):
            log(Memory(sample, sample))
            clock.now += 0.5
    assert [line["used"] for line in read(tmp_path / "log")] == [0, 10, 20]


def test_a_log_that_cannot_be_opened_is_refused(tmp_path):
    with pytest.raises(UsageError, match="no/log: cannot be written: No such file"):
        Log(str(tmp_path / "no/log"))


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_a_log_on_a_full_disk_says_so_and_disturbs_nobody():
    with Log("/dev/full") as log:
        log(Note("a"))
        log(Note("b"))
    assert log.failure == "No space left on device"


def test_events_of_two_threads_are_told_one_at_a_time():
    inside, most = 0, 0

    def slow(event: Event) -> None:
        nonlocal inside, most
        inside += 1
        most = max(most, inside)
        threading.Event().wait(0.001)
        inside -= 1

    tell = in_turn(slow)
    threads = [
        threading.Thread(target=lambda: [tell(Memory(1, 1)) for _ in range(20)]) for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1
