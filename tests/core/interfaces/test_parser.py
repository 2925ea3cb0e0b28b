"""Definitions as people write them, for either version of ROS."""

from __future__ import annotations

import math

import pytest

from rwt_interfaces.definitions.model import Constant, Field, WrittenType
from rwt_interfaces.definitions.parser import format_message, parse_action, parse_message, parse_service
from rwt_interfaces.distro import DISTROS, JAZZY, NOETIC, Distro
from rwt_interfaces.errors import DefinitionError, InvalidName


def only_field(text: str, distro: Distro = JAZZY) -> Field:
    (field,) = parse_message(text, "my_pkg/Thing", distro=distro).fields
    return field


def only_constant(text: str, distro: Distro = JAZZY) -> Constant:
    (constant,) = parse_message(text, "my_pkg/Thing", distro=distro).constants
    return constant


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("bool x", WrittenType("bool")),
        ("float64   x", WrittenType("float64")),
        ("\tint8\tx\t", WrittenType("int8")),
        ("wstring x", WrittenType("wstring")),
        ("string<=5 x", WrittenType("string", string_bound=5)),
        ("wstring<=5 x", WrittenType("wstring", string_bound=5)),
        ("uint8[] x", WrittenType("uint8", is_array=True)),
        ("float64[36] x", WrittenType("float64", is_array=True, length=36)),
        ("int32[<=3] x", WrittenType("int32", is_array=True, bound=3)),
        ("string<=5[<=3] x", WrittenType("string", string_bound=5, is_array=True, bound=3)),
        ("string<=5[2] x", WrittenType("string", string_bound=5, is_array=True, length=2)),
        ("Other x", WrittenType("my_pkg/Other")),
        ("Other[] x", WrittenType("my_pkg/Other", is_array=True)),
        ("geometry_msgs/Point x", WrittenType("geometry_msgs/Point")),
        ("geometry_msgs/msg/Point[2] x", WrittenType("geometry_msgs/Point", is_array=True, length=2)),
        ("Header x", WrittenType("std_msgs/Header")),
        ("std_msgs/Header x", WrittenType("std_msgs/Header")),
        ("byte x # why", WrittenType("byte")),
        ("byte x# why", WrittenType("byte")),
    ],
)
def test_field_types(text: str, expected: WrittenType) -> None:
    assert only_field(text) == Field("x", expected)
    assert only_field(text, distro=NOETIC) == Field("x", expected)


@pytest.mark.parametrize(
    ("distro", "text", "expected"),
    [
        (NOETIC, "time x", "time"),
        (NOETIC, "duration[] x", "duration"),
        (NOETIC, "builtin_interfaces/Time x", "time"),
        (NOETIC, "builtin_interfaces/msg/Duration[] x", "duration"),
        (JAZZY, "time x", "builtin_interfaces/Time"),
        (JAZZY, "duration[] x", "builtin_interfaces/Duration"),
        (JAZZY, "builtin_interfaces/Time x", "builtin_interfaces/Time"),
    ],
)
def test_each_version_has_its_own_time(distro: Distro, text: str, expected: str) -> None:
    assert only_field(text, distro).type.name == expected


def test_the_text_of_a_translated_definition_says_what_is_on_the_wire() -> None:
    definition = parse_message("# when\ntime stamp\n", "my_pkg/Thing")
    assert definition.text == "builtin_interfaces/Time stamp\n"
    assert parse_message("# when\ntime stamp\n", "my_pkg/Thing", distro=NOETIC).text == "# when\ntime stamp\n"


