"""spec/rules.md, made from the rule tables of the checker; `make spec` writes it, no test does."""

from collections.abc import Sequence
from pathlib import Path

from gstream.check import RULES as BLOCK_FILE_RULES
from gstream.formats.findings import Rule
from gstream.formats.stream_check import RULES as STREAM_RULES

PAGE = Path(__file__).parents[2] / "spec" / "rules.md"
INTRO = """# The rules of both formats

One row per rule: its id, which is never used for anything else; its severity; who must notice
that a file breaks it; what it demands; and the section that explains it.

* **error**: a file that breaks the rule is invalid. **note**: the file is valid; a validator
  says so.
* **reader**: whoever decodes a file must refuse it when what it reads breaks the rule; for
  GSB-0412 and GST-0119, it must say what it cannot read, and may read the rest. This is what
  reading needs to be safe and right: nothing is misread, missed or read out of bounds.
* **validator**: only a validator, which checks every rule, must notice. A reader may refuse the
  file or read it; it does not recompute levels of detail, bounds or sums, and metadata is not
  its concern. But who hands out metadata must not hand out what breaks GSB-0205 or GST-0007, and
  who writes voxels into an array of their level's size must mind GSB-0502.

How to claim a level is in [conformance/README.md](conformance/README.md); `vectors/bad` has at
least one file for every rule, named after it.
"""
FORMATS = (
    ("Block file", "blockfile.md", BLOCK_FILE_RULES),
    ("Geometry stream", "stream.md", STREAM_RULES),
)


def page() -> str:
    """The whole page."""
    return INTRO + "".join(_table(*row) for row in FORMATS)


def _table(title: str, spec: str, rules: Sequence[Rule]) -> str:
    rows = "".join(
        f"| {r.id} | {r.severity} | {r.noticed_by} | {r.sentence} | {r.section} |\n" for r in rules
    )
    head = "| id | severity | noticed by | rule | section |\n|---|---|---|---|---|\n"
    return f"\n## {title} ([{spec}]({spec}))\n\n{head}{rows}"


if __name__ == "__main__":
    PAGE.write_text(page())
