"""Blocks of text to numbers: the tokens of PLY and OFF bodies, and the facets of ASCII STL."""

from gstream.kernels import kernel
from gstream.kernels.numbers import BAD, READ, parse_number, plain_number

# Flags of a token
SLOW_TOKEN, BAD_TOKEN, LAST_ON_LINE, REAL_TOKEN = 1, 2, 4, 8

# What ended a call of parse_facets
MORE_TEXT, FULL, BAD_WORD, BAD_COORDINATE, BAD_FACET = 0, 1, 2, 3, 4

# Words of an ASCII STL
OTHER, SOLID, ENDSOLID, FACET, NORMAL, OUTER, LOOP, VERTEX, ENDLOOP, ENDFACET = range(10)


@kernel
def is_space(c):
    """Whether a byte is white space: space, tab, line feed, vertical tab, form feed or return."""
    return c == 32 or (9 <= c <= 13)


@kernel
def is_line_end(c):
    return c == 10 or c == 13


@kernel
def skip_space(text, first, stop, hashes):
    """The first byte not of white space nor (`hashes`) of a comment; whether a line ended."""
    i, ended = first, False
    while i < stop:
        if hashes and text[i] == 35:
            while i < stop and not is_line_end(text[i]):
                i += 1
        elif is_space(text[i]):
            ended |= is_line_end(text[i])
            i += 1
        else:
            break
    return i, ended


@kernel
def token_end(text, first, stop, hashes):
    """The byte after the token that starts at `first`."""
    end = first
    while (
        end < stop and not is_space(text[end]) and not (hashes and end > first and text[end] == 35)
    ):
        end += 1
    return end


@kernel
def next_token(text, first, stop):
    """The next token's start and end (start = stop when there is none), whether a line ended."""
    start, ended = skip_space(text, first, stop, False)
    return start, token_end(text, start, stop, False), ended


@kernel
def _has_point(text, first, end):
    """Whether a token is written as a real: with a point or an exponent."""
    for i in range(first, end):  # noqa: SIM110  numba has no generators
        if text[i] == 46 or text[i] | 32 == 101:
            return True
    return False


@kernel
def parse_numbers(text, first, stop, hashes, values, starts, flags):
    """Read tokens as numbers until the text or the room for them ends.

    text : (n,) uint8, ends in a line feed when it is the last of its file;  first, stop : int
    hashes : bool   '#' starts a comment
    values : (k,) float64, starts : (k,) int64 byte of each token, flags : (k,) uint8   written
    returns: int, int   tokens read, and the byte from which to go on; a token at the very end of
        the text is left for the next call, as more of it, or its line's end, may follow
    errors : none here; BAD_TOKEN marks what is no number, SLOW_TOKEN what Python must round
    source : none
    """
    count, at = 0, first
    start, ended = skip_space(text, at, stop, hashes)
    while start < stop and count < values.shape[0]:
        value, end, plain, real = plain_number(text, start, stop)
        status = READ
        if not plain:
            end = token_end(text, start, stop, hashes)
            value, status = parse_number(text, start, end)
            real = _has_point(text, start, end)
        if end == stop:
            break
        following, ended = skip_space(text, end, stop, hashes)
        if following == stop and not ended:
            break
        flag = LAST_ON_LINE if ended else 0
        flag |= REAL_TOKEN if real else 0
        flag |= 0 if status == READ else (BAD_TOKEN if status == BAD else SLOW_TOKEN)
        values[count], starts[count], flags[count] = value, start, flag
        count += 1
        at = end
        start = following
    if start < stop:
        return count, start
    while hashes and stop > at and not is_line_end(text[stop - 1]):
        stop -= 1  # a comment may go on in the next block
    return count, stop


@kernel
def _is(text, first, end, word):
    """Whether text[first:end] is `word` (bytes in lower case), in any case."""
    if end - first != len(word):
        return False
    for i in range(len(word)):  # noqa: SIM110  as above
        if text[first + i] | 32 != word[i]:
            return False
    return True


