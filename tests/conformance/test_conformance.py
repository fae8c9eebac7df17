"""The levels that are claimed, asked for by spec/conformance/run.py, and that it sees faults."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from conformance.expected_answers import (
    MUST_NOTICE,
    VECTORS,
    answers,
    content,
    digest_of,
    frozen,
    recorded,
)
from node import node

from gstream.errors import GstreamError

ROOT = Path(__file__).parents[2]
CONFORMANCE = ROOT / "spec" / "conformance"
REFERENCE = [sys.executable, CONFORMANCE / "reference_reader.py"]
CHECK = [sys.executable, ROOT / "tests" / "conformance" / "answer_check.py"]
EXPECTED = json.loads((VECTORS / "expected.json").read_text())
GOOD = [name for name, answer in EXPECTED.items() if answer["valid"]]


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, CONFORMANCE / "run.py", *arguments]
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)


def pretend(tmp_path: Path, body: str) -> list[object]:
    """A program that answers each path by `body`, which sees `path` and `expected`."""
    program = tmp_path / "program.py"
    program.write_text(
        "import json, sys, pathlib, time\n"
        f"table = json.load(open({str(VECTORS / 'expected.json')!r}))\n"
        "for line in sys.stdin:\n"
        "    path = pathlib.Path(line.rstrip())\n"
        "    expected = table[f'{path.parent.name}/{path.name}']\n"
        f"    {body}\n"
        "    print(json.dumps(expected), flush=True)\n"
    )
    return [sys.executable, program]


def test_the_reference_decoder_is_a_reader():
    ran = run("--level", "reader", *REFERENCE)
    assert (ran.returncode, ran.stdout) == (
        0, f"reader: {len(EXPECTED)} of {len(EXPECTED)} vectors answered as expected\n",
    )  # fmt: skip


def test_check_is_a_validator():
    ran = run("--level", "validator", *CHECK)
    assert ran.returncode == 0, ran.stdout


def test_the_javascript_reader_is_a_reader():
    ran = run("--level", "reader", node(), ROOT / "tools" / "reader_js" / "conformance.mjs")
    assert ran.returncode == 0, ran.stdout + ran.stderr


def test_the_streaming_reader_is_a_reader_of_block_files():
    program = sys.executable, "-m", "gstream_tools.reader_py.conformance"
    ran = run("--level", "reader", "--format", "gsb", *program)
    assert ran.returncode == 0, ran.stdout + ran.stderr


def test_no_vector_that_was_ever_added_has_changed_or_gone():
    assert recorded() == {name: digest_of(name) for name in frozen()}


def test_the_expected_answers_are_what_is_found_and_read_today():
    assert (VECTORS / "expected.json").read_text() == answers()


def test_every_good_vector_is_to_be_read_and_has_a_content():
    for name, answer in EXPECTED.items():
        if name.startswith("good/"):
            assert (answer["valid"], answer["reader"]) == (True, "read")
            assert "content" in answer


def test_every_rule_that_a_reader_must_notice_has_a_vector_that_it_must_refuse():
    refused = {code for e in EXPECTED.values() if e["reader"] == "refuse" for code in e["codes"]}
    assert refused >= MUST_NOTICE


@pytest.mark.parametrize("name", [n for n, e in EXPECTED.items() if e["reader"] == "refuse"])
def test_gstream_refuses_what_a_reader_must(name):
    with pytest.raises(GstreamError):
        content(VECTORS / name)


@pytest.mark.parametrize("name", GOOD)
def test_the_reference_decoder_and_gstream_read_the_same(name):
    ran = subprocess.run(
        [sys.executable, ROOT / "spec" / "reference_decoder.py", VECTORS / name],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    levels = json.loads(ran.stdout)["levels"]
    assert levels == content(VECTORS / name)["levels"]


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("expected['valid'] = True", "read, and breaks what a reader must notice: GSB-0306"),
        ("expected['valid'] = False", "refused by [], and is valid"),
        ("expected['content'] = {}", "content of levels [], expected [0]"),
        (
            'expected = json.loads(json.dumps(expected).replace(\'"mask": "\', \'"mask": "x\'))',
            "level 0, column mask: x",
        ),
        (
            "expected = json.loads(json.dumps(expected).replace('\"voxels\": ', '\"voxels\": 9'))",
            "level 0: voxels 9",
        ),
        ("sys.exit(3)", "the program ended with status 3"),
        ("expected = 'hello'", 'not an answer {"valid": ..., "codes": [...]}: "hello"'),
        ("time.sleep(9 if 'GSB-0101' in path.name else 0)", "no answer within 1.0 s"),
    ],
)
def test_a_wrong_answer_of_a_reader_is_named(body, fault, tmp_path):
    ran = run("--seconds", "1", *pretend(tmp_path, body))
    assert ran.returncode == 1
    assert fault in ran.stdout


def test_a_validator_must_give_exactly_the_codes(tmp_path):
    assert run("--level", "validator", *pretend(tmp_path, "pass")).returncode == 0
    ran = run("--level", "validator", *pretend(tmp_path, "expected['codes'].append('GSB-0101')"))
    assert "FAIL good/blocks-smallest.gsb: codes ['GSB-0101'], expected []" in ran.stdout
