"""The frozen vectors of the block file; tests/damaged_block_files.py wrote them, no test does."""

from pathlib import Path

import pytest
from damaged_block_files import DAMAGE, GOOD

from gstream.blockcheck import iter_findings
from gstream.check import RULES
from gstream.compiled import compiled
from gstream.formats.findings import ERROR
from gstream.read import open_block_file

VECTORS = Path(__file__).parents[2] / "spec" / "vectors"


@pytest.mark.parametrize("name", GOOD)
def test_a_good_vector_breaks_no_rule(name):
    findings = list(iter_findings(VECTORS / "good" / f"{name}.gsb"))
    assert [finding for finding in findings if finding.severity == ERROR] == []


@pytest.mark.parametrize("name", GOOD)
def test_every_column_of_a_good_vector_is_read(name):
    with open_block_file(VECTORS / "good" / f"{name}.gsb") as file:
        for level in range(file.levels):
            for view in file.blocks(level):
                assert {len(view.column(column)) for column in file.columns} == {view.count}


@pytest.mark.parametrize("name", GOOD)
def test_what_is_written_today_has_the_content_of_its_vector(name):
    vector = (VECTORS / "good" / f"{name}.gsb").read_bytes()
    assert GOOD[name]()[40:56] == vector[40:56]


@pytest.mark.parametrize("name", DAMAGE)
def test_a_bad_vector_breaks_the_rule_it_is_named_after(name):
    assert name[:8] in {f.rule for f in iter_findings(VECTORS / "bad" / f"{name}.gsb")}


@pytest.mark.parametrize("name", [f"good/{g}" for g in GOOD] + [f"bad/{b}" for b in DAMAGE])
def test_both_arithmetics_find_the_same(name):
    path = VECTORS / f"{name}.gsb"
    assert list(iter_findings(path, choose=compiled)) == list(iter_findings(path))


def test_every_rule_has_a_bad_vector_and_every_bad_vector_a_rule():
    assert {rule.id for rule in RULES} == {p.stem[:8] for p in (VECTORS / "bad").glob("GSB-*")}
