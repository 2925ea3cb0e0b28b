"""Structs compiled from definitions."""

from __future__ import annotations

import math
from typing import Any

from rwt_interfaces.distro import NOETIC
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry


def struct(name: str, registry: Registry | None = None) -> Any:
    return (registry or Registry()).message(name).struct


def test_a_struct_without_arguments_is_a_complete_message() -> None:
    odometry = struct("nav_msgs/Odometry")()
    assert odometry.header.frame_id == ""
    assert odometry.pose.covariance == [0.0] * 36
    assert odometry.twist.twist.linear.x == 0.0


def test_defaults_are_not_shared_between_messages() -> None:
    odometry = struct("nav_msgs/Odometry")
    first, second = odometry(), odometry()
    first.pose.covariance[0] = 1.0
    first.header.frame_id = "odom"
    assert second == odometry()


def test_fields_are_in_the_definitions_order_and_repr_shows_them() -> None:
    twist = struct("geometry_msgs/Twist")
    assert twist.__struct_fields__ == ("linear", "angular")
    assert repr(struct("geometry_msgs/Point")(1.0, y=2.0)) == "Point(x=1.0, y=2.0, z=0.0)"


def test_the_distribution_decides_about_headers() -> None:
    assert struct("std_msgs/Header").__struct_fields__ == ("stamp", "frame_id")
    noetic = struct("std_msgs/Header", Registry(NOETIC))
    assert noetic.__struct_fields__ == ("seq", "stamp", "frame_id")
    assert noetic().stamp.__struct_fields__ == ("secs", "nsecs")


def test_a_field_named_like_a_keyword_gets_an_underscore_in_python_only() -> None:
    registry = Registry()
    registry.add_text("string from\nint32 lambda", "my_msgs/Mail")
    mail = registry.message("my_msgs/Mail")
    message = struct("my_msgs/Mail", registry)(from_="me", lambda_=3)
    assert Payload.from_value(mail, message).json() == b'{"from":"me","lambda":3}'
    assert Payload.from_json(mail, b'{"from":"me"}').value() == struct("my_msgs/Mail", registry)("me", 0)


def test_the_definitions_own_defaults_are_used_and_not_shared() -> None:
    registry = Registry()
    registry.add_text('int32 n 7\nstring s "hi"\nfloat64[3] v [1, 2, 3]\nuint8[] b [1, 2]', "my_msgs/D")
    kind = registry.message("my_msgs/D")
    message = struct("my_msgs/D", registry)()
    assert (message.n, message.s, message.v, message.b) == (7, "hi", [1.0, 2.0, 3.0], b"\x01\x02")
    message.v[0] = 9.0
    assert struct("my_msgs/D", registry)().v == [1.0, 2.0, 3.0]
    assert Payload.from_json(kind, b"{}").json() == b'{"n":7,"s":"hi","v":[1.0,2.0,3.0],"b":"AQI="}'


def test_a_time_is_one_struct_wherever_it_occurs() -> None:
    registry = Registry()
    assert type(struct("std_msgs/Header", registry)().stamp) is struct("builtin_interfaces/Time", registry)


def test_fingerprints() -> None:
    assert Registry(NOETIC).message("std_msgs/Header").md5 == "2176decaecbce78abc3b96ef049fabed"
    assert Registry().message("std_msgs/String").rihs01.startswith("RIHS01_df668c74")


def test_a_default_of_a_float32_is_a_float32() -> None:
    registry = Registry()
    registry.add_text("float32 x 3.14\nfloat32[2] a [0.1, 1e300]\nfloat64 y 3.14", "t_msgs/Defaults")
    message_type = registry.message("t_msgs/Defaults")
    value: Any = message_type.struct()
    assert (value.x, value.a, value.y) == (3.140000104904175, [0.10000000149011612, math.inf], 3.14)
    sent = bytes(Payload.from_value(message_type, {}).json())
    assert bytes(Payload.from_json(message_type, sent).json()) == sent
