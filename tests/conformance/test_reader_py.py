"""tools/reader_py refuses a bad vector by a rule that the vector breaks."""

import json
from pathlib import Path

import pytest
from damaged_block_files import patch

from gstream_tools.reader_py.conformance import answer

VECTORS = Path(__file__).parents[2] / "spec" / "vectors"
EXPECTED = json.loads((VECTORS / "expected.json").read_text())
REFUSED = [
    name
    for name, expected in EXPECTED.items()
    if expected["reader"] == "refuse" and name.endswith(".gsb")
]


@pytest.mark.parametrize("name", REFUSED)
def test_a_vector_is_refused_by_a_rule_that_it_breaks(name):
    said = answer(str(VECTORS / name))
    assert not said["valid"]
    assert set(said["codes"]) <= set(EXPECTED[name]["codes"])


def test_a_block_of_an_unknown_codec_hides_no_damage_of_another(tmp_path):
    path = tmp_path / "a.gsb"
    path.write_bytes(patch().entry(1, "codec", 9, "occupancy").sealed())
    columns = [level["columns"] for level in answer(str(path))["content"]["levels"]]
    assert [column["occupancy"] is None for column in columns] == [True, False]
    damaged = patch().entry(1, "codec", 9, "occupancy").payload(2, "occupancy", b"\0")
    path.write_bytes(damaged.sealed())
    assert answer(str(path))["codes"] == ["GSB-0407"]
