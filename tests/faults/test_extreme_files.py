"""Extreme files of parameters, remap rules, settings and definitions of messages.

They are read within bounds, or rejected by the documented error, which names the file.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rwt.access.settings import SettingsError
from rwt.settings.sources import read_settings
from rwt_interfaces.definitions.parser import parse_action, parse_message, parse_service
from rwt_interfaces.errors import DefinitionError
from rwt_interfaces.registry import Registry
from rwt_rclpy.exceptions import RCLInvalidROSArgsError, UnknownROSArgsError
from rwt_rclpy.names.arguments import parse_arguments, parse_value, read_parameter_file
from rwt_rclpy.parameters.parameter import parameter_dict_from_yaml_file

EXAMPLES: Final = int(os.environ.get("SWEEP_EXAMPLES", "40"))

MANY: Final = (1, 2, 30, 150, 1_100)
"""Number of nested or repeated elements."""

TRY: Final = settings(
    max_examples=EXAMPLES,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)

SCALARS: Final = (
    "1", "-0", "1" * 5_000, "0x" + "f" * 5_000, "0b" + "1" * 9_999, "1e999", "-1e-999",
    "1e" + "9" * 5_000, ".nan", "-.inf", "190:20:30", "1:" * 3_000 + "1", "2001-99-99",
    "2001-01-01T99:99:99Z",
    "0001-01-01t00:00:00+99:99",
    "~", "", "yes", "''", '"\\ud800"', '"\\x00"', "!!binary x", "!!python/object:os.system x", "!!set {a, b}",
    "!!omap [a: 1]", "!!timestamp x", "!!int x", "!!float ''", "*a", "&a x", "? x", "|", "%TAG",
    "\ufeff", "\x00",
)  # fmt: skip
"""Values in YAML, and what looks like some."""


def _bomb_line(level: int) -> str:
    """A table that holds nine times what stands in the line before."""
    return f"x{level}: &x{level} {{{', '.join(f'k{each}: *x{level - 1}' for each in range(9))}}}\n"


@st.composite
def yaml_texts(draw: st.DrawFn) -> str:
    """Values in YAML, of which some stand within each other, often."""
    scalar, count = draw(st.sampled_from(SCALARS)), draw(st.sampled_from(MANY))
    depth = min(count, 2_000)
    shape = draw(st.sampled_from(("plain", "lists", "tables", "block", "bomb", "itself", "keys", "long")))
    levels = min(count, 200)
    return {
        "plain": scalar,
        "lists": "[" * depth + scalar + "]" * draw(st.sampled_from((depth, depth - 1))),
        "tables": "{a: " * depth + scalar + "}" * depth,
        "block": "\n".join(" " * level + "a:" for level in range(levels)) + f" {scalar}",
        "bomb": "x0: &x0 {a: 1}\n" + "".join(_bomb_line(level) for level in range(1, min(count, 40))),
        "itself": "&a {b: *a, c: &b [*b, *a]}",
        "keys": f"{{[1, 2]: {scalar}, {{a: 1}}: 2, ? {scalar} : 3}}",
        "long": f"[{', '.join([scalar[:50] or '1'] * count)}]",
    }[shape]  # fmt: skip


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    with TemporaryDirectory() as made:
        yield Path(made)


def _indented(text: str, by: int) -> str:
    return text.replace("\n", "\n" + " " * by)


@TRY
@given(value=yaml_texts(), whole=st.booleans())
def test_files_of_parameters(folder: Path, value: str, whole: bool) -> None:
    path = folder / "parameters.yaml"
    text = value if whole else f"/**:\n  ros__parameters:\n    p:\n      {_indented(value, 6)}\n"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        assert len(read_parameter_file(path)) <= len(text)
    except RCLInvalidROSArgsError as error:
        assert str(path) in str(error) and len(str(error)) < 2_000
    try:
        assert len(parameter_dict_from_yaml_file(str(path))) <= len(text)
    except RuntimeError as error:
        assert not isinstance(error, RecursionError), error


@TRY
@given(value=yaml_texts())
def test_values_and_rules_of_the_command_line(value: str) -> None:
    try:
        parse_value(value)
    except RCLInvalidROSArgsError as error:
        assert len(str(error)) < 2_000
    for arguments in (
        ["-p", f"a:={value}"],
        ["-r", f"{value}:={value}"],
        ["-r", f"a:={value}"],
        ["-r", value],
    ):
        with suppress(RCLInvalidROSArgsError, UnknownROSArgsError):
            parse_arguments(["--ros-args", *arguments])


TOML_VALUES: Final = (
    "1", "1" * 5_000, "0x" + "f" * 5_000, "1e999", "nan", "-inf", "2001-99-99", "07:99:00", '""', "'''",
    "true", "[]", "{}", '"\\ud800"', '"\\u0000"', "[{}]", "1979-05-27T07:32:00-99:00",
)  # fmt: skip


@st.composite
def toml_texts(draw: st.DrawFn) -> str:
    """Settings, and what looks like some."""
    value, count = draw(st.sampled_from(TOML_VALUES)), draw(st.sampled_from(MANY))
    key = draw(
        st.sampled_from(
            ("limits.connections", "roles.x.publish", "auth.tokens.t", "gate.rules.r.fields", "x", "listen")
        )
    )
    shape = draw(st.sampled_from(("plain", "lists", "tables", "dots", "roles", "again", "long")))
    return {
        "plain": f"{key} = {value}",
        "lists": f"{key} = {'[' * count}{value}{']' * count}",
        "tables": f"{key} = {'{a=' * count}{value}{'}' * count}",
        "dots": f"{key}{'.a' * count} = {value}",
        "roles": "".join(f"[roles.r{n}]\npublish = ['{'*' * 50}']\n" for n in range(min(count, 2_000))),
        "again": f"{key} = {value}\n" * min(count, 3),
        "long": f"{key} = [{', '.join([value] * min(count, 2_000))}]",
    }[shape]


@TRY
@given(text=toml_texts())
def test_files_of_settings(folder: Path, text: str) -> None:
    path = folder / "rwt.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        read_settings(path)
    except SettingsError as error:
        assert str(path) in str(error) and len(str(error)) < 5_000


@st.composite
def definitions(draw: st.DrawFn) -> str:
    """Definitions of messages, and what looks like some."""
    number = draw(st.sampled_from(("0", "-1", "1", "255", str(2**31), str(2**64), "9" * 30, "9" * 4_500)))
    count = draw(st.sampled_from(MANY))
    kind = draw(
        st.sampled_from(
            ("int8", "uint64", "float32", "string", "wstring", "bool", "char", "a/B", "M", "time")
        )
    )
    shape = draw(
        st.sampled_from(("field", "length", "bound", "limit", "constant", "default", "list", "many", "parts"))
    )
    return {
        "field": f"{kind} {'x' * count}",
        "length": f"{kind}[{number}] x",
        "bound": f"{kind}[<={number}] x",
        "limit": f"string<={number}[<={number}] x",
        "constant": f"{kind} X={number}",
        "default": f'{kind} x "{"y" * count}"',
        "list": f"{kind}[] x [{', '.join([number[:20]] * count)}]",
        "many": "\n".join(f"{kind} x{n}" for n in range(count)),
        "parts": "---\n" * count,
    }[shape]


@TRY
@given(text=definitions())
def test_definitions_of_messages(text: str) -> None:
    for parse in (parse_message, parse_service, parse_action):
        try:
            parse(text, "some/Thing", source="Thing.msg")
        except DefinitionError as error:
            assert "Thing.msg" in str(error) and len(str(error)) < 1_000


@pytest.mark.parametrize("levels", [2, 40, 3_000])
def test_messages_within_each_other(levels: int) -> None:
    registry = Registry()
    for level in range(levels):
        registry.add_text(f"L{level + 1} x" if level + 1 < levels else "int8 x", f"deep/L{level}")
    try:
        registry.message("deep/L0")
    except DefinitionError as error:
        assert "deep/L" in str(error) and levels > 40
