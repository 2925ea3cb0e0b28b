"""Messages as plain values for a model: long lists and octets are summarised."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import msgspec

from rwt.extensions.mcp.errors import ToolError
from rwt_participant.messages import Message
from rwt_participant.spelling import did_you_mean

#: Maximum length of a list of numbers that is shown whole; longer ones are summarised.
_NUMBERS: Final = 24
_FIRST_NUMBERS: Final = 8

#: Maximum number of items shown of other lists.
_ITEMS: Final = 12

#: Maximum number of characters shown of a string.
_CHARACTERS: Final = 4000


def plain(value: object) -> object:
    """Return a message, or the value of a field, as dicts, lists, strings and numbers of bounded size."""
    if isinstance(value, msgspec.Struct):
        names = type(value).__struct_encode_fields__
        return {
            name: plain(getattr(value, attribute))
            for name, attribute in zip(names, value.__struct_fields__, strict=True)
        }
    if isinstance(value, str):
        return value if len(value) <= _CHARACTERS else f"{value[:_CHARACTERS]}… ({len(value)} characters)"
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, bytes | bytearray | memoryview):
        return _octets(bytes(value[:_NUMBERS]), len(value))
    if isinstance(value, dict):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, Iterable):
        return _list(value if isinstance(value, Sequence) else list(value))
    return str(value)


def _octets(first: bytes, length: int) -> object:
    return list(first) if length <= _NUMBERS else f"{length} bytes"


def _list(items: Sequence[object]) -> object:
    length = len(items)
    if length > _NUMBERS and isinstance(items[0], int | float) and not isinstance(items[0], bool):
        return _numbers(items)
    shown = [plain(each) for each in items[: _NUMBERS if length <= _NUMBERS else _ITEMS]]
    return shown if len(shown) == length else {"length": length, "first": shown}


def _numbers(items: Sequence[object]) -> dict[str, object]:
    import numpy as np  # Imported here: only long lists need it.

    values = np.asarray(items, np.float64)
    finite = values[np.isfinite(values)]
    about: dict[str, object] = {"length": len(values)}
    if len(finite) < len(values):
        about["finite"] = len(finite)
    if len(finite):
        least, most = float(finite.min()), float(finite.max())
        # Divide before adding: a sum of the largest floats would overflow.
        with np.errstate(over="ignore"):
            mean = float(np.clip((finite / len(finite)).sum(), least, most))
        about |= {"min": least, "max": most, "mean": mean}
    return {**about, "first": [plain(each) for each in items[:_FIRST_NUMBERS]]}


def field(message: Message, path: str) -> object:
    """Return the value of one field, such as `pose.position.x` or `ranges[0]`. Raises ToolError."""
    value: object = message
    for step in path.split("."):
        name, *indices = step.split("[")
        value = _member(value, name, path)
        for index in indices:
            value = _item(value, index, path)
    return value


def _member(value: object, name: str, path: str) -> object:
    if not isinstance(value, msgspec.Struct):
        raise ToolError(f"`{path}`: there is nothing below {name!r}, which stands in no message")
    names = type(value).__struct_encode_fields__
    if name not in names:
        raise ToolError(
            f"`{path}`: there is no field {name!r}{did_you_mean(name, names)}; there are {', '.join(names)}"
        )
    return getattr(value, value.__struct_fields__[names.index(name)])


def _item(value: object, index: str, path: str) -> object:
    digits = index.removesuffix("]")
    if not index.endswith("]") or not digits.isascii() or not digits.isdecimal() or len(digits) > 9:
        raise ToolError(f"`{path}`: expected a number in brackets, as `ranges[0]`")
    if isinstance(value, str) or not hasattr(value, "__getitem__") or not hasattr(value, "__len__"):
        raise ToolError(f"`{path}`: [{digits}] is asked of what is no list")
    length = len(value)
    if int(digits) >= length:
        raise ToolError(f"`{path}`: [{digits}] is beyond the end: the list has {length} items")
    found: object = value[int(digits)]
    return found


def numeric_fields(message: Message, prefix: str = "") -> dict[str, float]:
    """Return the numeric fields of a message by their paths; lists are left out."""
    found: dict[str, float] = {}
    for name, attribute in zip(
        type(message).__struct_encode_fields__, message.__struct_fields__, strict=True
    ):
        value = getattr(message, attribute)
        if isinstance(value, msgspec.Struct):
            found |= numeric_fields(value, f"{prefix}{name}.")
        elif isinstance(value, bool | int | float):
            found[f"{prefix}{name}"] = float(value)
    return found
