"""Damaged files by the thousand: no other error than ours, no hang, no memory, no contradiction.

`make fuzz` runs 1 000 000 of them, or as many as MUTANTS says. Mutant n again: mutants.mutant(n).
"""

import os
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import pytest

from fuzz.mutants import SOURCES, mutant
from fuzz.readers import deadline, disagreement, limited_memory, outcome, verdict, warm

QUICK = 20_000
MANY = int(os.environ.get("MUTANTS", "1000000"))
SMALLEST = [s for s in SOURCES if s.name in ("blocks-smallest.gsb", "stream-smallest.gst")]
OTHERS = [s for s in SOURCES if s not in SMALLEST]


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    warm()


def test_a_mutant_has_the_same_bytes_wherever_it_is_made():
    assert mutant(12345) == mutant(12345)


def test_every_good_vector_and_every_way_of_damage_has_mutants():
    made = [mutant(n) for n in range(2000)]
    assert {m.source for m in made} == {s.name for s in SOURCES}
    assert len({m.how for m in made}) == 9


def findings(numbers: Iterable[int], path: Path) -> list[str]:
    """What went wrong with which mutants."""
    found = []
    with deadline() as begin, limited_memory():
        for n in numbers:
            made = mutant(n)
            path.write_bytes(made.data)
            begin()
            try:
                said = disagreement(path)
            except Exception as error:
                said = f"{type(error).__name__}: {error}"
            if said:
                found.append(f"{made.name}: {said}")
            if n % 10_000 == 9_999:
                print(f"{n + 1:,} mutants, {len(found)} findings", file=sys.__stderr__, flush=True)
    return found


def test_20_000_mutants_do_no_harm(tmp_path):
    assert findings(range(QUICK), tmp_path / "mutant") == []


@pytest.mark.long
def test_a_million_mutants_do_no_harm(tmp_path):
    assert findings(range(QUICK, MANY), tmp_path / "mutant") == []


def flips(source, path: Path) -> Counter[str]:
    """How check and reader answer every single-bit flip of a file."""
    path.write_bytes(source.data)
    sound = outcome(path, fast=False)
    answers: Counter[str] = Counter()
    for bit in range(8 * len(source.data)):
        data = bytearray(source.data)
        data[bit // 8] ^= 1 << bit % 8
        path.write_bytes(data)
        answers["unseen by check"] += verdict(path) == "valid"
        read = outcome(path, fast=False)
        answers["read as it was"] += read == sound
        answers["read as something else"] += read.startswith("read") and read != sound
    return answers


def check_flips(source, path: Path) -> None:
    answers = flips(source, path)
    share = 100 - 100 * answers["read as it was"] / (8 * len(source.data))
    print(f"{source.name}: {8 * len(source.data)} flips, the reader refuses {share:.1f} %")
    assert answers["unseen by check"] == answers["read as something else"] == 0


@pytest.mark.parametrize("source", SMALLEST, ids=lambda source: source.name)
def test_check_sees_every_flipped_bit_and_no_reader_is_misled_by_one(source, tmp_path):
    check_flips(source, tmp_path / "flipped")


@pytest.mark.long
@pytest.mark.parametrize("source", OTHERS, ids=lambda source: source.name)
def test_the_same_is_true_of_every_other_good_vector(source, tmp_path):
    check_flips(source, tmp_path / "flipped")
