"""Definitions, names and messages."""

from __future__ import annotations

from collections.abc import Callable

from rwt_graph.errors import GraphError
from rwt_graph.names import parameter_name, resolve, split_parameter, validate
from rwt_interfaces.distro import JAZZY, NOETIC
from rwt_interfaces.errors import InterfaceError, InvalidMessage
from rwt_interfaces.names import Kind, parse_type_name, three_part
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from rwt_transports.errors import BadUrl
from rwt_transports.schemes import parse_listen_url

_KINDS: tuple[Kind, ...] = ("msg", "srv", "action")
_JAZZY, _NOETIC = Registry(JAZZY), Registry(NOETIC)
_JAZZY.add_text(
    "bool b\nchar c\nstring<=5 s\nwstring w\nint64[<=3] i\nfloat32[2] f\nuint8[] u\nbyte[3] k\nstring[] t\n"
    "geometry_msgs/Point[] p\nbuiltin_interfaces/Duration d\n",
    "fuzz_msgs/All",
)

TYPES: tuple[MessageType, ...] = (
    _JAZZY.message("fuzz_msgs/All"),
    _JAZZY.message("sensor_msgs/Image"),
    _JAZZY.message("nav_msgs/Odometry"),
    _JAZZY.message("sensor_msgs/JointState"),
    _JAZZY.message("diagnostic_msgs/DiagnosticArray"),
    _JAZZY.message("visualization_msgs/Marker"),
    _JAZZY.message("rcl_interfaces/ParameterValue"),
    _NOETIC.message("std_msgs/Header"),
    _NOETIC.message("sensor_msgs/LaserScan"),
    _NOETIC.message("std_msgs/Float64MultiArray"),
    _NOETIC.message("actionlib_tutorials/FibonacciActionGoal"),
)
"""Types that between them have every kind of field; the first byte of an input chooses one."""


def _now() -> int:
    return 1_700_000_000_000_000_000


def _decode(data: bytes, read: Callable[[MessageType, bytes], Payload]) -> None:
    message_type = TYPES[data[0] % len(TYPES)]
    try:
        payload = read(message_type, data[1:])
    except InvalidMessage as error:
        assert 0 < len(str(error)) < 2_000
        return
    _round_trip(payload)


def _round_trip(payload: Payload) -> None:
    """Encode an accepted message in every form, and check that each reads back the same."""
    message_type = payload.type
    text = bytes(payload.json())
    again = Payload.from_json(message_type, text, _now)
    assert bytes(again.json()) == text
    binary = payload.serialised()
    assert Payload.deserialised(message_type, binary).serialised() == binary


def payload_json(data: bytes) -> None:
    """A message in JSON."""
    _decode(data, lambda message_type, raw: Payload.from_json(message_type, raw, _now))


def payload_args(data: bytes) -> None:
    """A service's arguments in JSON, by name or by position."""
    _decode(data, lambda message_type, raw: Payload.from_args(message_type, raw, _now))


def payload_cdr(data: bytes) -> None:
    """A message in CDR."""
    _decode(data, Payload.from_cdr)


def payload_ros1(data: bytes) -> None:
    """A message in ROS 1's form."""
    _decode(data, Payload.from_ros1)


def definition(data: bytes) -> None:
    """The text of a definition; the first byte chooses the kind and the distribution."""
    registry = Registry(NOETIC if data[0] & 4 else JAZZY)
    kind = _KINDS[data[0] % 3]
    try:
        registry.add_text(data[1:].decode("utf-8", "replace"), "fuzz_msgs/Thing", kind)
        parts = _parts(registry, kind)
        for part in parts:
            text = bytes(Payload.from_value(part, {}, _now).json())
            assert bytes(Payload.from_json(part, text, _now).json()) == text
            registry.full_text(part)
            assert len(part.md5) == 32
    except InterfaceError as error:
        assert str(error)


def _parts(registry: Registry, kind: Kind) -> tuple[MessageType, ...]:
    if kind == "msg":
        return (registry.message("fuzz_msgs/Thing"),)
    if kind == "srv":
        service = registry.service("fuzz_msgs/Thing")
        return service.request, service.response
    action = registry.action("fuzz_msgs/Thing")
    return action.goal, action.result, action.feedback


def names(data: bytes) -> None:
    """Names and URLs, as operators and clients write them."""
    text = data.decode("utf-8", "replace")
    _refuse_cleanly(parse_type_name, text)
    _refuse_cleanly(lambda name: three_part(name, "msg"), text)
    _refuse_cleanly(lambda name: validate(resolve(name, "/robot", "/robot/node")), text)
    _refuse_cleanly(parameter_name, text)
    _refuse_cleanly(split_parameter, text)
    _refuse_cleanly(parse_listen_url, text)


def _refuse_cleanly(read: Callable[[str], object], text: str) -> None:
    try:
        read(text)
    except (InterfaceError, GraphError, BadUrl) as error:
        assert str(error)
