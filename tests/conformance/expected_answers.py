"""What programs must answer of each vector, expected.json, and the vectors' own bytes, SHA256SUMS.

`make spec` writes the one from what gstream finds and reads, and adds new vectors to the other; no
test does.
"""

import json
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from gstream.check import RULES as BLOCK_FILE_RULES
from gstream.check import check_file
from gstream.digests import block_file_content, stream_content
from gstream.errors import GstreamError, UnsupportedError
from gstream.formats.findings import ERROR, READER
from gstream.formats.stream_check import RULES as STREAM_RULES

VECTORS = Path(__file__).parents[2] / "spec" / "vectors"
SUMS = VECTORS / "SHA256SUMS"
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
    table = {name: expected(VECTORS / name) for name in names()}
    return json.dumps(table, indent=1, sort_keys=True) + "\n"


def names() -> list[str]:
    """Every vector there is, as its path below VECTORS."""
    return sorted(path.relative_to(VECTORS).as_posix() for path in VECTORS.glob("*/*.gs[bt]"))


def frozen() -> list[str]:
    """The vectors and the scenes."""
    scenes = (path.relative_to(VECTORS).as_posix() for path in VECTORS.glob("scenes/*"))
    return sorted([*names(), *scenes])


def recorded() -> dict[str, str]:
    """The digest of each vector that was ever added, as `sha256sum` writes it."""
    return {name: digest for digest, name in map(str.split, SUMS.read_text().splitlines())}


def digest_of(name: str) -> str:
    """The digest of a vector's bytes today."""
    return sha256((VECTORS / name).read_bytes()).hexdigest()


if __name__ == "__main__":
    (VECTORS / "expected.json").write_text(answers())
    digests = {name: digest_of(name) for name in frozen()} | recorded()
    SUMS.write_text("".join(f"{digests[name]}  {name}\n" for name in sorted(digests)))
