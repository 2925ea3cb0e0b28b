"""Comparison of a message with expected fields."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeAlias, TypeGuard

from msgspec import Struct

from rwt.extensions.testing.errors import ScriptError, instead
from rwt_participant.messages import Message

#: Some fields of a message with their values, nested like the message; a predicate; or None for any message.
Matching: TypeAlias = "Mapping[str, object] | Callable[[Message], object] | None"

#: Tolerance for floats: larger than the rounding error of float32.
RELATIVE = 1e-6
ABSOLUTE = 1e-9


def mismatch(message: Message, wanted: Matching) -> str:
    """Describe why a message does not match; return an empty string if it does.

    Floats may differ by a millionth. Lists must have the same length.

    Raises:
        ScriptError: `wanted` names a field that the message does not have.
    """
    if wanted is None:
        return ""
    if not isinstance(wanted, Mapping):
        return "" if wanted(message) else "the function says no"
    return _mismatch(message, wanted, "")


def _mismatch(value: object, wanted: object, path: str) -> str:
    if isinstance(wanted, Mapping) and isinstance(value, Struct):
        return _fields_mismatch(value, wanted, path)
    if isinstance(wanted, Sequence) and not isinstance(wanted, str | bytes) and _is_list(value):
        return _items_mismatch(value, wanted, path)
    if _equal(value, wanted):
        return ""
    return f"{path} is {_shown(value)}, not {_shown(wanted)}"


def _fields_mismatch(value: Struct, wanted: Mapping[str, object], path: str) -> str:
    for name, inner in wanted.items():
        if name not in value.__struct_fields__:
            where = f"{path}.{name}" if path else name
            raise ScriptError(
                f"no message here has a field `{where}`; {instead(name, value.__struct_fields__)}"
            )
        why = _mismatch(getattr(value, name), inner, f"{path}.{name}" if path else name)
        if why:
            return why
    return ""


def _is_list(value: object) -> bool:
    return isinstance(value, Iterable) and not isinstance(value, str | bytes)


def _items_mismatch(value: object, wanted: Sequence[object], path: str) -> str:
    items = list(value) if isinstance(value, Iterable) else []
    if len(items) != len(wanted):
        return f"{path} has {len(items)} items, not {len(wanted)}"
    for index, (item, inner) in enumerate(zip(items, wanted, strict=True)):
        why = _mismatch(item, inner, f"{path}[{index}]")
        if why:
            return why
    return ""


def _equal(value: object, wanted: object) -> bool:
    if _is_number(value) and _is_number(wanted) and float in (type(value), type(wanted)):
        both_nan = math.isnan(value) and math.isnan(wanted)
        return both_nan or math.isclose(value, wanted, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    return bool(wanted == value)


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float)


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:80] + "…"
