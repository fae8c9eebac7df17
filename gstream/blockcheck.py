"""Checking the structure of a block file: head, tail, sections, ledger and directory.

The rules' ids and sentences are in gstream/check.py, payloads are gstream/contentcheck.py's.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final
from zlib import crc32 as running_crc

import numpy as np
from numpy.typing import NDArray

from gstream.contentcheck import Content, Progress
from gstream.errors import CorruptFileError
from gstream.formats.arithmetic import Choice, plain
from gstream.formats.blockhead import check_tail
from gstream.formats.directory import (
    TAIL_BYTES,
    Rows,
    group_starts,
    opening_bytes,
    payload_offsets,
    stacked,
)
from gstream.formats.findings import ERROR, Finding, broken
from gstream.formats.pages import rank
from gstream.read import BlockFile, open_block_file
from gstream.source import Source

PIECE: Final = 1 << 20  # bytes read at once of a section that is only summed up
LEDGER_PARTS: Final = ("non_finite", "outside", "assigned", "unassigned")


def iter_findings(
    path: Source,
    quick: bool = False,
    progress: Progress | None = None,
    choose: Choice = plain,
) -> Iterator[Finding]:
    """Every finding in a block file, in the order of the file; none means valid.

    path : also the file's bytes, or a range reader
    quick : stop after the head, the tail and the directory; payloads are not read
    choose : what decodes and recomputes levels: NumPy, or gstream.compiled's
    errors : UsageError for a path that cannot be read; UnsupportedError for a newer file
    """
    try:
        file = open_block_file(path, choose=choose)
    except CorruptFileError as error:
        yield broken(error)
        return
    with file:
        sound = True
        for finding in _structure(file):
            sound &= finding.severity != ERROR
            yield finding
        if sound and not quick:
            yield from Content(file).findings(progress)


def _caught(action: Callable[[], Any]) -> Iterator[Finding]:
    try:
        action()
    except CorruptFileError as error:
        yield broken(error)


def _structure(file: BlockFile) -> Iterator[Finding]:
    """Tail, sections behind the body, ledger, directory."""
    head = file.head
    end = head.file_bytes - TAIL_BYTES
    yield from _caught(lambda: check_tail(file.read_range(end, TAIL_BYTES), head, file.path))
    for section in head.sections:
        crc = 0
        for at in range(0, section.length, PIECE):
            piece = file.read_range(section.offset + at, min(PIECE, section.length - at))
            crc = running_crc(piece, crc)
        if crc != section.crc:
            said = f"section {section.type.decode('ascii', 'replace')} does not match its CRC"
            yield Finding("GSB-0202", ERROR, f"byte {section.offset}", said)
    yield from _ledger(head.metadata["ledger"], [int(n) for n in head.levels["voxels"]])
    broken = False
    for finding in _directory(file):
        broken = True
        yield finding
    if not broken:
        yield from _tree(file)


def _ledger(ledger: Mapping[str, Any], voxels: list[int]) -> Iterator[Finding]:
    """The sums that the counters in the metadata must satisfy."""
    numbers = {k: v for k, v in ledger.items() if k != "voxels"}
    wrong = [k for k, v in numbers.items() if type(v) is not int or v < 0]
    if wrong:
        yield Finding("GSB-0603", ERROR, "ledger", f"{wrong[0]} is not a count")
        return
    if ledger.get("voxels") != voxels:
        said = f"voxels {ledger.get('voxels')} differ from the level table's {voxels}"
        yield Finding("GSB-0602", ERROR, "ledger", said)
    if "triangles" in numbers:
        parts = [numbers.get(name, 0) for name in LEDGER_PARTS]
        if sum(parts) != numbers["triangles"]:
            said = f"triangles {numbers['triangles']} are not {' + '.join(map(str, parts))}"
            yield Finding("GSB-0601", ERROR, "ledger", said)
    for part, whole in (("degenerate", "triangles"), ("area_pruned", "area_total")):
        if numbers.get(part, 0) > numbers.get(whole, numbers.get(part, 0)):
            said = f"{part} {numbers[part]} is more than {whole} {numbers[whole]}"
            yield Finding("GSB-0603", ERROR, "ledger", said)


def _directory(file: BlockFile) -> Iterator[Finding]:
    """Pages one by one, then what spans them: order, groups, places, sums."""
    try:
        levels = _walk(file)
    except CorruptFileError as error:
        yield broken(error)
        return
    stated = np.stack([file.head.levels["blocks"], file.head.levels["voxels"]], axis=1)
    if (stated != levels).any():
        yield Finding("GSB-0203", ERROR, "level table", "the counts are not those of the directory")


def _walk(file: BlockFile) -> NDArray[np.int64]:
    """Blocks and voxels of each level (levels, 2), if the body is in order (GSB-03..)."""
    head, directory = file.head, file.directory
    levels = np.zeros((head.settings.levels, 2), np.int64)
    last: Any = None
    at = head.head_bytes
    for kind, number in _body(file):
        if kind == "payloads":
            entries = directory.page(number)
            at = _payloads_end(file, number, entries, at)
            for level in np.unique(entries["level"]):
                here = entries[entries["level"] == level]
                levels[level] += (len(here), here["count"].sum(dtype=np.int64))
            continue
        record = head.page_table[number] if kind == "table" else directory.record(number)
        if record["offset"] != at:
            said = f"a {kind} of the directory stands at {record['offset']}, not {at}"
            raise CorruptFileError("GSB-0312", file.path, at, said)
        if kind == "page":
            _check_seam(file, last, directory.page(number)[0], at)
            last = directory.page(number)[-1]
        at += int(record["length"])
    behind = sum(section.length for section in head.sections) + TAIL_BYTES
    if at + behind != head.file_bytes:
        said = f"the body ends here, not {head.file_bytes - behind - at} bytes later"
        raise CorruptFileError("GSB-0312", file.path, at, said)
    return levels


def _body(file: BlockFile) -> Iterator[tuple[str, int]]:
    """The body in file order: table page, page, payloads of page 0, then the same of the others."""
    pages = file.head.pages
    tables = len(file.head.page_table) if file.head.depth == 2 else 0
    for first, end in ((0, 1), (1, max(pages, tables))):
        yield from (("table", i) for i in range(first, min(end, tables)))
        yield from (("page", i) for i in range(first, min(end, pages)))
        yield from (("payloads", i) for i in range(first, min(end, pages)))


def _check_seam(file: BlockFile, last: Any, first: Any, at: int) -> None:
    """What the end of one page and the beginning of the next have to do with each other."""
    if last is None:
        return
    if rank(last["level"], last["key"]) >= rank(first["level"], first["key"]):
        raise CorruptFileError(
            "GSB-0303", file.path, at, "the page begins before the last one ends"
        )
    if last["level"] == first["level"] and last["key"] >> 3 == first["key"] >> 3:
        raise CorruptFileError("GSB-0304", file.path, at, "a sibling group is split by two pages")


def _payloads_end(file: BlockFile, number: int, entries: Rows, begin: int) -> int:
    columns = file.head.columns
    offsets, end = payload_offsets(entries, columns, begin)
    wrong = np.argwhere(stacked(entries, columns, "offset") != offsets)
    if len(wrong):
        row, column = wrong[0]
        said = (
            f"column {columns[column].name} of block {entries['key'][row]}, level"
            f" {entries['level'][row]}, is not where the order of payloads puts it"
        )
        raise CorruptFileError("GSB-0312", file.path, int(offsets[row, column]), said)
    if number == 0:
        before = begin - file.head.head_bytes
        opening = opening_bytes(entries, columns, before, file.head.levels["blocks"])
        if opening != file.head.opening_bytes:
            said = f"the opening run has {opening} bytes, not {file.head.opening_bytes}"
            raise CorruptFileError("GSB-0310", file.path, 224, said)
    return end


def _tree(file: BlockFile) -> Iterator[Finding]:
    """Every group of siblings has a parent that lists just these, and no parent is childless."""
    for level in range(file.levels - 1):
        done = 0  # parents below this key are settled
        for page in file.directory.pages_of(level):
            entries = file.directory.page(page)
            entries = entries[entries["level"] == level]
            if not len(entries):
                continue  # the page ends where the level begins
            keys, children = _families(entries)
            yield from _compare_families(file, level, keys, children, done)
            done = int(keys[-1]) + 1
        yield from _compare_families(
            file, level, np.empty(0, np.uint64), np.empty(0, np.uint8), done
        )


def _families(entries: Rows) -> tuple[NDArray[np.uint64], NDArray[np.uint8]]:
    """(keys of the parents, child masks) of whole sibling groups of one level."""
    first = group_starts(entries)[:-1]
    bits = np.left_shift(1, (entries["key"] & np.uint64(7)).astype(np.int64)).astype(np.uint8)
    return entries["key"][first] >> np.uint64(3), np.bitwise_or.reduceat(bits, first)


def _compare_families(
    file: BlockFile,
    level: int,
    keys: NDArray[np.uint64],
    children: NDArray[np.uint8],
    done: int,
) -> Iterator[Finding]:
    """Compare groups of `level` with the entries above them; no keys: all that are left."""
    last = int(keys[-1]) if len(keys) else 2**48 - 1
    parents = file.directory.between(level + 1, done, last)
    orphans = ~np.isin(keys, parents["key"])
    if orphans.any():
        said = f"the parent of {int(orphans.sum())} sibling groups is missing"
        place = f"level {level + 1}, block {keys[orphans][0]}"
        yield Finding("GSB-0307", ERROR, place, said)
    found = np.zeros(len(parents), np.uint8)
    if len(keys):
        at = np.minimum(np.searchsorted(keys, parents["key"]), len(keys) - 1)
        found = np.where(keys[at] == parents["key"], children[at], 0)
    wrong = found != parents["children"]
    for parent, mask in zip(parents[wrong], found[wrong], strict=True):
        said = f"the child mask is {parent['children']:#x} and the children are {mask:#x}"
        yield Finding("GSB-0306", ERROR, f"level {level + 1}, block {parent['key']}", said)