@pytest.mark.parametrize(
    ("text", "value", "written"),
    [
        ("int32 X=5", 5, "5"),
        ("int32 X = -5 # note", -5, "-5"),
        ("uint8 X=0xff", 255, "0xff"),
        ("uint8 X=0b101", 5, "0b101"),
        ("uint8 X=0o17", 15, "0o17"),
        ("uint8 X=007", 7, "007"),
        ("int64 X=-9223372036854775808", -(2**63), "-9223372036854775808"),
        ("uint64 X=18446744073709551615", 2**64 - 1, "18446744073709551615"),
        ("byte X=255", 255, "255"),
        ("char X=-1", -1, "-1"),
        ("float32 X=1", 1.0, "1"),
        ("float64 X=-1.5e-3 # small", -0.0015, "-1.5e-3"),
        ("float64 X=.5", 0.5, ".5"),
        ("float64 X=inf", math.inf, "inf"),
        ("bool X=true", True, "true"),
        ("bool X=False", False, "False"),
        ("bool X=1", True, "1"),
    ],
)
def test_numeric_constants(text: str, value: object, written: str) -> None:
    for distro in DISTROS.values():
        constant = only_constant(text, distro)
        assert (constant.name, constant.value, constant.text) == ("X", value, written)
        assert type(constant.value) is type(value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("string X=plain", "plain"),
        ("string X =  # not a comment ", "# not a comment"),
        ('string X="quoted" # and more', '"quoted" # and more'),
        ("string X=", ""),
        ("string X=a=b", "a=b"),
    ],
)
def test_a_string_constant_of_ros_1_is_the_rest_of_its_line(text: str, value: str) -> None:
    constant = only_constant(text, distro=NOETIC)
    assert (constant.value, constant.text) == (value, value)


@pytest.mark.parametrize(
    ("text", "value", "written"),
    [
        ('string X="a # b" # c', "a # b", '"a # b"'),
        ("string X='it\\'s'", "it's", "'it\\'s'"),
        ('string X="tab\\tline\\n"', "tab\tline\n", '"tab\\tline\\n"'),
        ("string X=bare word # c", "bare word", "bare word"),
        ("string<=3 X='abc'", "abc", "'abc'"),
        ("wstring X='ü'", "ü", "'ü'"),
    ],
)
def test_a_string_constant_of_ros_2_may_be_quoted(text: str, value: str, written: str) -> None:
    constant = only_constant(text)
    assert (constant.value, constant.text) == (value, written)


@pytest.mark.parametrize(
    ("text", "default"),
    [
        ("float64 w 1", 1.0),
        ("int8 status -2 # unknown", -2),
        ("bool on true", True),
        ("string name 'Ada'", "Ada"),
        ("string name Ada L. # bare", "Ada L."),
        ('string name "say \\"hi\\""', 'say "hi"'),
        ('string name "a=b"', "a=b"),
        ("string name ''", ""),
        ("int32[] xs [1, 2,3]", (1, 2, 3)),
        ("int32[] xs []", ()),
        ("float64[2] xs [ 1 , 2.5 ]", (1.0, 2.5)),
        ("bool[<=2] xs [true]", (True,)),
        ("string[] xs ['a, b', \"c]\"] # two", ("a, b", "c]")),
        ("string<=2[<=2] xs ['ab']", ("ab",)),
    ],
)
def test_defaults(text: str, default: object) -> None:
    assert only_field(text).default == default


def test_reads_any_line_ending_comments_and_blank_lines() -> None:
    lines = ["# head", "", "int32 a # one", "   ", "  # note", "int32 B=1", "string c"]
    expected = parse_message("\n".join(lines), "p/M")
    assert [item.name for item in expected.fields] == ["a", "c"]
    assert [item.name for item in expected.constants] == ["B"]
    for ending in ("\r\n", "\r"):
        read = parse_message("\ufeff" + ending.join(lines) + ending, "p/M")
        assert read == expected
        assert read.text == "\n".join(line.rstrip() for line in lines) + "\n"


def test_an_empty_text_is_a_message_without_fields() -> None:
    definition = parse_message("", "std_msgs/msg/Empty")
    assert (definition.name, definition.fields, definition.text) == ("std_msgs/Empty", (), "")


def test_service_parts_are_named_as_the_version_does() -> None:
    text = "bool data\n---\nint8 OK=0\nbool success\n"
    service = parse_service(text, "std_srvs/srv/SetBool")
    assert service.name == "std_srvs/SetBool"
    assert (service.request.name, service.response.name) == (
        "std_srvs/SetBool_Request",
        "std_srvs/SetBool_Response",
    )
    assert service.request.text == "bool data\n"
    assert [item.name for item in service.response.constants] == ["OK"]
    assert parse_service(text, "std_srvs/SetBool", distro=NOETIC).request.name == "std_srvs/SetBoolRequest"
    assert parse_service("---", "std_srvs/Empty").response.fields == ()


