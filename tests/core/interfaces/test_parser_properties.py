"""Properties of every definition, and of every text."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from rwt_interfaces.definitions.literals import Literals
from rwt_interfaces.definitions.model import Constant, Field, MessageDefinition, WrittenType
from rwt_interfaces.definitions.parser import (
    MOST_ELEMENTS,
    format_message,
    parse_action,
    parse_message,
    parse_service,
)
from rwt_interfaces.distro import DISTROS, Distro
from rwt_interfaces.errors import DefinitionError

NAMES = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,8}", fullmatch=True)
SIZES = st.integers(1, 2**32 - 1)
#: Characters that a quoted string can hold: a definition is read line by line.
LINE_TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\x00"), max_size=12)


def scalars(name: str) -> st.SearchStrategy[object]:
    if name == "bool":
        return st.booleans()
    if name in ("string", "wstring"):
        return LINE_TEXT
    if name.startswith("float"):
        return st.floats(allow_nan=False)
    if name in ("byte", "char"):
        return st.integers(-128, 255)
    bits = int(name.strip("uint"))
    return (
        st.integers(0, 2**bits - 1)
        if name[0] == "u"
        else st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    )


PLAIN = [
    "bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
    "float32", "float64", "string", "wstring",
]  # fmt: skip


@st.composite
def field_types(draw: st.DrawFn) -> WrittenType:
    name = draw(st.sampled_from([*PLAIN, "geometry_msgs/Point", "std_msgs/Header", "p/Other"]))
    string_bound = draw(st.none() | SIZES) if name in ("string", "wstring") else None
    shape = draw(st.sampled_from(["scalar", "sequence", "fixed", "bounded"]))
    return WrittenType(
        name,
        string_bound,
        is_array=shape != "scalar",
        length=draw(st.integers(1, MOST_ELEMENTS)) if shape == "fixed" else None,
        bound=draw(SIZES) if shape == "bounded" else None,
    )


@st.composite
def fields(draw: st.DrawFn, name: str) -> Field:
    field_type = draw(field_types())
    if not field_type.is_primitive or not draw(st.booleans()):
        return Field(name, field_type)
    size = field_type.length or min(3, field_type.bound or 3)
    assume(size <= 4)
    element = scalars(field_type.name)
    if field_type.string_bound is not None:
        longest = field_type.string_bound
        element = element.map(lambda text: str(text)[:longest])
    if not field_type.is_array:
        return Field(name, field_type, draw(element))
    least = field_type.length or 0
    return Field(name, field_type, tuple(draw(st.lists(element, min_size=least, max_size=size))))


@st.composite
def constants(draw: st.DrawFn, name: str) -> Constant:
    field_type = WrittenType(draw(st.sampled_from(PLAIN)))
    value = draw(scalars(field_type.name))
    assert isinstance(value, bool | int | float | str)
    return Constant(name, field_type, value, Literals.format(value))


@st.composite
def messages(draw: st.DrawFn) -> MessageDefinition:
    names = draw(st.lists(NAMES, unique=True, max_size=6))
    split = draw(st.integers(0, len(names)))
    return MessageDefinition(
        "p/M",
        tuple(draw(fields(name)) for name in names[:split]),
        tuple(draw(constants(name)) for name in names[split:]),
    )


@given(messages())
def test_what_is_written_reads_back_the_same(definition: MessageDefinition) -> None:
    text = format_message(definition)
    read = parse_message(text, "p/M")
    assert read == definition
    assert read.text == text
    assert [type(item.value) for item in read.constants] == [
        type(item.value) for item in definition.constants
    ]


@given(messages(), st.sampled_from(["\n", "\r\n", "\r"]), st.lists(st.sampled_from(["", "# note", "  "])))
def test_comments_blank_lines_and_line_ends_mean_nothing(
    definition: MessageDefinition, ending: str, noise: list[str]
) -> None:
    lines = [*noise, *(f"  {line}  # {line}" for line in format_message(definition).split("\n"))]
    assert parse_message(ending.join(lines), "p/M") == definition


TOKENS = st.sampled_from(
    ["int32", "string", "string<=", "wstring<=3", "Header", "time", "p/msg/M", "[", "]", "<=", "[<=2]", "=",
     "x", "X", "'", '"', "\\", "#", ",", "-", "---", "\n", "\r\n", "\t", " ", "0x", "1e", "9" * 30, "nan",
     "true", "/", "\x00", "ü", "\u2028", "\ud800"]
)  # fmt: skip
TEXTS = st.text() | st.lists(TOKENS, max_size=20).map("".join) | st.lists(TOKENS, max_size=20).map(" ".join)


@pytest.mark.parametrize("distro", DISTROS.values(), ids=DISTROS)
@pytest.mark.parametrize("parse", [parse_message, parse_service, parse_action])
@given(text=TEXTS)
@example(text="float64 X=" + "9" * 5000)
@example(text="int64 X=" + "9" * 5000)
@example(text="int64 X=0x" + "f" * 5000)
@example(text="int32[" + "9" * 5000 + "] x")
@example(text="string x " + "'" * 1001)
@example(text="string[] x [" + "'a'," * 2000)
def test_any_text_is_a_definition_or_an_error(
    parse: Callable[..., object], distro: Distro, text: str
) -> None:
    try:
        parse(text, "p/M", source="here", distro=distro)
    except DefinitionError as error:
        assert str(error).startswith("here:")
        assert len(str(error)) < 400


def test_float_constants_keep_what_json_has_no_word_for() -> None:
    (constant,) = parse_message("float64 X=nan", "p/M").constants
    assert isinstance(constant.value, float)
    assert math.isnan(constant.value)
