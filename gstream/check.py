"""`gstream check`: does a file of ours keep every rule of its spec?

Here: the rules of the block file, the report, and the choice of checker by magic. The rules of the
geometry stream are in formats/stream_check.py; the checking of blocks is in gstream/blockcheck.py
and gstream/contentcheck.py.
"""

import os
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from gstream import blockcheck
from gstream.contentcheck import broken
from gstream.errors import CorruptFileError, UsageError
from gstream.formats import stream_check
from gstream.formats.findings import ERROR, NOTE, Finding
from gstream.formats.framing import BLOCK_MAGIC, STREAM_MAGIC
from gstream.source import is_url

Progress = Callable[[int, int], None]

KEPT: Final = 20  # findings of one rule that a report keeps; all are counted


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule of spec/blockfile.md: its id, what breaking it means, where it is explained."""

    id: str
    severity: str
    sentence: str
    section: str  # of the spec


def _rules(section: str, **sentences: str) -> tuple[Rule, ...]:
    notes = ("GSB-0412", "GSB-0508")
    names = {f"GSB-{name[1:]}": sentence for name, sentence in sentences.items()}
    return tuple(
        Rule(id_, NOTE if id_ in notes else ERROR, sentence, section)
        for id_, sentence in names.items()
    )


RULES: Final = (
    *_rules(
        "3",
        _0101="The file begins with the 12 bytes of the magic.",
        _0102="The file has the length its head states and ends in a tail that repeats the head.",
        _0103="The head matches its CRC.",
        _0104="Reserved bytes and bits of the head are zero.",
        _0105="Every number and code of the head is within its limits.",
        _0106="The grid matrix is finite and invertible; the source box is finite, low <= high.",
    ),
    *_rules(
        "4",
        _0201="The head's four sections come first, in order, without gaps; others end the body.",
        _0202="A section behind the body matches its CRC.",
        _0203="The level table adds up to the directory and repeats the block edge.",
        _0204="Columns have ascending ids from 1 and distinct names; known ones have their shape.",
        _0205="The metadata is a UTF-8 JSON object of at most 12 KiB with a ledger.",
        _0206="Page records hold 1 to 1024 rows each, add up, and point into the body.",
        _0207="A table page matches its record: length, CRC and first key.",
    ),
    *_rules(
        "5",
        _0301="A page has the length and the CRC that its page record states.",
        _0302="A page begins with the level and key that its page record states.",
        _0303="Entries ascend strictly: levels from coarse to fine, then keys.",
        _0304="A sibling group is not split by two pages.",
        _0305="An entry's key, level, state, count, children and bounds are possible.",
        _0306="A child mask names exactly the children that exist; above level 0 there is one.",
        _0307="Every block below the last level has a parent.",
        _0308="An empty entry has no voxels, bounds or columns.",
        _0309="Reserved bytes of an entry are zero.",
        _0310="The opening run ends where the spec says.",
        _0311="A column record is possible: codec, lengths, place in the body.",
        _0312="Pages and payloads stand in the order of the spec, without gaps or overlaps.",
    ),
    *_rules(
        "7",
        _0401="Stored bytes unpack to exactly the filtered length.",
        _0402="The raw length is the one that the voxel count gives.",
        _0403="A constant stores no bytes and fits its components.",
        _0404="The filter is one that the column may have.",
        _0405="Every value is below 2^bits.",
        _0406="Bits behind the last voxel of a bit plane are zero.",
        _0407="Every octree mask has a child.",
        _0408="The octree ends with its bytes and has as many leaves as the entry has voxels.",
        _0409="A block has at least one voxel and at most its volume.",
        _0410="A value means something: mask 1 to 63, normal code canonical, weight not 0.",
        _0411="Stored bytes match their CRC.",
        _0412="A column of an unknown kind, codec or filter is not checked.",
    ),
    *_rules(
        "8",
        _0501="The bounds of an entry are those of its voxels.",
        _0502="Every voxel is within the resolution of its level.",
        _0503="A voxel of a coarser level exists exactly where a child voxel exists.",
        _0504="The face mask of a coarser voxel is the OR of its children's.",
        _0505="The normal of a coarser voxel is what the LOD rule makes of its children.",
        _0506="The colour of a coarser voxel is what the LOD rule makes of its children.",
        _0507="The weight of a coarser voxel is what the LOD rule makes of its children.",
        _0508="Without the weights that it was made with, a level's attributes are not checkable.",
        _0509="The content id is the hash of settings and content.",
    ),
    *_rules(
        "9",
        _0601="Triangles = non_finite + outside + assigned + unassigned.",
        _0602="Voxels per level in the ledger are those of the level table.",
        _0603="Counters are integers from 0; a part is not larger than its whole.",
    ),
)


@dataclass(slots=True)
class Report:
    """What a check found. `findings` keeps the first KEPT of each rule, `counts` has them all."""

    path: str
    format: str  # block file | geometry stream
    quick: bool
    findings: list[Finding] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)  # rule -> findings
    errors: int = 0

    @property
    def ok(self) -> bool:
        """No rule is broken; notes and warnings do not count."""
        return self.errors == 0

    def add(self, finding: Finding) -> None:
        """Count a finding, and keep it if it is among the first of its rule."""
        self.counts[finding.rule] += 1
        self.errors += finding.severity == ERROR
        if self.counts[finding.rule] <= KEPT:
            self.findings.append(finding)

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON has it."""
        return {
            "path": self.path,
            "format": self.format,
            "quick": self.quick,
            "ok": self.ok,
            "errors": self.errors,
            "counts": dict(sorted(self.counts.items())),
            "findings": [
                {"rule": f.rule, "severity": f.severity, "place": f.place, "said": f.said}
                for f in self.findings
            ],
        }


def check_file(
    path: str | os.PathLike[str], quick: bool = False, progress: Progress | None = None
) -> Report:
    """Check a block file or a geometry stream, whichever the magic says; of URLs, block files.

    quick : structure and indexes only, no payloads
    progress : called with (done, all), in blocks
    errors : UsageError for a path that cannot be read; CorruptFileError for neither kind of file;
             UnsupportedError for a newer version. A broken rule is a finding, not an error.
    """
    name = os.fspath(path)
    magic = BLOCK_MAGIC if is_url(name) else _magic(name)
    if magic == STREAM_MAGIC:
        report = Report(name, "geometry stream", quick)
        findings: Iterator[Finding] = map(broken, stream_check.iter_findings(name, quick))
    elif magic == BLOCK_MAGIC or name.endswith(".gsb"):
        report = Report(name, "block file", quick)
        findings = blockcheck.iter_findings(name, quick, progress)
    else:
        raise CorruptFileError("GSB-0101", name, 0, "neither a block file nor a geometry stream")
    try:
        for finding in findings:
            report.add(finding)
    except CorruptFileError as error:
        report.add(broken(error))
    return report


def _magic(path: str) -> bytes:
    try:
        with open(path, "rb") as file:
            return file.read(len(BLOCK_MAGIC))
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}", "give a .gsb or .gst file") from error
