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
from gstream.errors import CorruptFileError, UsageError
from gstream.formats import stream_check
from gstream.formats.arithmetic import Choice, plain
from gstream.formats.findings import ERROR, NOTE, READER, VALIDATOR, Finding, Rule, broken
from gstream.formats.framing import BLOCK_MAGIC, STREAM_MAGIC
from gstream.source import is_url

Progress = Callable[[int, int], None]

KEPT: Final = 20  # findings of one rule that a report keeps; all are counted


RULES: Final = (
    Rule("GSB-0101", ERROR, READER, "3.1",
         "The file begins with the 12 bytes of the magic."),
    Rule("GSB-0102", ERROR, READER, "3.2",
         "The file has the length its head states and ends in a tail that repeats the head."),
    Rule("GSB-0103", ERROR, READER, "3.1",
         "The head matches its CRC."),
    Rule("GSB-0104", ERROR, VALIDATOR, "1",
         "Reserved bytes and bits of the head are zero."),
    Rule("GSB-0105", ERROR, READER, "3.1",
         "Every number and code of the head is within its limits."),
    Rule("GSB-0106", ERROR, VALIDATOR, "3.1",
         "The grid matrix is finite and invertible; the source box is finite, low <= high."),
    Rule("GSB-0201", ERROR, VALIDATOR, "4",
         "The head's four sections come first, in order, without gaps; others end the body."),
    Rule("GSB-0202", ERROR, VALIDATOR, "4",
         "A section behind the body matches its CRC."),
    Rule("GSB-0203", ERROR, VALIDATOR, "4",
         "The level table adds up to the directory and repeats the block edge."),
    Rule("GSB-0204", ERROR, VALIDATOR, "4",
         "Columns have ascending ids from 1 and distinct names; known ones have their shape."),
    Rule("GSB-0205", ERROR, VALIDATOR, "9",
         "The metadata is a UTF-8 JSON object of at most 12 KiB with a ledger."),
    Rule("GSB-0206", ERROR, READER, "4",
         "Page records hold 1 to 1024 rows each, add up, and point into the body."),
    Rule("GSB-0207", ERROR, READER, "5.1",
         "A table page matches its record: length, CRC and first key."),
    Rule("GSB-0301", ERROR, READER, "5.1",
         "A page has the length and the CRC that its page record states."),
    Rule("GSB-0302", ERROR, VALIDATOR, "5.1",
         "A page begins with the level and key that its page record states."),
    Rule("GSB-0303", ERROR, READER, "5.1",
         "Entries ascend strictly: levels from coarse to fine, then keys."),
    Rule("GSB-0304", ERROR, VALIDATOR, "5.1",
         "A sibling group is not split by two pages."),
    Rule("GSB-0305", ERROR, VALIDATOR, "5.2",
         "An entry's key, level, state, count, children and bounds are possible."),
    Rule("GSB-0306", ERROR, READER, "5.2",
         "A child mask names exactly the children that exist; above level 0 there is one."),
    Rule("GSB-0307", ERROR, READER, "5.2",
         "Every block below the last level has a parent."),
    Rule("GSB-0308", ERROR, VALIDATOR, "5.2",
         "An empty entry has no voxels, bounds or columns."),
    Rule("GSB-0309", ERROR, VALIDATOR, "1",
         "Reserved bytes of an entry are zero."),
    Rule("GSB-0310", ERROR, VALIDATOR, "5.4",
         "The opening run ends where the spec says."),
    Rule("GSB-0311", ERROR, VALIDATOR, "5.3",
         "A column record is possible: codec, lengths, place in the body."),
    Rule("GSB-0312", ERROR, VALIDATOR, "6",
         "Pages and payloads stand in the order of the spec, without gaps or overlaps."),
    Rule("GSB-0401", ERROR, READER, "7.1",
         "Stored bytes unpack to exactly the filtered length."),
    Rule("GSB-0402", ERROR, READER, "7.1",
         "The raw length is the one that the voxel count gives, or whole items of a piece column."),
    Rule("GSB-0403", ERROR, READER, "7.1",
         "A constant stores no bytes and fits its components."),
    Rule("GSB-0404", ERROR, READER, "7.2",
         "The filter is one that the column may have."),
    Rule("GSB-0405", ERROR, READER, "7.2",
         "Every value is below 2^bits."),
    Rule("GSB-0406", ERROR, VALIDATOR, "7.2",
         "Bits behind the last voxel of a bit plane are zero."),
    Rule("GSB-0407", ERROR, READER, "7.3",
         "Every octree mask has a child."),
    Rule("GSB-0408", ERROR, READER, "7.3",
         "The octree ends with its bytes and has as many leaves as the entry has voxels."),
    Rule("GSB-0409", ERROR, READER, "5.2",
         "A block has at least one voxel and at most its volume."),
    Rule("GSB-0410", ERROR, VALIDATOR, "8.3",
         "A value means something: mask 1 to 63, normal code canonical, weight not 0."),
    Rule("GSB-0411", ERROR, READER, "7.1",
         "Stored bytes match their CRC."),
    Rule("GSB-0412", NOTE, READER, "7",
         "A column of an unknown kind, codec or filter is not checked."),
    Rule("GSB-0413", ERROR, READER, "7.4",
         "Vertex numbers of source triangles are below the number of vertices."),
    Rule("GSB-0414", ERROR, VALIDATOR, "7.4",
         "Source triangles are a finest block's: vertices inside, different, all used."),
    Rule("GSB-0501", ERROR, VALIDATOR, "5.2",
         "The bounds of an entry are those of its voxels."),
    Rule("GSB-0502", ERROR, VALIDATOR, "8.1",
         "Every voxel is within the resolution of its level."),
    Rule("GSB-0503", ERROR, VALIDATOR, "8.6",
         "A voxel of a coarser level exists exactly where a child voxel exists."),
    Rule("GSB-0504", ERROR, VALIDATOR, "8.6",
         "The face mask of a coarser voxel is the OR of its children's."),
    Rule("GSB-0505", ERROR, VALIDATOR, "8.6",
         "The normal of a coarser voxel is what the LOD rule makes of its children."),
    Rule("GSB-0506", ERROR, VALIDATOR, "8.6",
         "The colour of a coarser voxel is what the LOD rule makes of its children."),
    Rule("GSB-0507", ERROR, VALIDATOR, "8.6",
         "The weight of a coarser voxel is what the LOD rule makes of its children."),
    Rule("GSB-0508", NOTE, VALIDATOR, "8.6",
         "Without the weights that it was made with, a level's attributes are not checkable."),
    Rule("GSB-0509", ERROR, VALIDATOR, "8.7",
         "The content id is the hash of settings and content."),
    Rule("GSB-0601", ERROR, VALIDATOR, "9",
         "Triangles = non_finite + outside + assigned + unassigned."),
    Rule("GSB-0602", ERROR, VALIDATOR, "9",
         "Voxels per level in the ledger are those of the level table."),
    Rule("GSB-0603", ERROR, VALIDATOR, "9",
         "Counters are integers from 0; a part is not larger than its whole."),
    Rule("GSB-0604", ERROR, VALIDATOR, "9",
         "The pieces in the ledger are as many as the source triangles that are stored."),
)  # fmt: skip


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
    path: str | os.PathLike[str],
    quick: bool = False,
    progress: Progress | None = None,
    choose: Choice = plain,
) -> Report:
    """Check a block file or a geometry stream, whichever the magic says; of URLs, block files.

    quick : structure and indexes only, no payloads
    progress : called with (done, all), in blocks
    choose : what decodes and recomputes levels of block files: NumPy, or gstream.compiled's
    errors : UsageError for a path that cannot be read; CorruptFileError for neither kind of file;
             UnsupportedError for a newer version. A broken rule is a finding, not an error.
    """
    name = os.fspath(path)
    magic = BLOCK_MAGIC if is_url(name) else _magic(name)
    if magic == STREAM_MAGIC or (magic != BLOCK_MAGIC and name.endswith(".gst")):
        report = Report(name, "geometry stream", quick)
        findings: Iterator[Finding] = stream_check.iter_findings(name, quick)
    elif magic == BLOCK_MAGIC or name.endswith(".gsb"):
        report = Report(name, "block file", quick)
        findings = blockcheck.iter_findings(name, quick, progress, choose)
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
