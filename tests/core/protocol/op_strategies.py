"""Ops of every kind, for property tests: each member by the words in which refusals name it."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from rwt_protocol.error_text import annotation_of, expected
from rwt_protocol.ops import Op, Qos
from rwt_protocol.ops.base import MOST, MOST_SECONDS

_NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=5)
_SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=5)
)
_BEYOND_JSON = _SCALARS | st.floats() | st.binary(max_size=5)
_SECONDS = st.floats(0, MOST_SECONDS)


def _values(scalars: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.recursive(
        scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_NAMES, inner, max_size=3)
    )


def _members(scalars: st.SearchStrategy[Any]) -> dict[str, st.SearchStrategy[Any]]:
    value = _values(scalars)
    an_object = st.dictionaries(_NAMES, value, max_size=3)
    return {
        "a string": st.text(max_size=8),
        "true or false": st.booleans(),
        "a string of at most 4096 characters or a 64-bit integer": st.text(max_size=8)
        | st.integers(-(2**63), 2**63 - 1),
        "a whole number": st.integers(-MOST, MOST),
        "a whole number, zero or more": st.integers(0, MOST),
        "a whole number, one or more": st.integers(1, MOST),
        "a whole number from 0 to 6": st.integers(0, 6),
        "a number of seconds": st.floats(-MOST_SECONDS, MOST_SECONDS),
        "a time in seconds": st.integers(-MOST, MOST),
        '"info", "warning", "error" or "none"': st.sampled_from(["info", "warning", "error", "none"]),
        "an object or an array": an_object | st.lists(value, max_size=3),
        "an object, or a string that says what failed": an_object | st.text(max_size=8),
        "an object": an_object,
        '"keep_last" or "keep_all"': st.sampled_from(["keep_last", "keep_all"]),
        '"reliable", "best_effort" or "best_available"': st.sampled_from(["reliable", "best_effort"]),
        '"volatile", "transient_local" or "best_available"': st.sampled_from(["volatile", "best_available"]),
        'seconds, {"secs", "nsecs"}, "infinite" or "best_available"': _SECONDS | st.just("best_available"),
        'seconds, {"secs", "nsecs"} or "infinite"': _SECONDS | st.just("infinite"),
    }


def members_of(model: type[Op] | type[Qos], beyond_json: bool) -> st.SearchStrategy[dict[str, Any]]:
    """The members of messages of `model` but `op`, optional ones sometimes left out.

    Args:
        model: what they make.
        beyond_json: whether payloads hold octets and NaN too.
    """
    known = _members(_BEYOND_JSON if beyond_json else _SCALARS)
    fields = {name: field for name, field in model.model_fields.items() if name != "op"}
    found = {
        name: members_of(Qos, beyond_json) if name == "qos" else known[expected(annotation_of(field))]
        for name, field in fields.items()
    }
    return st.fixed_dictionaries(
        {name: found[name] for name, field in fields.items() if field.is_required()},
        optional={name: found[name] for name, field in fields.items() if not field.is_required()},
    )