@kernel
def _stl_word(text, first, end):
    """Which word of ASCII STL a token is."""
    if _is(text, first, end, b"vertex"):
        return VERTEX
    if _is(text, first, end, b"facet"):
        return FACET
    if _is(text, first, end, b"endfacet"):
        return ENDFACET
    if _is(text, first, end, b"normal"):
        return NORMAL
    if _is(text, first, end, b"outer") or _is(text, first, end, b"loop"):
        return LOOP
    if _is(text, first, end, b"endloop"):
        return ENDLOOP
    if _is(text, first, end, b"solid"):
        return SOLID
    if _is(text, first, end, b"endsolid") or _is(text, first, end, b"end"):
        return ENDSOLID
    return OTHER


@kernel
def _skip_line(text, first, stop):
    while first < stop and not is_line_end(text[first]):
        first += 1
    return first


@kernel
def parse_facets(text, first, stop, corners, slow):
    """Read the facets of an ASCII STL until the text or the room for them ends.

    text : (n,) uint8;  first, stop : int
    corners : (k, 9) float64   written: three corners per facet
    slow : (m, 3) int64   written: index into corners.ravel(), start and end of tokens for Python
    returns: int, int, int, int, int   facets, slow tokens, the byte to go on from, code (MORE_TEXT,
        FULL, BAD_WORD, BAD_COORDINATE, BAD_FACET), and the byte of what is wrong
    errors : none here; the codes
    source : M. Burns, "Automated Fabrication" (1993), section 6.5, as exporters write it
    """
    facets, waiting, kept = 0, 0, first  # `kept`: the end of the last whole line outside facets
    at, seen, inside, skip, slow_in = first, 0, False, 0, 0
    word = ENDFACET
    while True:
        start, end, ended = next_token(text, at, stop)
        if end >= stop:
            return facets, waiting, kept, MORE_TEXT, start
        at, before = end, word
        if skip > 0:
            skip -= 1
            continue
        word = _stl_word(text, start, end)
        if word == OTHER and not ended and before in (ENDFACET, ENDLOOP):
            at, word = _skip_line(text, end, stop), before
            continue
        if word == VERTEX and inside and seen < 3:
            for axis in range(3):
                start, _ = skip_space(text, at, stop, False)
                value, end, plain, _ = plain_number(text, start, stop)
                status = READ
                if not plain:
                    end = token_end(text, start, stop, False)
                    if end >= stop:
                        return facets, waiting, kept, MORE_TEXT, start
                    value, status = parse_number(text, start, end)
                if status == BAD:
                    return facets, waiting, kept, BAD_COORDINATE, start
                place = 9 * facets + 3 * seen + axis
                corners[facets, 3 * seen + axis] = value
                if status != READ:
                    slow[waiting + slow_in, 0] = place
                    slow[waiting + slow_in, 1], slow[waiting + slow_in, 2] = start, end
                    slow_in += 1
                at = end
            seen += 1
        elif word == FACET and not inside:
            if facets == corners.shape[0] or waiting + 9 > slow.shape[0]:
                return facets, waiting, kept, FULL, start
            inside, seen, slow_in = True, 0, 0
        elif word == NORMAL and inside:
            skip = 3
        elif word in (LOOP, ENDLOOP) and inside:
            continue
        elif word == ENDFACET and inside and seen == 3:
            facets, waiting, kept, inside = facets + 1, waiting + slow_in, at, False
        elif word in (SOLID, ENDSOLID) and not inside:
            at = _skip_line(text, end, stop)
            if at == stop:
                return facets, waiting, kept, MORE_TEXT, start
            kept = at
        elif word == OTHER:
            return facets, waiting, kept, BAD_WORD, start
        else:
            return facets, waiting, kept, BAD_FACET, start
