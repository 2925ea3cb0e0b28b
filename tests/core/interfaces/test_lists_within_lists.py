"""Long lists, also of texts and within items of others, are encoded in steps, to what they are encoded to at
once."""

from __future__ import annotations

from typing import Any

import pytest

from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from tests.conftest import counted

HEADER = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "map"}
STATUS = {
    "level": 1, "name": "n", "message": "é", "hardware_id": "",
    "values": [{"key": f"k{n}", "value": "v" * (n % 9)} for n in range(500)],
}  # fmt: skip
MESSAGES: dict[str, dict[str, Any]] = {
    "diagnostic_msgs/DiagnosticArray": {"header": HEADER, "status": [STATUS, {**STATUS, "values": []}] * 2},
    "sensor_msgs/JointState": {"header": HEADER, "name": [f"joint{n}" for n in range(300)]},
    "trajectory_msgs/JointTrajectory": {
        "header": HEADER,
        "joint_names": ["a", "bc"] * 70,
        "points": [{"positions": [0.5] * 100, "time_from_start": {"sec": 3, "nanosec": 4}}] * 3,
    },
}


@pytest.mark.parametrize("form", ["cbor", "cdr", "ros1"])
@pytest.mark.parametrize("name", MESSAGES)
def test_steps_make_what_is_made_at_once(name: str, form: Any) -> None:
    type = Registry().message(name)
    payload = Payload.from_value(type, MESSAGES[name])
    assert payload.is_long
    parts, taken = counted(type.step_encoder(form)(payload.value(), {}))
    encode, _ = type.binary_encoder(form)
    assert b"".join(parts) == encode(payload.value())
    assert taken > 4


def test_a_short_list_is_none() -> None:
    type = Registry().message("diagnostic_msgs/DiagnosticArray")
    assert not Payload.from_value(type, {"status": [{**STATUS, "values": []}]}).is_long
    assert Registry().message("geometry_msgs/Twist").holds_long_list is None


def test_numbers_are_widened_to_a_bound() -> None:
    numpy = pytest.importorskip("numpy")
    type = Registry().message("std_msgs/Float64MultiArray")
    assert Payload.from_value(type, {"data": numpy.zeros(1 << 20, "<f2")})
    assert Payload.from_value(type, {"data": numpy.zeros(3 << 20, "<f4")})
    with pytest.raises(InvalidMessage, match=r"got 3145728 of float16: send so many as float64"):
        Payload.from_value(type, {"data": numpy.zeros(3 << 20, "<f2")})
