"""Decimal text to binary64: Python's float() is the oracle, and it never loses."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gstream.kernels.numbers import BAD, READ, SLOW, parse_number, plain_number


def _parse(text: str) -> tuple[float, int]:
    data = np.frombuffer(text.encode(), np.uint8)
    return parse_number(data, 0, len(data))


def _bits(value: float) -> bytes:
    return struct.pack("<d", value)


def _check(text: str) -> None:
    value, status = _parse(text)
    assert status in (READ, SLOW)
    if status == READ:
        assert _bits(value) == _bits(float(text)), text
    data = np.frombuffer((text + "\n").encode(), np.uint8)
    value, end, plain, _ = plain_number(data, 0, len(data))
    if plain:
        assert end == len(text)
        assert _bits(value) == _bits(float(text)), text


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_shortest_decimals_give_the_same_bits_as_python(value):
    _check(repr(value))
    _check(f"{value:.18e}")


@given(st.floats(-1e6, 1e6), st.integers(0, 30))
def test_fixed_decimals_give_the_same_bits_as_python(value, places):
    _check(f"{value:.{places}f}")


@given(st.integers(0, 2**64 - 1), st.integers(-400, 400))
def test_any_mantissa_and_exponent_give_the_same_bits_as_python(mantissa, exponent):
    _check(f"{mantissa}e{exponent}")


@given(
    st.from_regex(
        r"[+-]?([0-9]{1,25}\.?[0-9]{0,25}|\.[0-9]{1,25})(e[+-]?[0-9]{1,3})?", fullmatch=True
    )
)
def test_any_well_formed_decimal_gives_the_same_bits_as_python(text):
    _check(text)


@given(st.integers(2**53, 2**62), st.integers(0, 10))
def test_half_way_cases_round_to_even_as_in_python(whole, shift):
    half = (whole >> shift << shift) + (1 << shift >> 1)
    _check(str(half))
    _check(f"{half}.0")
    _check(f"{half}e-5")


@given(st.text(st.sampled_from("0123456789+-.eEnaNIf#xd,_/ \0"), max_size=8))
def test_text_that_python_refuses_is_never_read_as_a_number(text):
    value, status = _parse(text)
    try:
        expected = float(text.strip())
    except ValueError:
        assert status == BAD or not np.isfinite(value)
    else:
        if status == READ and np.isfinite(expected):
            assert _bits(value) == _bits(expected)


@pytest.mark.parametrize(
    "text", ["nan", "NaN", "-nan", "nan(ind)", "1.#QNAN", "-1.#IND00", "1.#SNAN"]
)
def test_every_spelling_of_nan_is_nan(text):
    value, status = _parse(text)
    assert status == READ
    assert np.isnan(value)


@pytest.mark.parametrize(
    "text", ["inf", "+Inf", "-inf", "infinity", "-INFINITY", "1.#INF", "-1.#INF00"]
)
def test_every_spelling_of_infinity_is_infinite(text):
    value, status = _parse(text)
    assert status == READ
    assert value == (-np.inf if text[0] == "-" else np.inf)


@pytest.mark.parametrize(
    "text", ["0x10", "1e", "1e+", "+", "-", ".", "", "1_0", "1,5", "1d5", "1..2", "e5", "3.1+e2"]
)
def test_what_is_no_decimal_number_is_refused(text):
    assert _parse(text)[1] == BAD


@pytest.mark.parametrize("text", ["1e400", "1e-400", "5e-324", "9007199254740993.0000000001"])
def test_what_the_rules_cannot_round_is_left_to_python(text):
    assert _parse(text)[1] == SLOW


@given(st.floats(-1e15, 1e15), st.integers(15, 40))
def test_numbers_of_more_than_19_digits_give_the_same_bits_as_python(value, places):
    _check(f"{value:.{places}f}")
    _check(f"{value:.{places}e}")


def test_numbers_of_more_than_19_digits_seldom_need_python():
    slow = [_parse(f"{i / 7:.25f}")[1] for i in range(1, 500)]
    assert slow.count(SLOW) <= 5
