"""The YAML that messages and parameters are typed and printed in."""

from __future__ import annotations

import math
import sys
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from rwt.cli.console import yaml_text
from rwt.cli.console.yaml_text import MAX_CHARS, YamlError, YamlValue, block, flow, read_yaml


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", None),
        ("# nothing", None),
        ("---\na: 1\n...\n", {"a": 1}),
        ("{linear: {x: 0.2}}", {"linear": {"x": 0.2}}),
        ("data: Hello World", {"data": "Hello World"}),
        ('"data: x"', "data: x"),
        ("a: |\n  one\n   two\nb: >-\n  x\n  y\n", {"a": "one\n two\n", "b": "x y"}),
        ("/**:\n  ros__parameters:\n    a.b: [1]\n", {"/**": {"ros__parameters": {"a.b": [1]}}}),
        ('{"a": [1, 2.5, true, null, "\\ud83d\\ude00"]}', {"a": [1, 2.5, True, None, "\N{GRINNING FACE}"]}),
        ('{a: [1,2], "b":2, c: }', {"a": [1, 2], "b": 2, "c": None}),
        ("1: a\ntrue: b", {"1": "a", "true": "b"}),
        ("a:\r\n  b: 1\r\n", {"a": {"b": 1}}),
        ("\ufeffa: 1", {"a": 1}),
        ("x: http://a:9090/b", {"x": "http://a:9090/b"}),
    ],
)
def test_read(text: str, expected: object) -> None:
    assert read_yaml(text) == expected


_NUMBERS = "0 -1 +3 007 010 0x1F -0x1 0b101 1_000 9223372036854775807 -9223372036854775808"
_FLOATS = "18446744073709551615 0.5 1. 1.5e+3 6.02e-23 1_0.5 .inf -.Inf +.INF"
_WORDS = "yes No ON off true False null ~ y n text 1.2.3 0x 0o"


@pytest.mark.parametrize("text", f"{_NUMBERS} {_FLOATS} {_WORDS}".split())
def test_scalars_are_what_the_ros2_tool_reads(text: str) -> None:
    assert repr(read_yaml(f"[{text}]")) == repr(yaml.safe_load(f"[{text}]"))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1e3", 1000.0), ("-2E-3", -0.002), ("-.5", -0.5), ("08", 8), ("0o17", 15), ("12:30", "12:30"),
        ("2020-01-01", "2020-01-01"), ("=", "="), ("<<", "<<"), ("_1", "_1"), ("9" * 5000, "9" * 5000),
    ],
)  # fmt: skip
def test_scalars_are_what_people_mean(text: str, expected: object) -> None:
    """Where YAML 1.1 reads a text for a number, a number for a text, or a date: none is in any message."""
    assert repr(read_yaml(text)) == repr(expected)


