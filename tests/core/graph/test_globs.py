"""Patterns that clients choose: what they match, and that nothing of them stays."""

from __future__ import annotations

import fnmatch
import re
from random import Random
from typing import TYPE_CHECKING, Any

import pytest

from rwt_graph.topic_selection import TopicSelection, glob_matcher

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.mark.parametrize(
    ("pattern", "name", "fits"),
    [
        ("*", "/anything", True),
        ("", "/a", False),
        ("/a", "/a", True),
        ("/a", "/ab", False),
        ("/camera/*", "/camera/image", True),
        ("/camera/*", "/cameras", False),
        ("*battery*", "/battery_state", True),
        ("*aa*aa", "/aaa", False),
        ("/a*a", "/a", False),
        ("*b*a*", "/a/b/a/b", True),
        ("/[a-c]", "/b", True),
        ("/[!a-c]", "/b", False),
        ("/[]]", "/]", True),
        ("/[a", "/[a", True),
        ("/?", "/a", True),
        ("/?", "/", False),
    ],
)
def test_a_pattern_matches_whole_names(pattern: str, name: str, fits: bool) -> None:
    assert glob_matcher(pattern)(name) is fits


def test_patterns_match_as_those_of_fnmatch() -> None:
    random = Random(1)
    for _ in range(3000):
        pattern = "".join(random.choice(["*", "/", "a", "b", "?", "[a]", "[!/]", "[a-b]"]) for _ in range(6))
        name = "".join(random.choice("/abc") for _ in range(random.randrange(10)))
        assert glob_matcher(pattern)(name) is fnmatch.fnmatchcase(name, pattern), (pattern, name)


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Any]]:
    """Patterns that are compiled meanwhile."""
    found: list[Any] = []
    monkeypatch.setattr(re, "compile", lambda *given: found.append(given))
    yield found


def test_no_pattern_is_kept_by_the_process(compiled: list[Any]) -> None:
    for number in range(100):
        glob_matcher(f"*{number}?[a-z]*")("/a")
        TopicSelection((f"camera{number}/*",), (f"*{number}",)).takes("/a")
    assert compiled == []


def test_the_work_for_a_name_does_not_grow_with_the_pattern() -> None:
    """The slowest patterns for a matcher that tries again: each character is looked at once."""

    class Name(str):
        looked_at = 0

        def __iter__(self) -> Iterator[str]:
            for character in str(self):
                Name.looked_at += 1
                yield character

    name = Name("a" * 500)
    assert not glob_matcher("*a?" * 80 + "b")(name)
    assert Name.looked_at == 500
