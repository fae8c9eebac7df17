"""spec/*-metadata.schema.json: they take what files hold, and refuse nothing that check takes."""

import json
from pathlib import Path

import pytest
from conformance.test_check_report import faults
from damaged_block_files import with_ledger

import gstream
from gstream.blockcheck import iter_findings
from gstream.errors import CorruptFileError
from gstream.formats.blockmeta import parse_metadata
from gstream.formats.stream import StreamReader

SPEC = Path(__file__).parents[2] / "spec"
GOOD = SPEC / "vectors" / "good"
BLOCKS, STREAM = (
    json.loads((SPEC / f"{name}-metadata.schema.json").read_text())
    for name in ("blockfile", "stream")
)


@pytest.mark.parametrize("path", sorted(GOOD.glob("*.gs[bt]")), ids=lambda path: path.stem)
def test_the_metadata_of_every_good_vector_is_as_its_schema_has_it(path):
    if path.suffix == ".gst":
        assert faults(dict(StreamReader(path).metadata), STREAM) == []
        return
    with gstream.open(path) as file:
        assert faults(dict(file.metadata), BLOCKS) == []


@pytest.mark.parametrize("triangles", [-1, 1.5, True, "1", None])
def test_a_counter_that_the_schema_refuses_is_refused_by_check(triangles):
    assert faults({"ledger": {"voxels": [1], "triangles": triangles}}, BLOCKS)
    findings = iter_findings(with_ledger(triangles=triangles))
    assert "GSB-0603" in {finding.rule for finding in findings}


@pytest.mark.parametrize("text", ['{"ledger":{},"up":5}', '{"ledger":[]}', '{"units":"m"}'])
def test_metadata_that_the_schema_refuses_is_refused_by_readers(text):
    assert faults(json.loads(text), BLOCKS)
    with pytest.raises(CorruptFileError, match="GSB-0205"):
        parse_metadata(text.encode(), 0, "")
