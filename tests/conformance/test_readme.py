"""What README.md and the pages of spec/ promise whoever writes a reader."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SECTION = (
    (ROOT / "README.md").read_text().split("\n## Write your own reader\n")[1].split("\n## ")[0]
)
SMALLEST = (ROOT / "spec" / "vectors" / "good" / "blocks-smallest.gsb").read_bytes()
MAGIC = ROOT / "spec" / "gstream.magic"
PAGES = [
    ROOT / "README.md",
    ROOT / "tools" / "reader_js" / "README.md",
    ROOT / "tools" / "reader_py" / "README.md",
    ROOT / "tools" / "view_gl" / "README.md",
    *sorted((ROOT / "spec").rglob("*.md")),
]


def test_every_byte_that_the_ten_steps_quote_stands_in_the_vector_at_that_place():
    rows = re.findall(r"^\| (\d*) \| (\d+)–(\d+) \| `([0-9a-f ]+)` \|", SECTION, re.M)
    assert [int(step) for step, *_ in rows if step] == list(range(1, 11))
    for _, first, last, quoted in rows:
        assert SMALLEST[int(first) : int(last) + 1] == bytes.fromhex(quoted), (first, last)


def test_the_command_of_the_section_prints_what_the_section_says():
    command, said = re.search(r"```console\n\$ python (.+)\n(.+)\n```", SECTION).groups()
    words = [sys.executable if word == "python" else word for word in command.split()]
    ran = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True)
    assert re.sub(r"\d+ of \d+", "n of n", ran.stdout.strip()) == re.sub(
        r"\d+ of \d+", "n of n", said
    )
    assert ran.returncode == 0


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_of_a_page_leads_to_a_file_and_a_heading(page):
    prose = re.sub(r"```.*?```", "", page.read_text(), flags=re.S)
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", prose):
        name, _, anchor = target.partition("#")
        linked = (page.parent / name).resolve() if name else page
        assert linked.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.+)$", linked.read_text(), re.M)
            anchors = [re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-") for text in headings]
            assert anchor in anchors, target


def test_the_rules_for_file_are_those_of_the_pages():
    rules = MAGIC.read_text().splitlines()
    for page in ("blockfile.md", "stream.md"):
        text = (ROOT / "spec" / page).read_text()
        printed = re.search(r"^`(0 string .+)`", text, re.M)[1]
        media_type = re.search(r"media type `([\w/.]+)`", text)[1]
        assert rules[rules.index(printed) + 1] == f"!:mime {media_type}"


@pytest.mark.skipif(not shutil.which("file"), reason="file(1) is not installed")
def test_file_knows_every_vector_by_the_rules():
    vectors = sorted(ROOT.glob("spec/vectors/good/*.gs[bt]"))
    ran = subprocess.run(
        ["file", "-b", "--mime-type", "-m", MAGIC, *vectors], capture_output=True, text=True
    )
    kinds = {".gsb": "application/vnd.gstream.blocks", ".gst": "application/vnd.gstream.geometry"}
    assert ran.stdout.split() == [kinds[path.suffix] for path in vectors]
