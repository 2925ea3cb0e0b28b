"""Both spellings of a type name."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_interfaces.errors import InvalidName
from rwt_interfaces.names import LONGEST_NAME, is_word, parse_type_name, three_part, two_part

WORDS = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,20}", fullmatch=True).filter(
    lambda word: word not in ("msg", "srv")
)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("std_msgs/String", ("std_msgs", "", "String")),
        ("std_msgs/msg/String", ("std_msgs", "msg", "String")),
        ("std_srvs/srv/SetBool", ("std_srvs", "srv", "SetBool")),
        ("nav2_msgs/action/NavigateToPose", ("nav2_msgs", "action", "NavigateToPose")),
        ("std_msgs//String", ("std_msgs", "", "String")),
        ("/std_msgs/msg//String/", ("std_msgs", "msg", "String")),
        ("tf/tfMessage", ("tf", "", "tfMessage")),
        ("std_srvs/SetBool_Request", ("std_srvs", "", "SetBool_Request")),
    ],
)
def test_splits_both_spellings(text: str, parts: tuple[str, str, str]) -> None:
    assert parse_type_name(text) == parts


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "expected package/Name"),
        ("String", "expected package/Name"),
        ("/", "expected package/Name"),
        ("a/b/c/d", "expected package/Name"),
        ("std_msgs/message/String", 'got "message"'),
        ("std_msgs/Str ing", '"Str ing" is not letters'),
        ("1abc/String", '"1abc" is not letters'),
        ("std_msgs/Größe", '"Größe" is not letters'),
        ("std_msgs/String\n", "is not letters"),
        ("_a/String", '"_a" is not letters'),
        ("a/" + "b" * LONGEST_NAME, "the longest is 512"),
    ],
)
def test_refuses_what_is_no_name(text: str, reason: str) -> None:
    with pytest.raises(InvalidName) as caught:
        parse_type_name(text)
    assert reason in str(caught.value)


def test_converts_between_spellings() -> None:
    assert two_part("std_msgs/msg/String") == "std_msgs/String"
    assert two_part("std_msgs/String") == "std_msgs/String"
    assert three_part("std_msgs/String", "msg") == "std_msgs/msg/String"
    assert three_part("std_srvs/srv/SetBool", "msg") == "std_srvs/srv/SetBool"


@given(WORDS, WORDS, st.sampled_from(["msg", "srv", "action"]))
def test_spellings_are_two_views_of_one_name(package: str, name: str, kind: str) -> None:
    full = f"{package}/{kind}/{name}"
    assert parse_type_name(full) == (package, kind, name)
    assert two_part(full) == f"{package}/{name}"


@given(st.text())
def test_any_text_is_a_name_or_an_error(text: str) -> None:
    try:
        package, kind, name = parse_type_name(text)
    except InvalidName:
        return
    assert is_word(package)
    assert is_word(name)
    assert kind in ("", "msg", "srv", "action")
