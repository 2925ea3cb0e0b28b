"""Definitions that would cost without end are refused, with the place that is to blame."""

from __future__ import annotations

from pathlib import Path

import pytest

from rwt_interfaces import Payload
from rwt_interfaces.definitions.parser import LONGEST_TEXT, MOST_ELEMENTS, parse_action, parse_message
from rwt_interfaces.errors import DefinitionError
from rwt_interfaces.registry import MOST_LEVELS, Registry


@pytest.mark.parametrize(
    "line",
    [
        "float64[2147483647] x", f"bool[{MOST_ELEMENTS + 1}] x", "pkg/Other[4294967295] x",
        "int64[99999999999999999999] x",
    ],
)  # fmt: skip
def test_an_array_that_no_message_could_hold_is_refused_with_its_line(line: str) -> None:
    with pytest.raises(DefinitionError, match=rf"^pkg/Big\.msg:2: .*1 to {MOST_ELEMENTS}"):
        parse_message(f"# first\n{line}\n", "pkg/Big")


def test_the_longest_array_and_any_bound_are_taken() -> None:
    parsed = parse_message(f"float64[<=4294967295] x\nuint8[{MOST_ELEMENTS}] y\n", "pkg/Big")
    assert [field.type.length for field in parsed.fields] == [None, MOST_ELEMENTS]


def test_arrays_of_arrays_are_counted_together() -> None:
    registry = Registry()
    registry.add_text("float64[1024] x", "pkg/A")
    registry.add_text("A[1024] x", "pkg/B")
    registry.add_text("B x\nbool y", "pkg/C")
    registry.message("pkg/B")
    with pytest.raises(DefinitionError, match=rf"pkg/C has 1048577 elements.*{MOST_ELEMENTS}"):
        registry.message("pkg/C")
    with pytest.raises(DefinitionError, match="pkg/C"):
        registry.verify()


def _chain(registry: Registry, length: int) -> None:
    for number in range(length):
        registry.add_text(f"T{number + 1} x" if number < length - 1 else "bool x", f"pkg/T{number}")


@pytest.mark.parametrize("length", [MOST_LEVELS + 1, 2000])
@pytest.mark.parametrize("first", [0, 20])
def test_types_nested_too_deep_are_refused(length: int, first: int) -> None:
    registry = Registry()
    _chain(registry, length)
    if first:  # What was looked at before, from below, does not hide how deep it is.
        registry.message(f"pkg/T{length - first}")
    with pytest.raises(DefinitionError, match=f"deeper than {MOST_LEVELS}"):
        registry.message("pkg/T0")
    with pytest.raises(DefinitionError, match=f"deeper than {MOST_LEVELS}"):
        registry.verify()


def test_the_deepest_type_works_throughout() -> None:
    registry = Registry()
    _chain(registry, MOST_LEVELS)
    type = registry.message("pkg/T0")
    message = Payload.from_value(type, {})
    assert Payload.from_cdr(type, message.cdr()).json() == message.json()
    assert (len(type.md5), type.rihs01[:7]) == (32, "RIHS01_")
    assert registry.full_text(type).count("MSG: ") == MOST_LEVELS - 1


@pytest.mark.parametrize(
    ("text", "way"),
    [("pkg/A x", "A"), ("pkg/B x", "B > pkg/A"), ("pkg/A[] x", "A"), ("pkg/A[<=3] x", "A")],
)
def test_a_type_within_itself_is_refused(text: str, way: str) -> None:
    registry = Registry()
    registry.add_text(text, "pkg/A")
    registry.add_text("A[] x", "pkg/B")
    with pytest.raises(DefinitionError, match=f"pkg/A contains itself: pkg/A > pkg/{way}$"):
        registry.message("pkg/A")
    with pytest.raises(DefinitionError, match="contains itself"):
        registry.verify()


def test_a_text_that_is_too_long_is_refused_before_it_is_read(tmp_path: Path) -> None:
    text = "bool x\n" + "#" * LONGEST_TEXT
    for parse in (parse_message, parse_action):
        with pytest.raises(DefinitionError, match=rf"^pkg/Long\.\w+: .*{LONGEST_TEXT}"):
            parse(text, "pkg/Long")
    file = tmp_path / "pkg" / "msg" / "Long.msg"
    file.parent.mkdir(parents=True)
    with file.open("wb") as sparse:
        sparse.truncate(2**40)
    with pytest.raises(DefinitionError, match=rf"Long\.msg: .*{LONGEST_TEXT}"):
        Registry().add_directory(tmp_path)


@pytest.mark.parametrize(
    "line",
    ["x" * 500_000 + " y", "bool " + "é" * 500_000, "int64 A=" + "1" * 500_000, "int64 a 1" + "0" * 500_000,
     "bool " + "x" * 500_000, "string<=" + "9" * 500_000 + " x", "/" * 500_000 + " x"],
)  # fmt: skip
def test_what_is_wrong_with_a_long_line_is_said_in_short(line: str) -> None:
    with pytest.raises(DefinitionError, match=r"^pkg/Long\.msg:1: ") as refused:
        parse_message(line, "pkg/Long")
    assert len(str(refused.value)) < 500
