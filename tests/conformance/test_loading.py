"""Files that are no cases are refused, with the place named."""

from __future__ import annotations

import fnmatch
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosbridge_conformance.runner import select
from rosbridge_conformance.suite.loading import CaseError, load_case, load_cases, read_case
from rosbridge_conformance.suite.target import TargetError, find_target, shipped
from rosbridge_conformance.suite.values import Json

_WIRE = frozenset({"messages", "several-clients"})
_GOOD: dict[str, Json] = {
    "title": "A thing works",
    "rules": ["PUB-01"],
    "level": "MUST",
    "profile": "CORE",
    "steps": [{"send": {"op": "x"}}, {"expect": {"op": "y"}, "as": "b"}],
}


def test_a_case_has_its_clients_in_order_of_use() -> None:
    case = read_case("topics/thing", _GOOD)
    assert (case.clients, case.section, case.ros) == (("a", "b"), "topics", (1, 2))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"title": ""}, "title: expected text"),
        ({"title": "x" * 81}, "at most 80 characters"),
        ({"rules": []}, "at least one rule"),
        ({"rules": ["pub-1"]}, "rules[0]: a rule id is like PUB-01"),
        ({"level": "MAY"}, "level: expected one of MUST"),
        ({"profile": "BASIC"}, "profile: expected one of CORE"),
        ({"colour": 1}, "unknown key `colour`"),
        ({"ros": [3]}, "ros: expected [1], [2] or [1, 2]"),
        ({"alone": 1}, "alone: expected true or false"),
        ({"steps": []}, "steps: a case needs steps"),
        ({"steps": [5]}, "steps[0]: expected an object"),
        ({"steps": [{}]}, "steps[0]: a step has exactly one of send"),
        ({"steps": [{"send": {}, "wait": 1}]}, "exactly one of"),
        ({"steps": [{"send": {}, "within": 1}]}, "unknown key `within`"),
        ({"steps": [{"send": {}, "as": "bob"}]}, "steps[0].as: a client's name is one lower-case letter"),
        ({"steps": [{"send": {}, "times": 0}]}, "steps[0].times: expected a whole number"),
        ({"steps": [{"send_hex": "xyz"}]}, "send_hex: expected pairs of hexadecimal digits"),
        ({"steps": [{"expect": {"$foo": 1}}]}, "unknown matcher `$foo`"),
        ({"steps": [{"expect": {"$any": "thing"}}]}, "`$any` takes one of"),
        ({"steps": [{"expect": {}, "via": ["zip"]}]}, "via[0]: expected one of png"),
        ({"steps": [{"expect": {}, "via": ["fragments"]}]}, "`fragment_size` stands where"),
        ({"steps": [{"expect_nothing": -1}]}, "expected seconds from 0 to 60"),
        ({"steps": [{"settle": []}]}, "settle: expected the names of clients"),
        ({"steps": [{"send": {}}], "probe": False}, "the case cannot fail"),
    ],
)
def test_what_is_wrong_is_named(change: dict[str, Json], said: str) -> None:
    with pytest.raises(CaseError) as refused:
        read_case("topics/thing", {**_GOOD, **change})
    assert str(refused.value).startswith("topics/thing: ")
    assert said in str(refused.value)


@pytest.mark.parametrize("name", ["thing", "Topics/thing", "topics/a_b", "topics/a--b", "topics/"])
def test_ids_have_one_form(name: str) -> None:
    with pytest.raises(CaseError, match="an id is"):
        read_case(name, _GOOD)


@pytest.mark.parametrize("key", ["title", "rules", "level", "profile", "steps"])
def test_what_is_missing_is_named(key: str) -> None:
    with pytest.raises(CaseError, match=f"`{key}` is missing"):
        read_case("topics/thing", {name: value for name, value in _GOOD.items() if name != key})


def test_files_that_are_not_json_are_named_with_their_line(tmp_path: Path) -> None:
    (tmp_path / "topics").mkdir()
    path = tmp_path / "topics" / "x.json"
    path.write_text("{\n oops")
    with pytest.raises(CaseError, match=r"x\.json:2: not JSON"):
        load_case(path, tmp_path)
    path.write_bytes(b"\xff")
    with pytest.raises(CaseError, match="cannot be read"):
        load_cases(tmp_path)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
)


@given(_JSON, st.sampled_from(sorted(_GOOD)))
def test_any_value_is_a_case_or_refused(value: Json, key: str) -> None:
    for whole in (value, {**_GOOD, key: value}):
        try:
            assert read_case("topics/thing", whole).steps
        except CaseError as error:
            assert str(error).startswith("topics/thing")


def test_shipped_targets_can_be_read() -> None:
    assert {"rwt-jazzy", "rwt-noetic", "rosbridge-suite-ros1"} <= set(shipped())
    assert [find_target(name).ros for name in ("rwt-jazzy", "rwt-noetic")] == [2, 1]


@pytest.mark.parametrize("name", shipped())
def test_each_expected_failure_is_of_a_case_that_the_target_is_asked(name: str) -> None:
    target = find_target(name)
    asked = [case.id for case in select(load_cases(), target) if not target.missing(case, _WIRE)]
    for glob in target.expected:
        assert fnmatch.filter(asked, glob), glob


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("oops", "not TOML"),
        ("colour = 1", "`colour`: unknown"),
        ("ros = 3", "`ros`: expected 1 or 2"),
        ("profiles = ['X']", "`profiles`: expected names out of CORE"),
        ("features = 1", "`features`: expected a list"),
        ("settle = -1", "`settle`: expected seconds"),
        ("probe = 'x'", "`probe`: expected one of loopback"),
        ("[expected_failures]\n'a/b' = ''", "expected the reason as text"),
    ],
)
def test_targets_that_cannot_be_used_are_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "t.toml"
    path.write_text(text)
    with pytest.raises(TargetError, match=r"t\.toml") as refused:
        find_target(str(path))
    assert said in str(refused.value)


def test_a_target_that_is_not_there_is_refused() -> None:
    with pytest.raises(TargetError, match="shipped targets are"):
        find_target("nobody")
