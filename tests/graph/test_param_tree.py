from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_graph import NotFound, ParameterRejected
from rwt_graph.parameters.tree import ParameterTree
from rwt_program.messages import ParameterValue

LEAVES = st.one_of(
    st.integers(), st.text(max_size=5), st.booleans(), st.none(), st.lists(st.integers(), max_size=3)
)
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
    tree.delete("/")
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
