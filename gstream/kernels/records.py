"""Records of numbers, some of them lists, to triangles: the elements of PLY and the rows of OFF."""

from typing import Any

import numpy as np
import numpy.typing as npt

from gstream.kernels import kernel
from gstream.kernels.text import LAST_ON_LINE, REAL_TOKEN

# Roles of a property
SCALAR, LIST, FAN, STRIP, CAPTURED_LIST, REST_OF_LINE = 0, 1, 2, 3, 4, 5
CAPTURED = 4  # items kept of a captured list or rest; then come its length and whether any was real

# The state of a walk, so that it can stop inside a list
PROPERTY, LEFT, ITEM, FIRST, PREVIOUS, RUN, MADE, RECORD, SKIPPED, ENDED, AT_LINE_END = range(11)
NOT_IN_LIST, TO_LINE_END = -1, 1 << 62

# What ended a call of walk_records
MORE_NUMBERS, ALL_RECORDS, BAD_COUNT, BAD_INDEX, LONG_LINE = 0, 1, 2, 3, 4

KINDS = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")  # codes of decode_records


def new_state() -> npt.NDArray[np.int64]:
    """The state of a walk or of a decoding before its first record."""
    state = np.zeros(AT_LINE_END + 1, np.int64)
    state[LEFT] = NOT_IN_LIST
    return state


def number_views() -> tuple[npt.NDArray[Any], ...]:
    """Eight bytes seen as one number of each of KINDS; numba would take 2 s to compile this."""
    raw = np.zeros(8, np.uint8)
    return tuple(raw.view(kind) for kind in KINDS)


@kernel
def _corner(role, value, state, triangles, made):
    """Take one vertex id of a fan or a strip; returns the number of triangles made so far."""
    vertex = np.int64(value)
    if role == STRIP and vertex == -1:
        state[RUN] = 0
        return made
    if state[RUN] >= 2:
        a, b = state[FIRST], state[PREVIOUS]
        if role == STRIP and state[RUN] & 1:
            a, b = b, a
        triangles[made, 0], triangles[made, 1], triangles[made, 2] = a, b, vertex
        made += 1
        state[MADE] += 1
        if role == STRIP:
            state[FIRST] = state[PREVIOUS]
    elif state[RUN] == 0:
        state[FIRST] = vertex
    state[PREVIOUS] = vertex
    state[RUN] += 1
    return made


@kernel
def _is_count(value):
    return value >= 0 and value == np.floor(value) and value < 2.0**53


