"""Which messages are the ones that a test meant."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.testing import ScriptError
from rwt.extensions.testing.matching import mismatch
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry

REGISTRY = Registry()


def message(type_name: str, **fields: object) -> object:
    return Payload.from_value(REGISTRY.message(type_name), fields).value()


def test_some_fields_are_enough() -> None:
    twist = message("geometry_msgs/Twist", linear={"x": 0.5})
    assert mismatch(twist, None) == ""
    assert mismatch(twist, {"linear": {"x": 0.5}}) == ""
    assert mismatch(twist, {"linear": {"x": 0.5, "y": 0}, "angular": {}}) == ""


def test_the_first_difference_is_named_with_its_path() -> None:
    twist = message("geometry_msgs/Twist", linear={"x": 0.5})
    assert mismatch(twist, {"linear": {"x": 0.7}}) == "linear.x is 0.5, not 0.7"
    scan = message("sensor_msgs/LaserScan", ranges=[1.0, 2.0])
    assert mismatch(scan, {"ranges": [1.0, 3.0]}) == "ranges[1] is 2.0, not 3.0"
    assert mismatch(scan, {"ranges": [1.0]}) == "ranges has 2 items, not 1"


def test_what_was_rounded_to_32_bits_still_fits() -> None:
    payload = Payload.from_value(REGISTRY.message("std_msgs/Float32"), {"data": 0.1})
    through: Any = Payload.from_cdr(payload.type, payload.cdr()).value()
    assert through.data != 0.1
    assert mismatch(through, {"data": 0.1}) == ""


def test_an_unknown_field_is_an_error_that_names_the_nearest() -> None:
    with pytest.raises(ScriptError, match=r"`linear\.z1`; did you mean `z`"):
        mismatch(message("geometry_msgs/Twist"), {"linear": {"z1": 0}})


def test_a_function_decides_alone() -> None:
    twist = message("geometry_msgs/Twist", linear={"x": 0.5})
    assert mismatch(twist, lambda each: each.linear.x > 0.4) == ""
    assert mismatch(twist, lambda each: each.linear.x > 0.6) == "the function says no"


def test_a_flag_is_not_a_number_apart() -> None:
    flag = message("std_msgs/Bool", data=True)
    assert mismatch(flag, {"data": True}) == ""
    assert mismatch(flag, {"data": False}) == "data is True, not False"


@given(st.floats(width=32))
def test_every_float_fits_itself(value: float) -> None:
    assert mismatch(message("std_msgs/Float64", data=value), {"data": value}) == ""


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(allow_nan=False, allow_infinity=False))
def test_floats_that_differ_by_more_than_a_millionth_do_not_fit(one: float, other: float) -> None:
    apart = abs(one - other) > max(1e-9, 1e-6 * max(abs(one), abs(other)))
    assert math.isfinite(one)
    assert bool(mismatch(message("std_msgs/Float64", data=one), {"data": other})) == apart
