"""Decimal text to binary64, correctly rounded; what the rules cannot decide is left to Python.

source: D. Lemire, "Number Parsing at a Gigabyte per Second", Software: Practice and Experience 51
(2021), section 5; W. D. Clinger, "How to Read Floating Point Numbers Accurately", PLDI 1990 (the
exact case: a mantissa below 2^53 and a power of ten up to 22).
"""

import math

import numpy as np

from gstream.kernels import kernel

READ, SLOW, BAD = 0, 1, 2  # SLOW: well formed, but Python's float() must round it

U0, U1, U3, U9, U10 = np.uint64(0), np.uint64(1), np.uint64(3), np.uint64(9), np.uint64(10)
U32, U63, LOW_HALF = np.uint64(32), np.uint64(63), np.uint64(0xFFFFFFFF)
ONES, GUARD = np.uint64(0xFFFFFFFFFFFFFFFF), np.uint64(0x1FF)
EXACT, HIDDEN = np.uint64(1 << 53), np.uint64(1 << 52)
TENS = np.array([10.0**i for i in range(23)])
MIN_POWER, MAX_POWER = -342, 308


def _power_of_five(q: int) -> int:
    """The leading 128 bits of 5^q, rounded as the paper's appendix B wants."""
    if q >= 0:
        five: int = 5**q
        shift = 128 - five.bit_length()
        return five << shift if shift >= 0 else five >> -shift
    five = 5**-q
    z = (five - 1).bit_length()
    value: int = (1 << (z + 127 if q >= -27 else 2 * z + 128)) // five + 1
    return value >> max(0, value.bit_length() - 128)


_FIVES = [_power_of_five(q) for q in range(MIN_POWER, MAX_POWER + 1)]
FIVES_HIGH = np.array([v >> 64 for v in _FIVES], np.uint64)
FIVES_LOW = np.array([v & ((1 << 64) - 1) for v in _FIVES], np.uint64)


@kernel
def _multiply(a, b):
    """The high and low words of a * b, all uint64."""
    a1, a0, b1, b0 = a >> U32, a & LOW_HALF, b >> U32, b & LOW_HALF
    low, middle = a0 * b0, a1 * b0
    middle += low >> U32
    cross = a0 * b1 + (middle & LOW_HALF)
    high = a1 * b1 + (middle >> U32) + (cross >> U32)
    return high, (cross << U32) | (low & LOW_HALF)


@kernel
def _round_decimal(mantissa, power):
    """mantissa * 10^power as binary64.

    mantissa : uint64, not 0;  power : int
    returns: float64, int   the value and READ; SLOW when subnormal, overflowing or undecided
    errors : none
    source : Lemire 2021, algorithm 1
    """
    if power < MIN_POWER or power > MAX_POWER:
        return 0.0, SLOW
    zeros, w = 0, mantissa
    while (w >> U63) == U0:
        w <<= U1
        zeros += 1
    upper, lower = _multiply(w, FIVES_HIGH[power - MIN_POWER])
    if (upper & GUARD) == GUARD:
        extra, _ = _multiply(w, FIVES_LOW[power - MIN_POWER])
        lower += extra
        if extra > lower:
            upper += U1
    if lower == ONES and (power < -27 or power > 55):
        return 0.0, SLOW
    top = upper >> U63
    shift = top + U9
    m = upper >> shift
    exponent = ((217706 * power) >> 16) + 63 + np.int64(top) - zeros
    if exponent <= -1022 or exponent >= 1023:
        return 0.0, SLOW
    if lower <= U1 and -4 <= power <= 23 and (m & U3) == U1 and (m << shift) == upper:
        m &= ~U1
    m = (m + (m & U1)) >> U1
    return math.ldexp(np.float64(m), exponent - 52), READ


@kernel
def _word(text, first, end):
    """nan and inf as C libraries print them: nan, nan(ind), inf, infinity, #QNAN after '1.'."""
    size = end - first
    a, b, c = text[first] | 32, U0, U0
    if size >= 3:
        b, c = text[first + 1] | 32, text[first + 2] | 32
    if a == 110 and b == 97 and c == 110 and (size == 3 or text[first + 3] == 40):
        return np.nan, READ
    if (
        a == 105
        and b == 110
        and c == 102
        and (size == 3 or (size == 8 and text[end - 1] | 32 == 121))
    ):
        return np.inf, READ
    if text[first] == 35 and size >= 4:
        infinite = text[first + 1] | 32 == 105 and text[first + 3] | 32 == 102
        return (np.inf if infinite else np.nan), READ
    return 0.0, BAD


