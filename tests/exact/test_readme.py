"""The table of hard cases: it is whole, and every test that it names exists."""

import re
from pathlib import Path

FOLDER = Path(__file__).parent
README = (FOLDER / "README.md").read_text()
ROWS = {"H-GS": 8, "H-VX": 16, "H-IS": 5, "H-AT": 5, "H-SM": 7}


def test_every_hard_case_has_its_row_and_each_row_a_test_or_a_reason():
    rows = re.findall(r"^\| (H-..-\d+) \| .+ \| (.+) \|$", README, re.MULTILINE)
    wanted = [f"{kind}-{n + 1}" for kind, count in ROWS.items() for n in range(count)]
    assert [row for row, _ in rows] == wanted
    assert all("`test_" in held or held.startswith("Not covered: ") for _, held in rows)


def test_every_test_that_the_table_names_exists():
    texts = [path.read_text() for path in FOLDER.parent.rglob("test_*.py")]
    known = {name for text in texts for name in re.findall(r"^def (test_\w+)", text, re.MULTILINE)}
    named = set(re.findall(r"`(test_\w+)`", README))
    assert len(named) > 50
    assert named <= known, named - known
