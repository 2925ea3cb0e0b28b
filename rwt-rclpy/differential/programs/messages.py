"""Classes of messages, their fields, and serialization."""

import array
import copy
import pickle
from typing import Any

import builtin_interfaces.msg
import numpy
from geometry_msgs.msg import PoseWithCovariance, Twist, Vector3
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, Imu, JointState, PointCloud2, PointField
from std_msgs.msg import (
    ColorRGBA,
    Float32MultiArray,
    Header,
    Int8,
    Int32,
    String,
    UInt8,
    UInt8MultiArray,
)
from std_srvs.srv import SetBool
from test_msgs.msg import (
    Arrays,
    BasicTypes,
    BoundedPlainSequences,
    BoundedSequences,
    Builtins,
    Constants,
    Defaults,
    Empty,
    Nested,
    Strings,
    UnboundedSequences,
    WStrings,
)

from differential.steps import public, tell

ALL = (
    Arrays,
    BasicTypes,
    BoundedPlainSequences,
    BoundedSequences,
    Builtins,
    Constants,
    Defaults,
    Empty,
    Nested,
    Strings,
    UnboundedSequences,
    WStrings,
)


def defaults() -> None:
    """Default values as text."""
    numpy.set_printoptions(linewidth=10_000)
    for each in ALL:
        print(each())


def text() -> None:
    """Messages as text."""
    for message in (
        Twist(linear=Vector3(x=1.0)),
        Header(frame_id="it's"),
        JointState(name=["a"], position=[1.0, 2.0]),
        UInt8MultiArray(data=[1, 2]),
        PoseWithCovariance(),
        String(data="a\n'\"ä"),
        ColorRGBA(r=0.1),
        Float32MultiArray(data=[0.1]),
        SetBool.Request(data=True),
    ):
        print(message)
        print(repr(message) == str(message))


def subclass_text() -> None:
    """A subclass as text."""

    class Mine(String):
        """A subclass."""

    print(Mine(data="a"), isinstance(Mine(), String), Mine() == String())


def attributes() -> None:
    """Public attributes."""
    for each in (*ALL, Twist, SetBool.Request):
        print(each.__name__, public(each))


def slots() -> None:
    """Slots and types of slots."""
    for each in (*ALL, Twist, Header):
        print(each.__name__, each.__slots__, each.SLOT_TYPES)


def field_types() -> None:
    """Fields and their types as text."""
    for each in (*ALL, Twist, Image):
        print(each.get_fields_and_field_types())


def modules() -> None:
    """Names of classes and modules."""
    for each in (String, SetBool, SetBool.Request, SetBool.Event, Twist):
        print(each.__name__, each.__module__, each.__qualname__, type(each).__name__)
    print(String.__doc__, String.__hash__)


def constants() -> None:
    """Constants."""
    for name in public(Constants):
        if name.isupper():
            print(name, repr(getattr(Constants, name)), repr(getattr(Constants(), name)))
    tell("set", lambda: setattr(Constants, "BOOL_CONST", False))
    tell("set on instance", lambda: setattr(Constants(), "BOOL_CONST", False))
    print(PointField.FLOAT32, PointField().FLOAT32)


def default_constants() -> None:
    """Defaults as constants."""
    for name in public(Defaults):
        if "DEFAULT" in name:
            print(name, repr(getattr(Defaults, name)))
    for name in ("BOOL_VALUE__DEFAULT", "INT8_VALUE__DEFAULT"):
        tell(name, lambda n=name: getattr(Defaults, n))
        tell(f"{name} on instance", lambda n=name: getattr(Defaults(), n))


BASIC: tuple[tuple[str, tuple[Any, ...]], ...] = (
    ("bool_value", (True, 1, None, "a", numpy.bool_(True))),
    ("byte_value", (b"a", 1, "a", b"ab", b"")),
    ("char_value", (0, 255, 256, -1, "a", b"a")),
    (
        "float32_value",
        (1.5, 1, 1e39, float("inf"), float("nan"), "1", numpy.float32(1), numpy.float64(1), True),
    ),
    ("float64_value", (1.5, 1, 1e308, "1", numpy.float32(1), numpy.float64(1))),
    ("int8_value", (-128, 127, 128, -129, 1.0, "1", True, numpy.int8(1), numpy.int64(1))),
    ("uint8_value", (0, 255, 256, -1, 1.0, numpy.uint8(1))),
    ("int64_value", (-(2**63), 2**63 - 1, 2**63, 1.0)),
    ("uint64_value", (0, 2**64 - 1, 2**64, -1)),
)


def assignment() -> None:
    """Assignment of values, as fields are checked by default."""
    for name, values in BASIC:
        message = BasicTypes()
        for value in values:
            tell(f"{name} = {value!r}", setattr, message, name, value)
            print(repr(getattr(message, name)))