@kernel
def _exponent(text, first, end):
    """The integer after e or E; 99999 stands for anything longer, -100000 for no integer."""
    i, negative = first, False
    if i < end and (text[i] == 43 or text[i] == 45):
        negative = text[i] == 45
        i += 1
    if i == end:
        return -100000
    value = 0
    while i < end:
        digit = np.int64(text[i]) - 48
        if digit < 0 or digit > 9:
            return -100000
        value = min(value * 10 + digit, 99999)
        i += 1
    return -value if negative else value


@kernel
def parse_number(text, first, end):
    """Read the token text[first:end] as a decimal number.

    text : (n,) uint8;  first, end : int   a token without white space
    returns: float64, int   the value, and READ, SLOW (well formed, use Python's float) or BAD
    errors : none; hexadecimal, digit groups and trailing letters are BAD
    source : the module's docstring; zeros are held back, so that 1.000000000000000000e+00 is exact
    """
    i, sign = first, 1.0
    if i < end and (text[i] == 43 or text[i] == 45):
        sign = -1.0 if text[i] == 45 else 1.0
        i += 1
    if i == end:
        return 0.0, BAD
    mantissa, held, power, places, used = U0, 0, 0, 0, 0
    seen, point, cut = False, False, False
    while i < end:
        digit = np.int64(text[i]) - 48
        if digit < 0 or digit > 9:
            if digit != -2 or point:
                break
            point = True
            i += 1
            continue
        seen = True
        places += 1 if point else 0
        cut |= digit != 0 and mantissa != U0 and used + held + 1 > 19
        if digit == 0 or cut:
            held += 1
            power += 0 if point else 1
        else:
            used = used + held + 1 if mantissa != U0 else 1
            while held > 0 and mantissa != U0:
                mantissa *= U10
                held -= 1
            mantissa = mantissa * U10 + np.uint64(digit)
            held, power = 0, -places
        i += 1
    if i < end and (text[i] == 101 or text[i] == 69) and seen:
        given = _exponent(text, i + 1, end)
        if given == -100000:
            return 0.0, BAD
        power += given
    elif i < end:
        if (seen or point) and not (seen and point and text[i] == 35):
            return 0.0, BAD
        value, status = _word(text, i, end)
        return sign * value, status
    elif not seen:
        return 0.0, BAD
    if mantissa == U0:
        return sign * 0.0, READ
    if cut:  # more than 19 digits: decided when both neighbours round to the same
        low, status = _round_decimal(mantissa, power)
        high, above = _round_decimal(mantissa + U1, power)
        return sign * low, READ if status == above == READ and low == high else SLOW
    if mantissa <= EXACT and -22 <= power <= 22:
        value = np.float64(mantissa)
        return sign * (value * TENS[power] if power >= 0 else value / TENS[-power]), READ
    value, status = _round_decimal(mantissa, power)
    return sign * value, status


@kernel
def plain_number(text, first, stop):
    """Read [-]digits[.digits] in one pass: nearly every token of real files; twice as fast so.

    text : (n,) uint8;  first, stop : int
    returns: float64, int, bool, bool   the value, the byte after it, whether the token was plain
        and ended in white space before `stop` (else the rest means nothing), whether it had a point
    errors : none; what is not plain is for parse_number
    source : Clinger 1990, the exact case
    """
    i, negative, point, digits, places, mantissa = first, False, False, 0, 0, U0
    if i < stop and text[i] == 45:
        negative = True
        i += 1
    while i < stop:
        c = text[i]
        if 48 <= c <= 57:
            mantissa = mantissa * U10 + np.uint64(c - 48)
            digits += 1
            places += 1 if point else 0
        elif c == 46 and not point:
            point = True
        else:
            break
        i += 1
    ended = i < stop and (text[i] == 32 or 9 <= text[i] <= 13)
    if not ended or digits == 0 or digits > 18 or mantissa > EXACT:
        return 0.0, i, False, point
    value = np.float64(mantissa)
    if places:
        value /= TENS[places]
    return (-value if negative else value), i, True, point
