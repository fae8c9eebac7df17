"""The frozen vectors of the block file; tests/damaged_block_files.py wrote them, no test does."""

from pathlib import Path

import pytest
from damaged_block_files import DAMAGE, GOOD

from gstream.blockcheck import iter_findings
from gstream.check import RULES
from gstream.compiled import compiled
from gstream.digests import block_file_content
from gstream.errors import CorruptFileError
from gstream.formats.blockhead import Head
from gstream.formats.blockmeta import meta_bytes
from gstream.formats.columns import COLUMN_IDS
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
                known = [name for name, spec in file.specs.items() if spec.id in COLUMN_IDS]
                assert {len(view.column(name)) for name in known} == {view.count}


def test_good_vectors_have_the_most_of_what_is_limited():
    def head(name: str) -> Head:
        with open_block_file(VECTORS / "good" / f"{name}.gsb") as file:
            return file.head

    tables = head("blocks-most-tables")
    assert (len(tables.columns), 4 + len(tables.sections)) == (16, 16)
    assert max(len(column.name.encode()) for column in tables.columns) == 24
    assert len(meta_bytes(tables.metadata)) == 12_288
    assert len(head("blocks-most-pages").page_table) == 1400
    assert head("blocks-full-page").page_table["count"].max() == 1024
    assert head("blocks-full-256").levels["voxels"].tolist() == [2**24]
    deep = head("blocks-17-levels")
    assert (deep.settings.resolution, len(deep.levels)) == (65_536, 17)


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


def test_a_file_with_a_damaged_tail_has_no_digests():
    with pytest.raises(CorruptFileError, match="GSB-0102"):
        block_file_content(VECTORS / "bad" / "GSB-0102.gsb")
