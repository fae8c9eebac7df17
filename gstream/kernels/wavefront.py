"""Lines of a Wavefront OBJ to vertices, normals and triangles."""

import numpy as np
import numpy.typing as npt

from gstream.kernels import kernel
from gstream.kernels.numbers import BAD, READ, parse_number, plain_number
from gstream.kernels.text import is_line_end, is_space

# The state of a file, kept from call to call
(VERTICES, TRIANGLES, NORMALS, WAITING, ALL_VERTICES, ALL_NORMALS, FACES, SKIPPED, UNREAD) = range(
    9
)
(MATERIAL, LAST_VERTEX, LAST_FACE, IN_FACE, RUN, FIRST, FIRST_N, PREVIOUS, PREVIOUS_N) = range(
    9, 18
)

# What ended a call of parse_lines
MORE_TEXT, FULL, MATERIAL_LINE, BAD_NUMBER, BAD_VERTEX, BAD_INDEX = 0, 1, 2, 3, 4, 5

USEMTL, MTLLIB = np.frombuffer(b"usemtl", np.uint8), np.frombuffer(b"mtllib", np.uint8)
NO_NORMAL, LOST_NORMAL = -1, -2  # normal ids: none given, or before the first one


def new_state() -> npt.NDArray[np.int64]:
    """The state before the first line."""
    state = np.zeros(18, np.int64)
    state[LAST_VERTEX] = -1
    return state


@kernel
def _line_stop(text, first, stop):
    """The byte that ends the logical line at `first`; -1 when it is not in the text.

    A backslash before a line end joins lines, but for comments.
    """
    i, comment = first, False
    while i < stop and is_space(text[i]) and not is_line_end(text[i]):
        i += 1
    comment = i < stop and text[i] == 35
    while i < stop:
        if is_line_end(text[i]):
            back = i - 1
            if text[i] == 10 and back > first and text[back] == 13:
                back -= 1
            if comment or back < first or text[back] != 92:
                return i
        i += 1
    return -1


@kernel
def _skip(text, first, stop):
    """The first byte of a logical line, from `first` on, that is no white space nor joins lines."""
    i = first
    while i < stop and (is_space(text[i]) or (text[i] == 92 and is_line_end(text[i + 1]))):
        i += 1
    return i


@kernel
def _token(text, first, stop):
    """The next token of a logical line that stops at `stop`; start = end when there is none."""
    i = _skip(text, first, stop)
    end = i
    while end < stop and not is_space(text[end]):
        if text[end] == 92 and is_line_end(text[end + 1]):
            break
        end += 1
    return i, end


@kernel
def _numbers(text, first, stop, most, row, kind, number, state, slow):
    """Read up to `most` numbers of a line into `row`.

    text : (n,) uint8;  first, stop : int   the line from its first number on
    row : (most,) float64   written
    kind, number : int   what to note in `slow` with the place: which array, which of its rows
    state : (18,) int64, slow : (m, 5) int64   kind, row, column, start and end for Python to round
    returns: int, int   numbers read and the byte of a token that is none, or -1
    errors : none here
    source : none
    """
    count, at = 0, first
    while count < most:
        start = _skip(text, at, stop)
        value, end, plain, _ = plain_number(text, start, stop + 1)
        status = READ
        if not plain:
            start, end = _token(text, start, stop)
            if start == end:
                break
            value, status = parse_number(text, start, end)
        if status == BAD:
            return count, start
        row[count] = value
        if status != READ:
            entry = slow[state[WAITING]]
            entry[0], entry[1], entry[2], entry[3], entry[4] = kind, number, count, start, end
            state[WAITING] += 1
        count, at = count + 1, end
    return count, -1


@kernel
def _integer(text, first, end):
    """A signed integer up to the next '/' or `end`, and the byte after; 0 when there is none."""
    i, sign, value = first, 1, 0
    if i < end and (text[i] == 45 or text[i] == 43):
        sign = -1 if text[i] == 45 else 1
        i += 1
    while i < end and text[i] != 47:
        digit = np.int64(text[i]) - 48
        if digit < 0 or digit > 9:
            return 0, -1
        value = min(value * 10 + digit, 1 << 58)
        i += 1
    return sign * value, i


@kernel
def _corner(text, start, end, state):
    """Vertex and normal ids, from 0, of v, v/vt, v//vn or v/vt/vn; a vertex below 0 is wrong."""
    vertex, at = _integer(text, start, end)
    normal, slashes = 0, 0
    while 0 <= at < end:
        normal, at = _integer(text, at + 1, end)
        slashes += 1
    if at < 0 or slashes > 2 or vertex == 0:
        return -1, NO_NORMAL
    vertex = vertex - 1 if vertex > 0 else max(state[ALL_VERTICES] + vertex, -1)
    if slashes < 2 or normal == 0:
        return vertex, NO_NORMAL
    if normal < 0:
        normal = state[ALL_NORMALS] + normal + 1
    return vertex, normal - 1 if normal > 0 else LOST_NORMAL


