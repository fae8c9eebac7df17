"""Walking an element's records, from any source of numbers, in batches of bounded size."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gstream.errors import InputError
from gstream.kernels import records as kernel
from gstream.readers.number_source import BATCH, NumberSource
from gstream.readers.scratch import Column


@dataclass(frozen=True, slots=True)
class Plan:
    """What to take from each record of an element."""

    what: str  # "face", "vertex", ...: for errors
    rows: int
    roles: tuple[int, ...]  # of kernels.records, per property
    slots: tuple[int, ...]  # column of `captured` per property, or -1
    columns: int
    vertices: int  # ids must be below
    whole_lines: bool = False  # a record must end where a line ends


@dataclass(frozen=True, slots=True)
class Batch:
    """The next records; views that live until the next batch."""

    triangles: npt.NDArray[np.int64]  # (t, 3)
    captured: npt.NDArray[np.float64]  # (r, columns), of whole records
    made: npt.NDArray[np.int64]  # (r,) triangles of each whole record, earlier batches' included
    skipped: int  # faces with fewer than three vertices, so far


def walk(source: NumberSource, plan: Plan, name: str) -> Iterator[Batch]:
    """All records of `plan`; InputError names the record and the place of what is wrong."""
    if not plan.roles or not plan.rows:
        return
    triangles = np.empty((BATCH, 3), np.int64)
    captured = np.zeros((BATCH + 1, plan.columns))
    made = np.zeros(BATCH + 1, np.int64)
    roles, slots = np.array(plan.roles, np.int64), np.array(plan.slots, np.int64)
    out, state = (triangles, captured, made, plan.whole_lines), kernel.new_state()
    code = kernel.MORE_NUMBERS
    while code != kernel.ALL_RECORDS:
        if source.at == source.stop and not source.refill():
            which = f"{plan.what} {state[kernel.RECORD]} of {plan.rows}"
            what = which if plan.rows > 1 else f"the {plan.what}"
            said = f"the file ends inside {what}"
            raise InputError(
                name, source.place(source.stop), said, "copy it again, or export it again"
            )
        numbers = (source.values, source.flags, source.at, source.stop)
        walked = kernel.walk_records(*numbers, roles, slots, plan.rows, plan.vertices, state, out)
        source.at, count, done, code = (int(v) for v in walked)
        if code > kernel.ALL_RECORDS:
            raise _wrong(source, plan, code, int(state[kernel.RECORD]), name)
        skipped = int(state[kernel.SKIPPED])
        yield Batch(triangles[:count], captured[:done], made[:done], skipped)
        captured[0] = captured[done]


def _wrong(source: NumberSource, plan: Plan, code: int, record: int, name: str) -> InputError:
    if code == kernel.LONG_LINE:
        said = f"{plan.what} {record} has more values than the header gives it"
        return InputError(name, source.place(source.at - 1), said, "export the file again")
    said = (
        f"{plan.what} {record} has the vertex {source.said(source.at)}, there are {plan.vertices}"
    )
    if code == kernel.BAD_COUNT:
        said = f"{plan.what} {record} has a list of {source.said(source.at)} entries"
    return InputError(name, source.place(source.at), said, "repair or export the file again")


def append_repeated(column: Column, rows: npt.NDArray[Any], counts: npt.NDArray[np.int64]) -> None:
    """Append each row as often as `counts` says, in pieces of bounded size."""
    if counts.sum() <= BATCH:
        column.append(np.repeat(rows, counts, axis=0))
        return
    for row, count in zip(rows, counts, strict=True):
        for first in range(0, int(count), BATCH):
            column.append(np.broadcast_to(row, (min(BATCH, int(count) - first), len(row))))
