from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_graph.parameters.tree import ParameterTree
from rwt_participant.errors import NotFound, ParameterRejected
from rwt_participant.messages import ParameterValue

WHOLES = st.integers(-(2**63), 2**63 - 1)
LEAVES = st.one_of(WHOLES, st.text(max_size=5), st.booleans(), st.none(), st.lists(WHOLES, max_size=3))
KEYS = st.sampled_from("abc")
NAMES = st.lists(KEYS, min_size=1, max_size=3).map(lambda parts: "/" + "/".join(parts))


def test_branches_and_leaves_are_two_views_of_one_tree() -> None:
    tree = ParameterTree()
    tree.set("/robot", {"speed": 1, "arm": {"gain": 0.5}})
    assert tree.get("/robot/arm/gain") == 0.5
    tree.set("/robot/arm/reach", [1, 2])
    assert tree.get("/robot") == {"speed": 1, "arm": {"gain": 0.5, "reach": [1, 2]}}
    assert tree.names() == ("/robot/arm/gain", "/robot/arm/reach", "/robot/speed")
    assert tree.get("/") == {"robot": tree.get("/robot")}
    tree.set("/robot/speed/x", 1)
    assert tree.get("/robot/speed") == {"x": 1}
    tree.delete("/robot/arm")
    assert not tree.has("/robot/arm/gain")
    assert tree.has("/robot")
    tree.set("/", {})
    assert tree.names() == ()


def test_what_is_missing() -> None:
    tree = ParameterTree()
    tree.set("/a", 1)
    for name in ("/b", "/a/b"):
        with pytest.raises(NotFound, match=f"parameter {name} is not set"):
            tree.get(name)
        with pytest.raises(NotFound):
            tree.delete(name)


def test_values_are_copied_in_and_out() -> None:
    tree = ParameterTree()
    given_value = {"list": [1, {"x": 2}]}
    tree.set("/a", given_value)
    given_value["list"].append(3)
    taken = tree.get("/a")
    assert taken == {"list": [1, {"x": 2}]}
    assert isinstance(taken, dict)
    taken["list"].append(4)
    assert tree.get("/a") == {"list": [1, {"x": 2}]}


def test_an_empty_branch_is_a_value() -> None:
    tree = ParameterTree()
    tree.set("/a", {})
    assert tree.get("/a") == {}
    assert tree.names() == ("/a",)


def test_watches_see_values_before_they_are_stored_and_may_refuse() -> None:
    tree = ParameterTree()
    seen: list[ParameterValue] = []

    def watch(value: ParameterValue) -> None:
        if value == "bad":
            raise ParameterRejected("no")
        seen.append(value)

    unwatch = tree.watch("/robot/speed", watch)
    tree.set("/robot/speed", 1)
    tree.set("/robot", {"speed": 2, "other": 3})
    tree.set("/robot", {"other": 4})
    tree.set("/", {"robot": {"speed": 5}})
    tree.set("/robot/speedy", 6)
    assert seen == [1, 2, 5]
    with pytest.raises(ParameterRejected, match="no"):
        tree.set("/robot", {"speed": "bad"})
    assert tree.get("/robot/speed") == 5
    unwatch()
    unwatch()
    tree.set("/robot/speed", "bad")
    assert seen == [1, 2, 5]


@given(st.lists(st.tuples(NAMES, LEAVES), max_size=12))
def test_the_last_value_set_is_found_and_listed(plan: list[tuple[str, ParameterValue]]) -> None:
    tree = ParameterTree()
    for name, value in plan:
        tree.set(name, value)
        assert tree.get(name) == value
        assert name in tree.names()
    for name in tree.names():
        assert tree.has(name)
        tree.delete(name)
    assert tree.names() == tuple(n for n in tree.names() if tree.get(n) == {})
    tree.set("/", {})
    assert (tree.names_set, tree.bytes) == (0, ParameterTree().bytes)


# -- bounds ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [None, 1, "", [], [{}]])
def test_the_root_is_a_table_and_stays(value: ParameterValue) -> None:
    tree = ParameterTree()
    tree.set("/a", 1)
    for name in ("/", "", "//"):
        with pytest.raises(ParameterRejected, match="the root of the parameters is a table"):
            tree.set(name, value)
        with pytest.raises(ParameterRejected, match="root"):
            tree.delete(name)
    assert tree.get("/") == {"a": 1}


def _nested(depth: int, kind: str) -> ParameterValue:
    value: ParameterValue = 1
    for _ in range(depth):
        value = {"a": value} if kind == "tables" else [value]
    return value


@pytest.mark.parametrize("kind", ["tables", "lists"])
def test_depth_counts_the_name_and_the_value(kind: str) -> None:
    tree = ParameterTree(max_depth=10)
    tree.set("/b/c", _nested(8, kind))
    for name, depth in (("/b/c", 9), ("/b/c/d", 8), ("/" + "x/" * 11, 0), ("/b", 300), ("/", 100_000)):
        value = {"a": _nested(depth, kind)} if name == "/" else _nested(depth, kind)
        with pytest.raises(ParameterRejected, match="deeper than 10"):
            tree.set(name, value)
    assert tree.get("/") == {"b": {"c": _nested(8, kind)}}


def test_the_number_of_names_is_bounded() -> None:
    tree = ParameterTree(max_names=4)
    tree.set("/a", {"b": 1, "c": {}})
    tree.set("/e", [{"f": 1}])
    for name in ("/f", "/a/g", "/a/c/d", "/e/f"):
        with pytest.raises(ParameterRejected, match="5 names, and 4 is the limit"):
            tree.set(name, 1)
    tree.set("/a/b", 2)
    tree.delete("/a/c")
    tree.set("/a/b/c", 1)  # the branch replaces the value
    assert tree.names() == ("/a/b/c", "/e") and tree.names_set == 4


@pytest.mark.parametrize("value", ["x" * 2000, "ä" * 500, b"x" * 2000, [0] * 25, {"k" * 2000: 1}])
def test_the_bytes_are_bounded_and_given_back(value: ParameterValue) -> None:
    tree = ParameterTree(max_bytes=5000)
    tree.set("/a", value)
    held = tree.bytes
    tree.set("/a", value)
    assert tree.bytes == held
    tree.set("/b/c", value)
    with pytest.raises(ParameterRejected, match="bytes, and 5000 is the limit"):
        tree.set("/d", value)
    tree.delete("/b")
    assert tree.bytes == held
    assert list(tree.get("/") or {}) == ["a"]


def test_a_value_that_no_text_can_say_is_refused() -> None:
    tree = ParameterTree()
    for value in (10**5000, [2**64], {"a": -(2**64)}):
        with pytest.raises(ParameterRejected, match="64 bits"):
            tree.set("/a", value)
    assert tree.names() == ()


def test_a_refusal_does_not_call_watches() -> None:
    tree = ParameterTree(max_names=2)
    seen: list[ParameterValue] = []
    tree.watch("/a/b", seen.append)
    with pytest.raises(ParameterRejected):
        tree.set("/a", {"b": 1, "c": 2})
    assert seen == []
