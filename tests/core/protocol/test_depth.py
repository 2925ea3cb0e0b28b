"""The depth of JSON text, against counting it in the parsed value."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.codecs.full_split import deeper_than

_VALUES = st.recursive(
    st.one_of(st.integers(0, 9), st.text(alphabet='"\\{}[]a', max_size=8)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.text(alphabet='"\\{}[]a', max_size=4), inner, max_size=3),
    ),
    max_leaves=40,
)


def depth(value: Any) -> int:
    if isinstance(value, dict):
        return 1 + max(map(depth, value.values()), default=0)
    if isinstance(value, list):
        return 1 + max(map(depth, value), default=0)
    return 0


@given(_VALUES, st.integers(0, 8))
def test_it_is_what_parsing_finds(value: Any, limit: int) -> None:
    assert deeper_than(json.dumps(value).encode(), limit) is (depth(value) > limit)


@pytest.mark.parametrize("limit", [1, 2, 99, 100])
def test_the_limit_itself_is_allowed(limit: int) -> None:
    assert not deeper_than(b"[" * limit + b"]" * limit, limit)
    assert deeper_than(b"[" * (limit + 1) + b"]" * (limit + 1), limit)
    assert not deeper_than(b"[" + b"{}," * 500 + b"{}]", max(limit, 2))


def test_brackets_in_strings_do_not_cancel_brackets() -> None:
    hidden = b'["]",["]",["]",["[","["]]],"[","[","["]'
    assert depth(json.loads(hidden)) == 4
    assert deeper_than(hidden, 3)
    assert not deeper_than(hidden, 4)


@pytest.mark.parametrize("levels", [90, 99, 100, 101, 150])
def test_what_is_deep_all_over_is_counted_as_well(levels: int) -> None:
    each = b"[" * (levels - 1) + b'{"[\\"]\\\\":1}' + b"]" * (levels - 1)
    assert deeper_than(b"[" + b",".join([each] * 2_000) + b"]", 100) is (levels + 1 > 100)
    assert deeper_than(b",".join([each] * 2_000), 100) is (levels > 100)
