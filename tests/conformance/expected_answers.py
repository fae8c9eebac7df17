"""spec/vectors/expected.json: what programs must answer of each vector.

`make spec` writes it from what gstream finds and reads; no test does.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gstream.check import RULES as BLOCK_FILE_RULES
from gstream.check import check_file
from gstream.digests import block_file_content, stream_content
from gstream.errors import GstreamError, UnsupportedError
from gstream.formats.findings import ERROR, READER
from gstream.formats.stream_check import RULES as STREAM_RULES

VECTORS = Path(__file__).parents[2] / "spec" / "vectors"
MUST_NOTICE = {
    rule.id
    for rule in (*BLOCK_FILE_RULES, *STREAM_RULES)
    if rule.noticed_by == READER and rule.severity == ERROR
}


def expected(path: Path) -> dict[str, Any]:
    """Validity, codes, what a reader does (read, refuse, may refuse), content if it is readable."""
    try:
        report = check_file(path)
    except UnsupportedError:
        return {"valid": False, "codes": ["unsupported"], "reader": "refuse"}
    answer: dict[str, Any] = {"valid": report.ok, "codes": sorted(report.counts)}
    if MUST_NOTICE & report.counts.keys():
        return {**answer, "reader": "refuse"}
    answer["reader"] = "read" if report.ok else "may refuse"
    try:
        return {**answer, "content": content(path)}
    except GstreamError:
        return answer


def content(path: Path) -> Mapping[str, Any]:
    """Counts and digests of a vector, read with gstream."""
    return (block_file_content if path.suffix == ".gsb" else stream_content)(path)


def answers() -> str:
    """The whole file."""
    paths = sorted(path for path in VECTORS.glob("*/*.gs[bt]"))
    table = {path.relative_to(VECTORS).as_posix(): expected(path) for path in paths}
    return json.dumps(table, indent=1, sort_keys=True) + "\n"


if __name__ == "__main__":
    (VECTORS / "expected.json").write_text(answers())
