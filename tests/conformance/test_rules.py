"""spec/rules.md: it is what the checker's tables say, and its sections explain its rules."""

import re
from pathlib import Path

import pytest
from conformance.rules_page import FORMATS, PAGE, page

SPEC = Path(__file__).parents[2] / "spec"
RULES = [(spec, rule) for _, spec, rules in FORMATS for rule in rules]
VECTORS = SPEC / "vectors" / "bad"


def section(spec: str, number: str) -> str:
    """The text of one section, without those below it."""
    text = (SPEC / spec).read_text()
    body = re.split(rf"^#+ {re.escape(number)}\.? ", text, flags=re.MULTILINE)[1]
    return re.split(r"^#", body, maxsplit=1, flags=re.MULTILINE)[0]


def test_the_page_is_the_tables_of_the_checker():
    assert PAGE.read_text() == page()


def test_no_id_stands_twice_and_ids_ascend():
    for _, _, rules in FORMATS:
        ids = [rule.id for rule in rules]
        assert ids == sorted(set(ids))


@pytest.mark.parametrize(("spec", "rule"), RULES, ids=[rule.id for _, rule in RULES])
def test_the_section_of_a_rule_names_it(spec, rule):
    assert rule.id in section(spec, rule.section)


def test_the_bad_vectors_are_named_after_all_rules():
    assert {rule.id for _, rule in RULES} == {path.stem[:8] for path in VECTORS.glob("G??-*")}