def test_nan() -> None:
    read = read_yaml(".nan")
    assert isinstance(read, float)
    assert math.isnan(read)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{a:1}", "line 1, column 2: expected a space after the colon"),
        ("a: b: c", "line 1, column 5: a second colon"),
        ("a: [1", "line 1, column 4: [ has no closing ]"),
        ("{linear: {x: 1}", "line 1, column 1: { has no closing }"),
        ("a: [", "line 1, column 4: [ has no closing ]"),
        ("a: {b: 1]", "line 1, column 9: expected a comma or }"),
        ("a: *x", "line 1, column 4: an alias (*) is not read"),
        ("a: &x 1", "an anchor (&) is not read"),
        ("&x a: 1", "an anchor (&) is not read"),
        ("a: !!str 1", "line 1, column 4: a tag (!) is not read"),
        ("!!python/object/apply:os.getcwd []", "a tag (!) is not read"),
        ("\ta: 1", "a tab in the indentation"),
        ("a: @b", "line 1, column 4: @: text that begins so goes in quotes"),
        ("a: 1\na: 2", "line 2, column 1: the key 'a' is there twice"),
        ("{a: 1, a: 2}", "the key 'a' is there twice"),
        ("a:\n   b: 1\n  c: 2", "line 3, column 3: expected the end of the line, or the indentation"),
        ("a: b\nc", "line 2, column 1: expected `key: value`"),
        ("k: - 1", "a list begins on the line below its key"),
        ("a: 'b", "line 1, column 4: the text that begins here has no closing quote"),
        ('a: "\\q"', "no such escape"),
        ('a: "\\U99999999"', "no such escape"),
        ("a: |x\n b", "expected the text on the lines below"),
        ("a: 1\n---\nb: 2", "line 2, column 1: another document begins here"),
        ("%FOO 1\n---\na: 1", "a directive (%) is not read"),
        ("? [a]\n: b", "expected a key that is text or a number"),
        ("a: 'b' c", "expected the end of the line"),
        ("[1, 2] x", "line 1, column 8: expected the end of the text"),
        ("[" * 200, "line 1, column 101: nested more than 100 deep"),
        ("- " * 100_000, "nested more than 100 deep"),
        ("{: 1}", "expected a value"),
        ("a:\n  \x1b", "line 2, column 3: U+001B is written in double quotes"),
        ("a: \ud800", "line 1, column 4: U+D800 is written"),
        (" " * (MAX_CHARS + 1), f"more than {MAX_CHARS} characters"),
    ],
    ids=lambda text: text[:30],
)
def test_refused_with_the_place(text: str, expected: str) -> None:
    with pytest.raises(YamlError) as refused:
        read_yaml(text)
    assert expected in str(refused.value)
    assert str(refused.value).startswith("line ")


def test_a_few_letters_make_no_huge_value() -> None:
    laughs = "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 20))
    with pytest.raises(YamlError, match=r"line 1, column 5: an anchor \(&\) is not read"):
        read_yaml(f"a0: &a0 lol\n{laughs}")


@pytest.mark.parametrize("loader", [yaml.SafeLoader, yaml_text.LOADER])
@given(text=st.text(st.sampled_from(list("ab:-,[]{}'\"|>#&*!% \n\t01.e~?@\\")), max_size=40))
def test_any_text_is_read_or_refused(loader: Any, text: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(yaml_text, "LOADER", loader)
        try:
            read_yaml(text)
        except YamlError as error:
            assert str(error).startswith("line ")


_AMBIGUOUS = (
    "yes", "null", "~", "1", "1e3", "0x1", "0o7", "- a", "a: b", "a #b", " a ", "#", "-", "--- a",
    "2020-01-01", "12:30", "1_0", "-_1", "=", "<<", ".inf", "y", "a\nb", "'", '"', "{", "...",
)  # fmt: skip
_TEXTS = st.text(st.characters(codec="utf-8"), max_size=20) | st.sampled_from(_AMBIGUOUS)
_SCALARS = st.none() | st.booleans() | st.integers(-(2**64), 2**64) | st.floats(allow_nan=False) | _TEXTS
_VALUES = st.recursive(
    _SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_TEXTS, inner, max_size=4),
    max_leaves=20,
)


@given(_VALUES)
def test_what_is_written_reads_back_here_and_in_the_ros2_tool(value: YamlValue) -> None:
    for text in (block(value), flow(value)):
        assert repr(read_yaml(text)) == repr(value)
        assert repr(yaml.safe_load(text)) == repr(value)
        assert all(character.isprintable() or character == "\n" for character in text)
    assert "\n" not in flow(value)


def test_equal_parts_are_written_out() -> None:
    part: list[YamlValue] = [1]
    assert block({"a": part, "b": part}) == "a:\n- 1\nb:\n- 1\n"


def test_as_the_ros2_tool_prints() -> None:
    value: YamlValue = {
        "header": {"frame_id": "odom", "stamp": {}},
        "y": 0.0,
        "list": [1, {"a": 1, "b": []}],
        "s": "",
        "long": "w " * 60 + "ä",
    }
    written = block(value)
    assert written == yaml.dump(value, allow_unicode=True, width=sys.maxsize, sort_keys=False)
    assert written.splitlines()[:-1] == [
        "header:",
        "  frame_id: odom",
        "  stamp: {}",
        "y: 0.0",
        "list:",
        "- 1",
        "- a: 1",
        "  b: []",
        "s: ''",
    ]
