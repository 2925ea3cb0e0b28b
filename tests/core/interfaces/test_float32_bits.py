"""Float32 numbers are recognised by their bits as a conversion recognises them."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_interfaces import field_types
from rwt_interfaces.validation.numbers import are_float32

_LIMIT = field_types.FLOAT32_LIMIT
_DOUBLES = st.floats(-_LIMIT, _LIMIT)
_FLOATS = st.floats(width=32, allow_nan=False, allow_infinity=False)


@given(
    st.lists(_FLOATS | st.sampled_from([0.0, -0.0, 1.0, -0.5]), max_size=40), st.lists(_DOUBLES, max_size=2)
)
def test_a_decision_is_that_of_a_conversion(floats: list[float], doubles: list[float]) -> None:
    numbers = floats + doubles
    assert are_float32(numbers) in (
        None,
        all(struct.unpack("f", struct.pack("f", x))[0] == x for x in numbers),
    )


@pytest.mark.parametrize("length", [0, 1, 15, 16, 65_535, 65_536])
def test_lists_of_any_length_are_decided(length: int) -> None:
    assert are_float32([0.0, -0.0, *[-1.5] * length]) is True
    assert are_float32([*[-1.5] * length, 0.1]) is False


@pytest.mark.parametrize("number", [2.0**-1010, -(2.0**-1010), 5e-324, 2.0**-130, None])
def test_the_smallest_numbers_and_null_are_left_to_a_closer_look(number: float | None) -> None:
    assert are_float32([0.0, number, 1.0]) is not True