def test_action_parts() -> None:
    action = parse_action("int32 order\n---\n---\nint32[] sequence", "p/action/Fib")
    assert [part.name for part in (action.goal, action.result, action.feedback)] == [
        "p/Fib_Goal",
        "p/Fib_Result",
        "p/Fib_Feedback",
    ]
    assert action.result.fields == ()
    assert action.feedback.fields[0].name == "sequence"


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("int32", 1, 'expected a name after "int32"'),
        ("int32 a\nint33[ b", 2, '"int33[" is not a type'),
        ("int32 1a", 1, '"1a" cannot be a name'),
        ("int32 a-b", 1, '"a-b" cannot be a name'),
        ("int32 _a", 1, '"_a" cannot be a name'),
        ("int32 a\n\nint32 a", 3, 'the name "a" is used twice'),
        ("int32 a\nint32 a=1", 2, 'the name "a" is used twice'),
        ("int32<=5 a", 1, "only string and wstring"),
        ("int32[0] a", 1, "a length is a number from 1 to"),
        ("int32[99999999999999999999] a", 1, "a length is a number from 1 to"),
        ("uint8 X=256", 1, '"256" does not fit uint8: 0 to 255'),
        ("int8 X=-129", 1, '"-129" does not fit int8: -128 to 127'),
        ("int32 X=1.5", 1, 'expected int32, got "1.5"'),
        ("int32 X=", 1, "expected int32"),
        ("int32 X=1 2", 1, 'unexpected text after the value: "2"'),
        ("float64 X=fast", 1, 'expected float64, got "fast"'),
        ("bool X=maybe", 1, 'expected bool, got "maybe"'),
        ("int32[] X=1", 1, 'constant "X" cannot be of type int32[]'),
        ("Other X=1", 1, 'constant "X" cannot be of type my_pkg/Other'),
        ("time X=1", 1, 'constant "X" cannot be of type builtin_interfaces/Time'),
        ("Other x 1", 1, "cannot have a default value"),
        ("int32[] x 1", 1, "expected a list such as [1, 2]"),
        ("int32[2] x [1]", 1, "expected 2 default values, got 1"),
        ("int32[<=1] x [1, 2]", 1, "expected at most 1 default values, got 2"),
        ("int32[] x [1, 2", 1, 'expected "," or "]"'),
        ("int32[] x [1,]", 1, "expected int32"),
        ("string<=2 x 'abc'", 1, "a string of 3 characters where at most 2 are allowed"),
        ("string x 'abc", 1, "expected a quoted string"),
        ("a/b/c/d x", 1, "is not a type name"),
        ("std_srvs/srv/SetBool x", 1, "a field holds a message"),
        ("int32 \x00", 1, "cannot be a name"),
        ("---", 1, "is not a type"),
    ],
)
def test_errors_say_where_and_what(text: str, line: int, reason: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        parse_message(text, "my_pkg/Thing", source="my_pkg/msg/Thing.msg")
    assert str(caught.value).startswith(f"my_pkg/msg/Thing.msg:{line}: ")
    assert reason in str(caught.value)


def test_lines_of_a_service_count_from_the_top_of_the_file() -> None:
    with pytest.raises(DefinitionError, match=r"^p/S\.srv:4: "):
        parse_service("int32 a\n---\nint32 b\nint32 b\n", "p/S")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("int32 a", r'^p/S\.srv: 0 lines "---"; expected 1 between request, response$'),
        ("---\n---", r'^p/S\.srv:2: one "---" too many; the parts are request, response$'),
    ],
)
def test_a_service_has_two_parts(text: str, reason: str) -> None:
    with pytest.raises(DefinitionError, match=reason):
        parse_service(text, "p/S")


def test_an_action_has_three_parts() -> None:
    with pytest.raises(DefinitionError, match="expected 2 between goal, result, feedback"):
        parse_action("---\n", "p/A")


def test_the_name_given_is_checked() -> None:
    with pytest.raises(InvalidName):
        parse_message("", "Thing")


def test_formatting_is_definition_syntax() -> None:
    text = 'int8 A=0x1\nstring<=4[<=2] names ["a", "\\"b"]\nfloat64 w 1.0\nmy_pkg/Other[3] o\nbool on true\n'
    definition = parse_message(text, "my_pkg/Thing")
    assert format_message(definition) == text
