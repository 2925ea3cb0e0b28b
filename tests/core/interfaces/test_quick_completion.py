"""Quick completion in compiled code, compared with the lenient decoder."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwt_interfaces import field_types
from rwt_interfaces.distro import JAZZY, NOETIC
from rwt_interfaces.field_types import FieldType
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.serialise.json import REJECTIONS, parse
from rwt_interfaces.structs import MessageType
from rwt_interfaces.validation.quick_completion import MOST_FIELDS

REGISTRIES = {"noetic": Registry(NOETIC), "jazzy": Registry(JAZZY)}
for _registry in REGISTRIES.values():
    _registry.add_text(
        "Header header\nfloat32 f\nfloat32[] fs\nfloat32[2] two\nuint64 n\nuint8[] data\nuint8[3] rgb\n"
        "geometry_msgs/PoseStamped pose\ngeometry_msgs/PoseStamped[] poses\ngeometry_msgs/Point32[2] pair\n"
        "time t\nduration d\nbool b\nstring s\nstring[] names"
        if _registry.distro is NOETIC
        else "std_msgs/Header header\nfloat32 f 0.1\nfloat32[] fs\nfloat32[2] two\nuint64 n 7\nuint8[] data\n"
        "uint8[3] rgb\ngeometry_msgs/PoseStamped pose\ngeometry_msgs/PoseStamped[] poses\n"
        "geometry_msgs/Point32[2] pair\nbuiltin_interfaces/Time t\nbuiltin_interfaces/Duration d\nbool b\n"
        "string<=4 s\nstring[] names\nstring from",
        "t_msgs/All",
    )

TYPES = (
    "t_msgs/All", "visualization_msgs/MarkerArray", "nav_msgs/Path", "sensor_msgs/LaserScan",
    "sensor_msgs/JointState", "tf2_msgs/TFMessage", "diagnostic_msgs/DiagnosticArray",
    "geometry_msgs/PoseWithCovarianceStamped", "std_msgs/Header", "std_msgs/Empty",
)  # fmt: skip


def now() -> int:
    return 5_000_000_007


def _values(type: FieldType) -> st.SearchStrategy[Any]:
    """Return values of clients for a field: mostly valid, sometimes odd."""
    match type:
        case field_types.Bool():
            return st.sampled_from([True, False, True, False, 1])
        case field_types.Int():
            return st.sampled_from([0, 1, type.high, type.low, 7, 7, type.high + 1, 1.0])
        case field_types.Float():
            return st.sampled_from([0.0, 1, 0.1, -2.5, None, 1e30, 1e300, "x"])
        case field_types.String():
            return st.sampled_from(["", "a", "é", "abc", "abcdef", 3])
        case field_types.Time():
            return st.sampled_from(
                [dict.fromkeys(type.keys, 5), {"secs": 1, "nsecs": 2}, {"sec": 1}, {}, "now"]
            )
        case field_types.Octets():
            length = type.length or 2
            return st.sampled_from(["AAAA", "", "AA==", "AQI=", [1] * length, [1, 2, 3]])
        case field_types.Message():
            return messages(type.type)
        case field_types.Array():
            most = min(type.length or type.bound or 3, 4)
            return st.lists(_values(type.element), min_size=0, max_size=most)


def messages(message: MessageType) -> st.SearchStrategy[dict[str, Any]]:
    """Messages with fields left out, and few other flaws."""
    fields = {slot.name: _values(slot.type) for slot in message.slots}
    return st.fixed_dictionaries({}, optional=fields)


def _outcome(message: MessageType, made: Any) -> tuple[object, ...]:
    """A message in every form."""
    payload = Payload(message, made)
    return bytes(payload.json()), bytes(payload.cbor()), bytes(payload.serialised())


@pytest.mark.parametrize("distro", REGISTRIES)
@pytest.mark.parametrize("name", TYPES)
@settings(max_examples=60)
@given(data=st.data())
def test_both_make_the_same(distro: str, name: str, data: st.DataObject) -> None:
    message = REGISTRIES[distro].message(name)
    raw = json.dumps(data.draw(messages(message))).encode()
    try:
        quick = message.complete_quickly(raw, now)
    except REJECTIONS:
        return
    assert _outcome(message, quick) == _outcome(message, message.decode_leniently(parse(raw), now))


INCOMPLETE = [
    ("nav_msgs/Path", {"poses": [{"pose": {"position": {"x": 1}}}] * 100}),
    ("visualization_msgs/MarkerArray", {"markers": [{"color": {"r": 0.1, "a": 1}, "scale": {"x": 1}}] * 10}),
    ("sensor_msgs/LaserScan", {"range_max": 0.1, "ranges": [0.1, None, 2]}),
    ("tf2_msgs/TFMessage", {"transforms": [{"child_frame_id": "a"}]}),
    ("t_msgs/All", {}),
]


@pytest.mark.parametrize(("name", "value"), INCOMPLETE)
def test_what_clients_leave_out_most_is_completed_in_compiled_code(name: str, value: object) -> None:
    message = REGISTRIES["jazzy"].message(name)
    completed: Any = message.complete_quickly(json.dumps(value).encode(), now)
    assert _outcome(message, completed) == _outcome(message, message.decode_leniently(value, now))


def test_headers_are_stamped_and_numbers_become_float32s() -> None:
    raw = b'{"header":{},"f":0.1,"fs":[0.1,null],"two":[0.1,0.2],"poses":[{}],"pair":[{"x":0.1},{}]}'
    payload = Payload.from_json(REGISTRIES["jazzy"].message("t_msgs/All"), raw, now)
    value: Any = payload.value()
    stamp = value.header.stamp
    assert (stamp.sec, stamp.nanosec) == (5, 7)
    assert value.poses[0].header.stamp == value.pose.header.stamp == stamp
    assert (value.t.sec, value.n) == (0, 7)
    nearest = 0.10000000149011612
    assert value.f == value.fs[0] == value.two[0] == value.pair[0].x == nearest
    assert math.isnan(value.fs[1])


def test_objects_of_which_each_may_leave_out_much_are_counted_first() -> None:
    message = REGISTRIES["jazzy"].message("visualization_msgs/MarkerArray")
    few = MOST_FIELDS // 1000
    with_few = b'{"markers":[' + b",".join([b"{}"] * few) + b"]}"
    assert message.complete_quickly(with_few, now)
    with_many = b'{"markers":[' + b",".join([b"{}"] * MOST_FIELDS) + b"]}"
    with pytest.raises(REJECTIONS):
        message.complete_quickly(with_many, now)
