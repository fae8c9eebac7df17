"""tools/view_gl/loader: lists replace each other, nothing is read twice, errors are told once."""

import threading
from queue import Queue

import numpy as np
import pytest

from gstream_tools.view_gl.loader import BATCH_BYTES, Loader, Wish

PATIENCE = 60  # seconds, until a test that hangs fails


class File:
    """Reads when it is told to: `started` tells what is being read, `step` lets it finish."""

    def __init__(self):
        self.started, self._steps, self.asked = Queue(), threading.Semaphore(0), []

    def step(self):
        self._steps.release()

    def _read(self, what):
        self.asked.append(what)
        self.started.put(what)
        assert self._steps.acquire(timeout=PATIENCE)

    def page(self, number):
        self._read(("page", number))

    def load(self, entries, names):
        nodes = [entry["node"] for entry in entries]
        self._read(nodes)
        if 13 in nodes:
            raise OSError("the disk is gone")
        return [
            {"words": np.arange(node, dtype=np.uint32)}
            | {"normal": np.full((node, 2), node, np.uint16)}
            for node in nodes
        ]


class Entries:
    """Row n stands for a block of n voxels; ten of them are a batch."""

    def __getitem__(self, node):
        record = {"stored": BATCH_BYTES // 30 + 1}
        return {"node": node, "occupancy": record, "mask": record, "normal": record}


ENTRIES = Entries()


@pytest.fixture
def file():
    return File()


@pytest.fixture
def loader(file):
    loader = Loader(file, ["normal"])
    yield loader
    for _ in range(100):
        file.step()
    loader.close()


def ask(loader, *nodes, pages=()):
    loader.ask(Wish(frozenset(pages), nodes), ENTRIES)


def wait_for(file):
    return file.started.get(timeout=PATIENCE)


def taken(loader, file):
    """Let all that is asked for be read; the blocks that arrive."""
    for _ in range(100):
        file.step()
    blocks = []
    while not loader.idle:
        blocks += [node for node, _ in loader.take().blocks]
    return blocks


def test_a_new_list_replaces_the_old_one_and_what_was_in_flight_arrives(loader, file):
    ask(loader, *range(20, 50))
    first = wait_for(file)
    assert first == list(range(20, 30))
    ask(loader, 7, 8)
    assert taken(loader, file) == [*first, 7, 8]
    assert file.asked == [first, [7, 8]]


def test_what_is_being_read_is_not_read_again(loader, file):
    ask(loader, 1, 2)
    assert wait_for(file) == [1, 2]
    ask(loader, 1, 2, 3)
    ask(loader, 2, 1, 4)
    assert taken(loader, file) == [1, 2, 4]
    assert file.asked == [[1, 2], [4]]


def test_what_was_read_and_not_taken_is_not_read_again(loader, file):
    ask(loader, 1)
    wait_for(file)
    ask(loader, 1, 2)
    file.step()
    assert wait_for(file) == [2]
    ask(loader, 1, 2, 3)
    assert taken(loader, file) == [1, 2, 3]
    assert file.asked == [[1], [2], [3]]


def test_what_was_taken_can_be_asked_for_again(loader, file):
    ask(loader, 1)
    assert taken(loader, file) == [1]
    ask(loader, 1)
    assert taken(loader, file) == [1]


def test_an_empty_list_calls_everything_back_but_what_is_in_flight(loader, file):
    ask(loader, *range(20, 50))
    first = wait_for(file)
    ask(loader)
    assert taken(loader, file) == first


def test_pages_come_before_blocks(loader, file):
    ask(loader, 5, pages=[3, 1])
    for _ in range(3):
        file.step()
    assert [wait_for(file) for _ in range(3)] == [("page", 1), ("page", 3), [5]]
    pages = []
    while not loader.idle:
        pages += loader.take().pages
    assert pages == [1, 3]


def test_blocks_are_read_in_the_order_of_the_list(loader, file):
    nodes = [*range(45, 20, -1), *range(12)]
    ask(loader, *nodes)
    assert taken(loader, file) == nodes


def test_an_error_is_raised_once_and_the_thread_lives_on(loader, file):
    ask(loader, 13)
    wait_for(file)
    file.step()
    with pytest.raises(OSError, match="the disk is gone"):
        while not loader.idle:
            loader.take()
    assert loader.take().blocks == []
    ask(loader, 1)
    assert taken(loader, file) == [1]


def test_an_error_loses_nothing_that_was_read_before(loader, file):
    ask(loader, *range(10), 13)
    file.step()
    assert wait_for(file) == list(range(10))
    assert wait_for(file) == [13]
    file.step()
    loader.close()
    with pytest.raises(OSError, match="the disk is gone"):
        loader.take()
    assert [node for node, _ in loader.take().blocks] == list(range(10))


def test_a_loader_is_idle_only_when_nothing_is_to_be_taken(loader, file):
    assert loader.idle
    ask(loader, 1)
    assert not loader.idle
    wait_for(file)
    assert not loader.idle
    assert taken(loader, file) == [1]
    assert loader.idle


def test_closing_waits_for_what_is_in_flight_and_reads_no_more(loader, file):
    ask(loader, *range(20, 50))
    wait_for(file)
    closing = threading.Thread(target=loader.close)
    closing.start()
    file.step()
    closing.join(PATIENCE)
    assert not closing.is_alive()
    assert len(file.asked) == 1
    assert "reader" not in {thread.name for thread in threading.enumerate()}


def test_closing_a_loader_that_was_never_asked_is_nothing(loader):
    loader.close()


def test_words_hold_place_and_mask_then_the_columns(loader, file):
    file.step()
    ((node, words),) = loader.read(ENTRIES, [3])
    assert node == 3
    assert words.tolist() == [[i, 3 | 3 << 16] for i in range(3)]