@kernel
def _face(text, first, stop, state, triangles, normals, materials):
    """Make the fan of one face's line; goes on inside the face when `state` says so.

    text : (n,) uint8;  first, stop : int   the line from its first unread corner on
    triangles, normals : (k, 3) int64, materials : (k,) int64   written
    returns: int, int   byte to go on from and code (MORE_TEXT: the face is done, FULL, BAD_INDEX)
    errors : none here; the codes
    source : Wavefront Advanced Visualizer, Appendix B1 (1992)
    """
    if not state[IN_FACE]:
        state[IN_FACE], state[RUN] = 1, 0
    at = first
    while True:
        start, end = _token(text, at, stop)
        if start == end or text[start] == 35:
            state[SKIPPED] += 1 if state[RUN] < 3 else 0
            state[FACES] += 1
            state[IN_FACE] = 0
            return stop, MORE_TEXT
        made = state[TRIANGLES]
        if made == len(triangles):
            return start, FULL
        vertex, normal = _corner(text, start, end, state)
        if vertex < 0:
            return start, BAD_INDEX
        if vertex > state[LAST_VERTEX]:
            state[LAST_VERTEX], state[LAST_FACE] = vertex, state[FACES]
        if state[RUN] == 0:
            state[FIRST], state[FIRST_N] = vertex, normal
        elif state[RUN] >= 2:
            triangles[made, 0], triangles[made, 1] = state[FIRST], state[PREVIOUS]
            normals[made, 0], normals[made, 1] = state[FIRST_N], state[PREVIOUS_N]
            triangles[made, 2], normals[made, 2] = vertex, normal
            materials[made] = state[MATERIAL]
            state[TRIANGLES] += 1
        state[PREVIOUS], state[PREVIOUS_N] = vertex, normal
        state[RUN] += 1
        at = end


@kernel
def _is_ignored(text, start, end):
    """Whether a line has nothing that a surface is made of: comments, vt, vp, g, o, s, mg."""
    size, a = end - start, text[start]
    b = text[start + 1] if size > 1 else 0
    if a == 35 or (size == 1 and (a == 103 or a == 111 or a == 115)):
        return True
    return size == 2 and ((a == 118 and (b == 116 or b == 112)) or (a == 109 and b == 103))


@kernel
def _is_material(text, start, end):
    """Whether a token is usemtl or mtllib."""
    if end - start != 6:
        return False
    use, library = True, True
    for i in range(6):
        use &= text[start + i] == USEMTL[i]
        library &= text[start + i] == MTLLIB[i]
    return use or library


@kernel
def _vertex_line(text, first, line, normal, state, out, row):
    """Read the numbers of a v or vn; returns a code and the byte of what is wrong.

    Elements are copied one by one: slice assignment costs numba 6 s of compiling for its messages.
    """
    positions, colours, directions, slow = out[0], out[1], out[2], out[3]
    place = state[NORMALS] if normal else state[VERTICES]
    most, kind = (3, 2) if normal else (8, 0)
    count, wrong = _numbers(text, first, line, most, row, kind, place, state, slow)
    if count < 3:
        return (BAD_VERTEX, first) if wrong < 0 else (BAD_NUMBER, wrong)
    if wrong >= 0 and text[wrong] != 35:
        return BAD_NUMBER, wrong
    for axis in range(3):
        if normal:
            directions[place, axis] = row[axis]
        else:
            positions[place, axis] = row[axis]
            colours[place, axis] = row[3 + axis] if count >= 6 else np.nan
    if normal:
        state[NORMALS] += 1
        state[ALL_NORMALS] += 1
    else:
        state[VERTICES] += 1
        state[ALL_VERTICES] += 1
    return MORE_TEXT, line


@kernel
def parse_lines(text, first, stop, state, out):
    """Read lines of an OBJ until the text, the room, or what kernels can read ends.

    text : (n,) uint8;  first, stop : int
    state : (18,) int64   from new_state; the first four entries are set to 0 by who took the rows
    out : positions (v, 3), colours (v, 3) with NaN for none, directions (v, 3), all float64, slow
        (m, 5) int64, triangles and normal ids (t, 3), materials (t,) int64   written
    returns: int, int, int   byte to go on from, code, and byte of what is wrong or of a line's end
    errors : none here; the codes
    source : Wavefront Advanced Visualizer, Appendix B1 (1992)
    """
    at, row = first, np.empty(8)
    while True:
        line = _line_stop(text, at, stop)
        if line < 0:
            return at, MORE_TEXT, at
        start, end = (at, at) if state[IN_FACE] else _token(text, at, line)
        if not state[IN_FACE] and (start == end or _is_ignored(text, start, end)):
            at = line + 1
            continue
        a, size = text[start], end - start
        if state[IN_FACE] or (size == 1 and a == 102):
            at, code = _face(text, end, line, state, out[4], out[5], out[6])
            if code != MORE_TEXT:
                return at, code, at
        elif a == 118 and (size == 1 or (size == 2 and text[start + 1] == 110)):
            rows = state[NORMALS] if size == 2 else state[VERTICES]
            if rows == len(out[0]) or state[WAITING] + 8 > len(out[3]):
                return at, FULL, at
            code, wrong = _vertex_line(text, end, line, size == 2, state, out, row)
            if code != MORE_TEXT:
                return at, code, wrong
        elif size == 1 and (a == 108 or a == 112):
            state[SKIPPED] += 1
        elif _is_material(text, start, end):
            return start, MATERIAL_LINE, line
        else:
            state[UNREAD] += 1
        at = line + 1
