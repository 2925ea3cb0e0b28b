"""Message classes behave as rosidl's do."""

import array
import copy
import importlib
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_rclpy.endpoints.serialization import deserialize_message, message_of, payload_of, serialize_message
from rwt_rclpy.messages.classes import MessageClasses
from rwt_rclpy.messages.loaded import classes, message_class

ALL = """
bool flag
byte octet
char letter
int8 small
uint64 large
float32 single
float64 double_
string text
string<=3 short_text
byte[] octets
uint8[] data
uint8[4] id
int32[] numbers
int32[<=3] few
float64[3] vector
bool[2] flags
string[] words
geometry_msgs/Point[] points
int16 counted 7
string[] named ["a", "b"]
int32 LIMIT=5
string WORD=hello
"""


@pytest.fixture(scope="module")
def made() -> MessageClasses:
    registry = Registry()
    registry.add_text(ALL, "my_msgs/Everything")
    return MessageClasses(registry)


def everything(made: MessageClasses, **fields: Any) -> Any:
    return made.message("my_msgs/Everything")(**fields)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("flag", 1),
        ("octet", b"ab"),
        ("small", 128),
        ("small", 1.0),
        ("large", -1),
        ("single", 1e39),
        ("double_", 1),
        ("text", 5),
        ("short_text", "four"),
        ("octets", [1]),
        ("data", [256]),
        ("data", "text"),
        ("data", array.array("i")),
        ("id", [1, 2, 3]),
        ("few", [1, 2, 3, 4]),
        ("vector", np.zeros(4)),
        ("vector", np.zeros(3, np.float32)),
        ("flags", [True]),
        ("words", [1]),
        ("points", ["here"]),
    ],
)
def test_checks_refuse_what_does_not_fit(made: MessageClasses, field: str, value: object) -> None:
    message = everything(made, check_fields=True)
    with pytest.raises(AssertionError, match=f"^The '{field}' "):
        setattr(message, field, value)


def test_checks_refuse_unknown_fields(made: MessageClasses) -> None:
    with pytest.raises(AssertionError, match="Invalid arguments passed to constructor: nowhere"):
        everything(made, nowhere=1, check_fields=True)


def test_nothing_is_checked_by_default(made: MessageClasses) -> None:
    message = everything(made, text=5, small=128, nowhere=1)
    assert (message.text, message.small) == (5, 128)


def test_checks_are_made_up_for_when_a_message_is_sent(made: MessageClasses) -> None:
    message = everything(made, text=5, check_fields=False)
    with pytest.raises(AssertionError, match="text"):
        payload_of(message)


def test_through_the_graph_and_back(made: MessageClasses) -> None:
    point = made.message("geometry_msgs/Point")(z=2.0)
    message = everything(
        made,
        octet=b"\x07",
        octets=[b"a", b"b"],
        data=b"\1\2\3",
        id=[1, 2, 3, 4],
        numbers=list(range(100)),
        few=[1],
        single=0.5,
        vector=[1.0, 2.0, 3.0],
        flags=[True, False],
        words=["eins", "zwei"],
        points=[point],
    )
    payload = payload_of(message)
    assert message_of(payload, type(message)) == message
    by_wire = Payload.from_json(payload.type, payload.json())
    assert message_of(by_wire, type(message)) == message
    assert deserialize_message(serialize_message(message), type(message)) == message


def test_what_was_published_does_not_change_with_the_message(made: MessageClasses) -> None:
    message = everything(made, data=b"\1\2", numbers=list(range(100)), words=["a"])
    payload = payload_of(message)
    message.data[0] = 9
    message.numbers[0] = 9
    message.words.append("b")
    kept = message_of(payload, type(message))
    assert (kept.data[0], kept.numbers[0], kept.words) == (1, 0, ["a"])


def test_every_standard_interface_has_a_class() -> None:
    known = classes()
    for name in known.registry.names("msg"):
        cls = known.message(name)
        message = cls()
        assert message_of(payload_of(message), cls) == message
        assert copy.deepcopy(message) == message
    for name in known.registry.names("srv"):
        service: Any = known.service(name)
        assert service.Request() == service.Request() and service.Response()
    for name in known.registry.names("action"):
        action: Any = known.action(name)
        assert action.Impl.SendGoalService.Request(goal=action.Goal()).goal == action.Goal()


#: rosidl rejects the largest finite values of float32.
FLOATS = st.floats(width=32).filter(lambda value: not 3.402823466e38 < abs(value) < math.inf)


@given(st.lists(FLOATS, max_size=40), st.text(max_size=20))
def test_any_floats_and_text(numbers: list[float], text: str) -> None:
    cloud = message_class("sensor_msgs/ChannelFloat32")(name=text, values=numbers)
    back: Any = message_of(payload_of(cloud), type(cloud))
    assert back.name == text and back.values.tobytes() == cloud.values.tobytes()


def test_modules_of_messages() -> None:
    package = importlib.import_module("std_msgs.msg")
    assert "String" in dir(package) and package.String is message_class("std_msgs/String")
    assert importlib.import_module("std_msgs.msg._string").String is package.String
    assert package.String.__module__ == "std_msgs.msg._string"
    with pytest.raises(ImportError):
        importlib.import_module("std_msgs.msg.nothing_such")
    with pytest.raises(AttributeError, match="did you mean"):
        _ = package.Strin


@pytest.mark.parametrize(
    "name",
    [
        "action/Fibonacci_Goal",
        "action/Fibonacci_FeedbackMessage",
        "action/Fibonacci_SendGoal_Request",
        "action/Fibonacci_SendGoal_Event",
        "srv/AddTwoInts_Event",
    ],
)
def test_parts_of_interfaces_by_type_name(name: str) -> None:
    found = classes().by_type_name(f"example_interfaces/{name}")
    assert found is message_class(f"example_interfaces/{name.partition('/')[2]}")


def test_services_are_not_made() -> None:
    service: Any = importlib.import_module("std_srvs.srv").SetBool
    with pytest.raises(NotImplementedError, match="Request"):
        service()