def assignment_checked() -> None:
    """Assignment of values with checks."""
    for name, values in BASIC:
        message = BasicTypes(check_fields=True)
        for value in values:
            tell(f"{name} = {value!r}", setattr, message, name, value)


def constructor_checked() -> None:
    """The argument that checks fields."""
    tell("wrong", lambda: String(data=1, check_fields=True))
    tell("right", lambda: String(data="1", check_fields=True))
    tell("off", lambda: str(String(data="1", check_fields=False)))
    tell("unknown", lambda: String(other=1, check_fields=True))


def constructor() -> None:
    """Arguments of constructors."""
    tell("unknown", lambda: String(other=1))
    tell("positional", lambda: String("a"))
    tell("wrong type", lambda: String(data=1).data)
    tell("none", lambda: String(data=None).data)
    tell("dictionary", lambda: Twist(linear={"x": 1.0}).linear)
    tell("other message", lambda: Twist(linear=String()).linear)


def wrong_values_are_published() -> None:
    """A wrong value fails when the message is converted."""
    tell("string", lambda: serialize_message(String(data=1)))
    tell("integer", lambda: serialize_message(Int32(data="a")))
    tell("wrapped", lambda: deserialize_message(serialize_message(Int8(data=200)), Int8))
    tell("wrapped", lambda: deserialize_message(serialize_message(UInt8(data=256)), UInt8))
    tell("float", lambda: serialize_message(Int32(data=1.5)))
    tell("nested", lambda: serialize_message(Twist(linear=String())))


def sequences() -> None:
    """Sequences of numbers."""
    message = UnboundedSequences()
    for value in ([1, 2], (1, 2), array.array("i", [1, 2]), numpy.array([1, 2], dtype=numpy.int32),
                  numpy.array([1, 2]),
                  range(2), {1}, "ab", b"ab", [1.5], [None], 1, None):  # fmt: skip
        tell(repr(value), setattr, message, "int32_values", value)
        print(type(message.int32_values).__name__, repr(message.int32_values))


def sequences_checked() -> None:
    """Sequences of numbers with checks."""
    message = UnboundedSequences(check_fields=True)
    for value in ([1, 2], (1, 2), array.array("i", [1, 2]), array.array("d", [1.0]), numpy.array([1, 2],
                  numpy.int32),
                  numpy.array([1, 2]), range(2), {1}, "ab", b"ab", [1.5], [None], [2**31], 1,
                  None):  # fmt: skip
        tell(repr(value), setattr, message, "int32_values", value)


def sequences_of_octets() -> None:
    """Octets."""
    for value in ([1, 2], b"ab", bytearray(b"ab"), memoryview(b"ab"), numpy.array([1, 2], numpy.uint8),
                  numpy.array([1, 2]), array.array("B", [1]), [256], [-1], "ab"):  # fmt: skip
        message = UInt8MultiArray()
        tell(repr(value)[:20], setattr, message, "data", value)
        print(type(message.data).__name__)


def fixed_arrays() -> None:
    """Arrays of fixed length."""
    message = PoseWithCovariance()
    print(type(message.covariance).__name__, message.covariance.dtype, len(message.covariance))
    _set_covariances(message)


def fixed_arrays_checked() -> None:
    """Arrays of fixed length with checks."""
    _set_covariances(PoseWithCovariance(check_fields=True))


def _set_covariances(message: PoseWithCovariance) -> None:
    for value in (
        [0.0] * 36,
        [0.0] * 35,
        numpy.zeros(36),
        numpy.zeros(35),
        numpy.zeros(36, numpy.float32),
        None,
        [0] * 36,
    ):
        tell(type(value).__name__, setattr, message, "covariance", value)
        print(type(message.covariance).__name__)


def bounded_sequences() -> None:
    """Bounded sequences and strings."""
    for checked in (False, True):
        message = BoundedSequences(check_fields=checked)
        tell("short", setattr, message, "int32_values", [1, 2, 3])
        tell("long", setattr, message, "int32_values", [1, 2, 3, 4])
        tell("text", setattr, message, "string_values", ["a"] * 4)
        tell("not text", setattr, message, "string_values", [1])
        other = Strings(check_fields=checked)
        tell("long text", setattr, other, "bounded_string_value", "a" * 23)


def arrays_are_copied() -> None:
    """Arguments of a constructor are copied."""
    numbers = numpy.zeros(36)
    pose = PoseWithCovariance(covariance=numbers)
    numbers[0] = 5
    print(pose.covariance[0])
    position = array.array("d", [1.0])
    state = JointState(position=position, name=["a"])
    position.append(2.0)
    print(len(state.position))
    names = ["a"]
    state.name = names
    names.append("b")
    print(state.name)
    values = [1.0]
    state.velocity = values
    values.append(2.0)
    print(state.velocity)


