"""The readers that share no code with gstream, on the bombs and on mutants."""

import json
import runpy
import subprocess
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple

import pytest
from node import node

from fuzz.bombs import BOMBS
from fuzz.mutants import mutant
from fuzz.readers import deadline, limited_memory, verdict
from gstream.check import RULES as BLOCK_RULES
from gstream.formats.findings import READER
from gstream.formats.stream_check import RULES as STREAM_RULES
from gstream_tools.reader_py.conformance import answer as answer_of

ROOT = Path(__file__).parents[2]
MUTANTS = range(1_000_000, 1_000_500)
PEAK = 256 << 20  # bytes that a reader may use in all, beside four times the file
READER_RULES = {rule.id for rule in (*BLOCK_RULES, *STREAM_RULES) if rule.noticed_by == READER}


class Hostile(NamedTuple):
    name: str
    path: Path
    checked: str  # what `gstream check` says


@pytest.fixture(scope="module")
def hostile(tmp_path_factory) -> list[Hostile]:
    """Every bomb and some mutants."""
    folder = tmp_path_factory.mktemp("hostile")
    made = [(bomb.name, bomb.make()) for bomb in BOMBS]
    made += [(one.name, one.data) for one in map(mutant, MUTANTS)]
    files = []
    for i, (name, data) in enumerate(made):
        path = folder / f"{i}.{'gst' if data[1:4] == b'GST' else 'gsb'}"
        path.write_bytes(data)
        files.append(Hostile(name, path, verdict(path)))
    return files


@pytest.fixture(scope="module")
def javascript(hostile) -> list[dict]:
    """The answers of the JavaScript reader, all of one process."""
    ran = subprocess.run(
        [node(), ROOT / "tools" / "reader_js" / "conformance.mjs"],
        input="".join(f"{file.path}\n" for file in hostile),
        capture_output=True,
        text=True,
        check=True,
    )
    return [json.loads(line) for line in ran.stdout.splitlines()]


@pytest.fixture(scope="module")
def reference(hostile) -> list[object]:
    """What the reference decoder gives: a summary as JSON has it, or the exception it raises."""
    summary = runpy.run_path(str(ROOT / "spec" / "reference_decoder.py"))["summary"]
    answers = []
    for file in hostile:
        data = file.path.read_bytes()
        with deadline() as begin, limited_memory(PEAK + 4 * len(data)):
            begin()
            try:
                found = json.dumps(summary(data), default=blake2b.hexdigest)
                answers.append(json.loads(found))
            except Exception as error:
                answers.append(error)
    return answers


def test_the_javascript_reader_answers_every_hostile_file(hostile, javascript):
    assert len(javascript) == len(hostile)


def test_the_javascript_reader_reads_what_check_finds_valid_and_refuses_what_a_reader_must(
    hostile, javascript
):
    for file, answer in zip(hostile, javascript, strict=True):
        if file.checked == "valid":
            assert answer["valid"], (file, answer)
        if READER_RULES & set(file.checked.split()):
            assert not answer["valid"], file


def test_the_reference_decoder_ends_in_bounded_time_and_memory(hostile, reference):
    harm = (MemoryError, RecursionError, TimeoutError)
    assert [f for f, said in zip(hostile, reference, strict=True) if isinstance(said, harm)] == []


def test_the_reference_decoder_raises_no_other_error_than_value_error(hostile, reference):
    wrong = [said for said in reference if not isinstance(said, dict | ValueError)]
    assert wrong == []


def test_the_reference_decoder_refuses_what_a_reader_must(hostile, reference):
    for file, said in zip(hostile, reference, strict=True):
        if READER_RULES & set(file.checked.split()):
            assert not isinstance(said, dict), file


def test_the_reference_decoder_reads_what_check_finds_valid(hostile, reference):
    for file, said in zip(hostile, reference, strict=True):
        if file.checked == "valid":
            assert isinstance(said, dict), (file, said)


@pytest.fixture(scope="module")
def streaming(hostile) -> list[tuple[Hostile, object]]:
    """The block files, and what the streaming reader answers, or the exception it raises."""
    answers = []
    for file in hostile:
        if file.path.suffix == ".gsb":
            with deadline() as begin, limited_memory(PEAK + 4 * file.path.stat().st_size):
                begin()
                try:
                    answers.append((file, answer_of(str(file.path))))
                except Exception as error:
                    answers.append((file, error))
    return answers


def test_the_streaming_reader_ends_in_bounded_time_and_memory_and_in_its_two_errors(streaming):
    assert [(file, said) for file, said in streaming if not isinstance(said, dict)] == []


def test_the_streaming_reader_reads_what_check_finds_valid_and_refuses_what_a_reader_must(
    streaming,
):
    for file, said in streaming:
        if file.checked == "valid":
            assert said["valid"], (file, said)
        if READER_RULES & set(file.checked.split()):
            assert not said["valid"], file


def test_what_the_streaming_reader_reads_the_reference_decoder_reads_alike(
    streaming, hostile, reference
):
    decoded = dict(zip(hostile, reference, strict=True))
    both = [(f, said) for f, said in streaming if said["valid"] and isinstance(decoded[f], dict)]
    assert len(both) > len(streaming) // 10
    for file, said in both:
        assert unkeyed(said["content"]) == unkeyed(decoded[file]), file


def unkeyed(content: dict) -> list[dict]:
    """The levels without the digest of block keys, whose name one bomb gives to a column."""
    return [
        {**level, "columns": {k: v for k, v in level["columns"].items() if k != "key"}}
        for level in content["levels"]
    ]


def test_what_both_read_they_read_alike(hostile, javascript, reference):
    for file, answer, said in zip(hostile, javascript, reference, strict=True):
        if answer["valid"] and isinstance(said, dict):
            assert unkeyed(answer["content"]) == unkeyed(said), file
