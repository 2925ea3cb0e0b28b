from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_graph import InvalidGraphName
from rwt_graph.names import namespace_of, node_name, parameter_name, resolve, split_parameter, validate

TOKENS = st.text("abcXYZ019_", min_size=1, max_size=6)
PATHS = st.lists(TOKENS, min_size=1, max_size=4).map("/".join)


@pytest.mark.parametrize(
    ("name", "namespace", "node", "expected"),
    [
        ("/a/b", "/ns", "/ns/n", "/a/b"),
        ("a/b", "/", "", "/a/b"),
        ("a", "/ns", "", "/ns/a"),
        ("a", "/ns/deep/", "", "/ns/deep/a"),
        ("~/a", "/ns", "/ns/n", "/ns/n/a"),
        ("~a", "/", "/n", "/n/a"),
        ("~", "/", "/n", "/n"),
        ("//a///b/", "/", "", "/a/b"),
    ],
)
def test_resolving(name: str, namespace: str, node: str, expected: str) -> None:
    assert resolve(name, namespace, node) == expected


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("", "'' is not a valid name: it is empty"),
        ("/", "'/' is not a valid name: it has no part between its slashes"),
        ("a b", "'a b' is not a valid name: it contains ' '; use letters, digits, underscores and slashes"),
        (
            "a\n",
            "'a\\n' is not a valid name: it contains '\\n'; use letters, digits, underscores and slashes",
        ),
        ("a~b", "'a~b' is not a valid name: it contains '~'; use letters, digits, underscores and slashes"),
        ("é", "'é' is not a valid name: it contains 'é'; use letters, digits, underscores and slashes"),
        ("~/a", "'~/a' is private to a node, and no node is given"),
    ],
)
def test_names_that_ros_does_not_allow(name: str, text: str) -> None:
    with pytest.raises(InvalidGraphName) as caught:
        resolve(name)
    assert str(caught.value) == text


def test_a_very_long_name_is_refused_without_repeating_it() -> None:
    with pytest.raises(InvalidGraphName) as caught:
        resolve("/" + "a" * 10_000)
    assert len(str(caught.value)) < 200


@given(PATHS, PATHS)
def test_resolving_is_idempotent_and_gives_valid_names(name: str, namespace: str) -> None:
    resolved = resolve(name, "/" + namespace)
    assert resolved == f"/{namespace}/{name}"
    assert resolve(resolved, "/elsewhere", "/n") == resolved
    assert validate(resolved) == resolved


@given(st.text(max_size=30))
def test_any_text_resolves_to_a_valid_name_or_is_refused(text: str) -> None:
    try:
        resolved = resolve(text, "/ns", "/ns/n")
    except InvalidGraphName:
        return
    assert validate(resolved) == resolved


def test_validation_suggests_the_resolved_name() -> None:
    with pytest.raises(
        InvalidGraphName, match=r"'chatter' is not an absolute name; did you mean '/chatter'\?"
    ):
        validate("chatter")


def test_node_names() -> None:
    assert node_name("talker", "/robot") == "/robot/talker"
    assert node_name("/robot/talker", "/elsewhere") == "/robot/talker"
    with pytest.raises(InvalidGraphName, match="namespace"):
        node_name("robot/talker")
    assert namespace_of("/robot/talker") == "/robot"
    assert namespace_of("/talker") == "/"


def test_parameter_names() -> None:
    assert parameter_name("arm.gain-1/x") == "arm.gain-1/x"
    assert split_parameter("/demo:arm.gain") == ("/demo", "arm.gain")
    assert split_parameter("demo:x") == ("/demo", "x")
    assert split_parameter("/demo/x") is None
    for name in ("", ".x", "a b", "x:y", "a" * 1000):
        with pytest.raises(InvalidGraphName):
            parameter_name(name)
    with pytest.raises(InvalidGraphName):
        split_parameter("/demo:")
    with pytest.raises(InvalidGraphName):
        split_parameter(":x")