def assigned_arrays() -> None:
    """Assignment of arrays shares them or not."""
    pose = PoseWithCovariance()
    numbers = numpy.zeros(36)
    pose.covariance = numbers
    numbers[0] = 5
    print(pose.covariance[0])
    state = JointState()
    position = array.array("d", [1.0])
    state.position = position
    position.append(2.0)
    print(len(state.position))


def default_arrays_are_independent() -> None:
    """Each message has its own."""
    first, second = JointState(), JointState()
    first.name.append("a")
    first.position.append(1.0)
    print(second.name, second.position, JointState().name)


def nested_messages_are_shared() -> None:
    """A nested message is the one that was assigned."""
    vector = Vector3(x=1.0)
    twist = Twist(linear=vector)
    vector.x = 2.0
    print(twist.linear.x, twist.linear is vector)


def equality() -> None:
    """Comparison of messages."""
    print(String(data="a") == String(data="a"), String(data="a") != String(data="b"), String() == Int32())
    print(String() == "", Twist() == Twist(), PoseWithCovariance() == PoseWithCovariance())
    print(JointState(position=[1.0]) == JointState(position=[1.0]))
    tell("hash", lambda: hash(String()))


def copies() -> None:
    """Copies and pickles."""
    message = Imu()
    message.header.frame_id = "a"
    message.orientation_covariance[0] = 1.0
    for made in (copy.copy(message), copy.deepcopy(message)):
        print(made == message, made.header is message.header)
    tell("pickle", lambda: pickle.loads(pickle.dumps(message)) == message)


def unknown_attributes() -> None:
    """Fields that do not exist."""
    tell("set", setattr, String(), "other", 1)
    tell("get", lambda: String().other)
    tell("delete", lambda: delattr(String(), "data"))


def serialized() -> None:
    """Bytes of messages."""
    for message in (
        String(data="a"),
        Twist(linear=Vector3(x=1.5)),
        Header(frame_id="map"),
        JointState(name=["a", "bc"], position=[1.0]),
        BasicTypes(int8_value=-1, string_value="ä"),
        UInt8MultiArray(data=[1, 2, 3]),
        Empty(),
        Defaults(),
        Strings(),
        Image(width=2, data=[1, 2]),
        PointCloud2(),
        WStrings(wstring_value="aä"),
    ):
        octets = serialize_message(message)
        # Without the padding, which the real one does not clear.
        print(type(message).__name__, type(octets).__name__, octets[:4].hex())
        print(deserialize_message(octets, type(message)) == message)


def deserialized_wrong() -> None:
    """Bytes that do not fit."""
    for octets in (b"", b"\x00", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00\xff\xff\xff\xff", "text", None):
        tell(octets, deserialize_message, octets, String)


def deserialized_types() -> None:
    """Types of fields of a message that was received."""
    state = deserialize_message(serialize_message(JointState(name=["a"], position=[1.0])), JointState)
    print(type(state.name).__name__, type(state.position).__name__)
    pose = deserialize_message(serialize_message(PoseWithCovariance()), PoseWithCovariance)
    print(type(pose.covariance).__name__, pose.covariance.flags.writeable)
    image = deserialize_message(serialize_message(Image(data=[1])), Image)
    print(type(image.data).__name__)
    basic = deserialize_message(serialize_message(BasicTypes()), BasicTypes)
    print(
        type(basic.byte_value).__name__, type(basic.float32_value).__name__, type(basic.bool_value).__name__
    )


def float32_precision() -> None:
    """Numbers of 32 bits keep their digits until they are sent."""
    message = ColorRGBA(r=0.1)
    print(message.r, deserialize_message(serialize_message(message), ColorRGBA).r)


def strings_in_sequences() -> None:
    """Sequences of strings."""
    for value in (["a"], ("a",), "ab", [1], numpy.array(["a"]), {"a"}, b"a", None):
        message = JointState()
        tell(repr(value), setattr, message, "name", value)
        print(repr(message.name))


def messages_in_sequences() -> None:
    """Sequences of messages."""
    for value in ([PointField()], (PointField(),), [String()], [None], PointField(), None):
        message = PointCloud2()
        tell(type(value).__name__, setattr, message, "fields", value)


def metaclasses() -> None:
    """Type support of classes."""
    tell("support", String.__class__.__import_type_support__)
    print(String.__class__._TYPE_SUPPORT is not None, SetBool.__class__.__name__)
    print(builtin_interfaces.msg.Time.__name__)


def packages() -> None:
    """Packages of messages."""
    import std_msgs
    import std_msgs.msg

    print(std_msgs.__name__, std_msgs.msg.__name__, "String" in dir(std_msgs.msg), hasattr(std_msgs, "msg"))
    tell("unknown", lambda: std_msgs.msg.Nothing)
    tell("module", lambda: __import__("std_msgs.msg._string").msg._string.String is String)


def environment_variable() -> None:
    """The variable that turns checks on is read at import."""
    import os

    os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
    tell("checked", lambda: String(data=1).data)
