"""Memory of a message, estimated from its type and independent of its objects."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry

OBJECT, NUMBER = 56, 32
HEADER = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "map"}
OF_HEADER = OBJECT + (OBJECT + 2 * NUMBER) + OBJECT + 3

CASES: list[tuple[str, Any, int]] = [
    ("geometry_msgs/Twist", {}, 3 * OBJECT + 6 * NUMBER),
    ("std_msgs/String", {"data": "x" * 100}, 2 * OBJECT + 100),
    ("std_msgs/Header", HEADER, OF_HEADER),
    ("sensor_msgs/JointState", {"header": HEADER, "name": ["ab", "c"], "position": [0.5] * 3},
     OBJECT + OF_HEADER + (OBJECT + 2 * OBJECT + 3) + (OBJECT + 3 * NUMBER) + 2 * OBJECT),
    ("nav_msgs/Path", {"header": HEADER, "poses": [{"header": HEADER}] * 5},
     OBJECT + OF_HEADER + OBJECT + 5 * (OBJECT + OF_HEADER + 3 * OBJECT + 7 * NUMBER)),
    ("sensor_msgs/CompressedImage", {"header": HEADER, "format": "", "data": bytes(1000)},
     OBJECT + OF_HEADER + OBJECT + OBJECT + 1000),
]  # fmt: skip


@pytest.mark.parametrize(("name", "message", "size"), CASES, ids=[name for name, *_ in CASES])
def test_each_object_and_number_counts(name: str, message: Any, size: int) -> None:
    type = Registry().message(name)
    checked = Payload.from_value(type, message)
    own = Payload(type, checked.value())
    assert checked.kept_size == own.kept_size == size


def test_lists_within_items_count() -> None:
    type = Registry().message("visualization_msgs/MarkerArray")
    points = [{"x": 1.0, "y": 2.0, "z": 3.0}] * 100

    def size(markers: list[Any]) -> int:
        return Payload.from_value(type, {"markers": markers}).kept_size

    one = {"points": points}
    assert size([one, {}]) - size([{}, {}]) == 100 * (OBJECT + 3 * NUMBER)
    assert size([{}, one, one]) - size([{}, {}, {}]) == 200 * (OBJECT + 3 * NUMBER)


def test_numbers_in_an_array_of_numpy_count_what_they_take() -> None:
    type = Registry().message("std_msgs/Float64MultiArray")
    array = Payload.from_value(type, {"data": np.zeros(1000)})
    listed = Payload.from_value(type, {"data": [0.0] * 1000})
    assert listed.kept_size - array.kept_size == 1000 * (NUMBER - 8)
