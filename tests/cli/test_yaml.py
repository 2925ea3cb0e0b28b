"""The YAML that messages are typed in, against an independent reader and writer."""

from __future__ import annotations

import io
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from rwt_cli.console import yaml_writer
from rwt_cli.console.yaml_reader import YamlError, YamlValue, read_yaml


def _oracle() -> YAML:
    return YAML(typ="safe", pure=True)


_SAME_AS_THE_ORACLE = [
    "{linear: {x: 0.2}}",
    "data: Hello World",
    "linear:\n  x: 1.0\n  y: 2\nangular:\n  z: -1e3\n",
    "- a\n- b: 1\n  c: 2\n-\n  - 1\n  - 2\n",
    "a:\n- 1\n- 2\nb: [1, 2, {c: d}]\n",
    '"data: x"',
    "data: 'it''s'",
    "a: |\n  one\n   two\n\n  three\nb: >\n  x\n  y\n\n  z\n",
    "# c\na: 1 # d\n\n# e\nb: 2\n",
    '{a: [1,2,3], "b":2, c: }',
    "[]",
    "{}",
    "",
    "~",
    "3",
    'a: "x\\n\\u00e4 \\x41 \\U0001F600"',
    "---\na: 1\n...\n",
    "a: b\n  c d\ne: f\n",
    "/**:\n  ros__parameters:\n    a.b: 1\n    q:\n      /p: true\n",
    "a: |-\n  x\n",
    "a: |+\n  x\n\nb: 1",
    "a: >-\n  x\n  y\n",
    "- - 1\n  - 2\n- 3",
    "- {a: 1}\n- [b]",
    "a: {\n b: 1,\n c: 2\n}\nd: 1",
    "x: http://a:9090/b",
    '"a": 1',
    "key with space: v",
    "{x: -.inf, y: .nan}",
    "a: 0x1F\nb: 0o17\nc: +3\nd: .5\ne: 1.\nf: 007",
    "a: 'one\n  two\n\n  three'",
    'a: "one \\\n  two"',
    "a: x#y\nb: x #y",
    "[a, b c, 'd', \"e\", -1, {f: g}]",
    "a: null\nb: Null\nc: ~\nd:",
]


@pytest.mark.parametrize("text", _SAME_AS_THE_ORACLE)
def test_read_as_by_an_independent_reader(text: str) -> None:
    assert repr(read_yaml(text)) == repr(_oracle().load(io.StringIO(text)))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('{"a": [1, 2.5, true, null, "\\ud83d\\ude00"]}', {"a": [1, 2.5, True, None, "\N{GRINNING FACE}"]}),
        ("a: yes\nb: off\nc: On", {"a": True, "b": False, "c": True}),
        ("a: y\nb: n", {"a": "y", "b": "n"}),
        ("a:\r\n  b: 1\r\n", {"a": {"b": 1}}),
    ],
)
def test_read(text: str, expected: object) -> None:
    assert read_yaml(text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{a:1}", "line 1, column 3: expected a space after the colon"),
        ("a: b: c", "line 1, column 5: a second colon"),
        ("a: [1", "line 1, column 4: what begins here has no closing ]"),
        ("a: {b: 1]", "expected a comma or }"),
        ("a: *x", "line 1, column 4: an alias (*) is not read"),
        ("a: &x 1", "an anchor (&) is not read"),
        ("a: !!str 1", "a tag (!) is not read"),
        ("\ta: 1", "a tab in the indentation"),
        ("a: 1\na: 2", "line 2, column 1: the key 'a' is there twice"),
        ("{a: 1, a: 2}", "the key 'a' is there twice"),
        ("a:\n   b: 1\n  c: 2", "line 3, column 3: expected the indentation"),
        ("k: - 1", "a list begins on the line below its key"),
        ("a: 'b", "has no closing '"),
        ('a: "\\q"', "no such escape: \\q"),
        ('a: "\\U99999999"', "no such escape"),
        ("a: 1\n---\nb: 2", "another document begins here"),
        ("%YAML 1.2\n---\na: 1", "a directive (%) is not read"),
        ("? a\n: b", "is not read"),
        ("a: 'b' c", "expected the end of the line"),
        ("[1, 2] x", "expected the end"),
        ("[" * 200, "nested more than 100 deep"),
        ("{: 1}", "expected"),
    ],
)
def test_refused_with_the_place(text: str, expected: str) -> None:
    with pytest.raises(YamlError) as refused:
        read_yaml(text)
    assert expected in str(refused.value)
    assert str(refused.value).startswith("line ")


@given(st.text(st.sampled_from(list("ab:-,[]{}'\"|>#&*!% \n\t01.e~")), max_size=40))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        read_yaml(text)
    except YamlError as error:
        assert str(error).startswith("line ")


_SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**64), 2**64)
    | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8", exclude_characters="\ufeff"), max_size=20)
    | st.sampled_from(
        ["yes", "no", "null", "~", "1", "1e3", "0x1", "- a", "a: b", "a #b", " a ", "#", "-", "--- a"]
    )
    | st.sampled_from(
        ["2020-01-01", "12:30", "1_000", "=", "<<", ".inf", "y", "a\nb", "'", '"', "{", "\x1b[31m"]
    )
)
_KEYS = st.text(st.characters(codec="utf-8", exclude_characters="\ufeff"), min_size=1, max_size=10)
_VALUES = st.recursive(
    _SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_KEYS, inner, max_size=4),
    max_leaves=20,
)


@given(_VALUES)
def test_what_is_written_reads_back(value: YamlValue) -> None:
    assert read_yaml("\n".join(yaml_writer.block(value))) == value
    assert read_yaml(yaml_writer.flow(value)) == value


@settings(max_examples=60, deadline=None)
@given(_VALUES)
def test_what_is_written_is_yaml_to_an_independent_reader(value: YamlValue) -> None:
    assert _oracle().load(io.StringIO("\n".join(yaml_writer.block(value)))) == value
    assert _oracle().load(io.StringIO(yaml_writer.flow(value))) == value


@settings(max_examples=60, deadline=None)
@given(
    st.dictionaries(
        st.from_regex(r"[a-z][a-z_/.]{0,9}", fullmatch=True).filter(lambda key: key not in ("y", "n")),
        st.integers()
        | st.text(st.characters(min_codepoint=32, max_codepoint=126, exclude_characters=":?"), max_size=60)
        | st.lists(st.integers()),
    ),
    st.booleans(),
)
def test_what_an_independent_writer_writes_is_read(value: dict[str, object], flow: bool) -> None:
    writer = _oracle()
    writer.default_flow_style = flow
    text = io.StringIO()
    writer.dump(value, text)
    assert read_yaml(text.getvalue()) == _oracle().load(io.StringIO(text.getvalue()))


def test_nan_is_written_and_read() -> None:
    read = read_yaml(yaml_writer.flow([math.nan, math.inf, -math.inf]))
    assert isinstance(read, list)
    assert repr(read) == "[nan, inf, -inf]"


def test_as_the_ros2_tool_prints() -> None:
    value: YamlValue = {
        "header": {"frame_id": "odom", "stamp": {}},
        "y": 0.0,
        "list": [1, {"a": 1, "b": []}],
        "s": "",
    }
    assert list(yaml_writer.block(value)) == [
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