@kernel
def walk_records(values, flags, first, stop, roles, slots, rows, vertices, state, out):
    """Walk records of the same properties and make triangles of their index lists.

    values : (n,) float64, flags : (n,) uint8   numbers in the file's order; first, stop : int
    roles, slots : (p,) int64   what each property is, and the captured column it fills or -1
    rows : int   records of the element;  vertices : int   ids must be below it
    state : (11,) int64   zero at the start but for LEFT = NOT_IN_LIST; kept from call to call
    out : triangles (k, 3) int64, captured (r, c) float64, made (r,) int64 triangles of each record,
        k and r at least stop - first   written
    returns: int, int, int, int   numbers used, triangles, whole records, code (MORE_NUMBERS,
        ALL_RECORDS, BAD_COUNT, BAD_INDEX: values[used] is wrong; LONG_LINE: the record ended there)
    errors : none here; the codes
    source : G. Turk, "The PLY Polygon File Format" (1994); Geomview manual, section OFF
    """
    triangles, captured, made_of, whole_lines = out
    at, made, done = first, 0, 0
    while state[RECORD] < rows:
        if state[PROPERTY] == len(roles):
            if whole_lines and not state[AT_LINE_END]:
                return at, made, done, LONG_LINE
            made_of[done] = state[MADE]
            state[MADE] = state[PROPERTY] = 0
            state[RECORD] += 1
            done += 1
            continue
        role, slot = roles[state[PROPERTY]], slots[state[PROPERTY]]
        if role == REST_OF_LINE and state[LEFT] == NOT_IN_LIST:
            state[LEFT], state[ITEM] = (0 if state[AT_LINE_END] else TO_LINE_END), 0
            captured[done, slot : slot + CAPTURED + 2] = 0
        if state[LEFT] == 0:
            if role == FAN and state[ITEM] < 3:
                state[SKIPPED] += 1
            if role in (CAPTURED_LIST, REST_OF_LINE):
                captured[done, slot + CAPTURED] = state[ITEM]
            state[LEFT] = NOT_IN_LIST
            state[PROPERTY] += 1
            continue
        if at == stop:
            return at, made, done, MORE_NUMBERS
        value = values[at]
        if role == SCALAR:
            if slot >= 0:
                captured[done, slot] = value
            state[PROPERTY] += 1
        elif state[LEFT] == NOT_IN_LIST:
            if not _is_count(value):
                return at, made, done, BAD_COUNT
            state[LEFT], state[ITEM], state[RUN] = np.int64(value), 0, 0
            if role == CAPTURED_LIST:
                captured[done, slot : slot + CAPTURED + 2] = 0
        else:
            if role in (FAN, STRIP):
                restart = role == STRIP and value == -1.0
                if not restart and not (_is_count(value) and value < vertices):
                    return at, made, done, BAD_INDEX
                made = _corner(role, value, state, triangles, made)
            elif role != LIST:
                if state[ITEM] < CAPTURED:
                    captured[done, slot + state[ITEM]] = value
                if flags[at] & REAL_TOKEN:
                    captured[done, slot + CAPTURED + 1] = 1
            state[ITEM] += 1
            state[LEFT] -= 1
            if role == REST_OF_LINE and flags[at] & LAST_ON_LINE:
                state[LEFT] = 0
        state[AT_LINE_END] = flags[at] & LAST_ON_LINE
        at += 1
    return at, made, done, ALL_RECORDS


@kernel
def decode_records(data, first, stop, swap, counts, kinds, rows, state, values, views):
    """Unpack binary records, lists included, into numbers in the file's order.

    data : (n,) uint8;  first, stop : int;  swap : bool   the bytes are in the other order than ours
    counts, kinds : (p,) int64   codes into KINDS; counts is -1 for a scalar
    rows : int   records of the element
    state : (11,) int64   PROPERTY, LEFT and RECORD are used; kept from call to call
    values : (k,) float64   written
    views : from number_views   eight bytes to put a number in
    returns: int, int   numbers written, bytes used
    errors : none; a list's count is taken as it comes, below 1 is none (walk_records checks it)
    source : G. Turk, "The PLY Polygon File Format" (1994)
    """
    i1, raw, i2, u2, i4, u4, i8, u8, f4, f8 = views
    at, written = first, 0
    while state[RECORD] < rows and written < len(values):
        item = state[LEFT] != NOT_IN_LIST or counts[state[PROPERTY]] < 0
        code = kinds[state[PROPERTY]] if item else counts[state[PROPERTY]]
        size = 1 << (code >> 1) if code < 8 else 4 << (code - 8)
        if at + size > stop:
            break
        for i in range(size):
            raw[i] = data[at + size - 1 - i] if swap else data[at + i]
        if code == 0:
            value = np.float64(i1[0])
        elif code == 1:
            value = np.float64(raw[0])
        elif code == 2:
            value = np.float64(i2[0])
        elif code == 3:
            value = np.float64(u2[0])
        elif code == 4:
            value = np.float64(i4[0])
        elif code == 5:
            value = np.float64(u4[0])
        elif code == 6:
            value = np.float64(i8[0])
        elif code == 7:
            value = np.float64(u8[0])
        else:
            value = np.float64(f4[0]) if code == 8 else f8[0]
        values[written] = value
        written, at = written + 1, at + size
        if item and state[LEFT] != NOT_IN_LIST:
            state[LEFT] -= 1
        elif not item:
            state[LEFT] = np.int64(value) if value >= 1 else 0
        if (item and state[LEFT] == NOT_IN_LIST) or state[LEFT] == 0:
            state[LEFT] = NOT_IN_LIST
            state[PROPERTY] += 1
            if state[PROPERTY] == len(kinds):
                state[PROPERTY] = 0
                state[RECORD] += 1
    return written, at
