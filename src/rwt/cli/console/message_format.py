"""Output formats of messages: plain values, truncated if wanted, single fields, text, CSV."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, TypeVar

import pybase64

from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt_interfaces import field_types
from rwt_participant.spelling import did_you_mean

if TYPE_CHECKING:
    from rwt.cli.console.yaml_text import YamlValue
    from rwt_interfaces.field_types import FieldType
    from rwt_interfaces.structs import MessageType

Items = TypeVar("Items", list[Any], bytes, str)

_STEP: Final = re.compile(r"([A-Za-z][A-Za-z0-9_]*)((?:\[[0-9]{1,9}\])*)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Formatting:
    """Options of the output of a message.

    Attributes:
        arrays: show arrays; if false only their length.
        strings: show strings; if false only their length.
        longest: maximum items of an array and characters of a string; None for no limit.
        json: show octets as base64 and NaN as null, as rosbridge sends them.
    """

    arrays: bool = True
    strings: bool = True
    longest: int | None = None
    json: bool = False


def plain(
    message_type: MessageType, message: Any, formatting: Formatting = Formatting()
) -> dict[str, YamlValue]:
    """Convert a message to plain values, with fields in the definition's order."""
    return {
        slot.name: plain_value(slot.type, getattr(message, slot.attribute), formatting)
        for slot in message_type.slots
    }


def plain_value(field_type: FieldType, value: Any, formatting: Formatting) -> YamlValue:
    """Convert the value of a field to plain values."""
    match field_type:
        case field_types.Message(type=nested) if nested.time is None:
            return plain(nested, value, formatting)
        case field_types.Message(type=nested):
            return _time(nested.time, value)
        case field_types.Time():
            return _time(field_type, value)
        case field_types.Array() | field_types.Octets() if not formatting.arrays:
            return _only_length(field_type, len(value))
        case field_types.Array(element=element):
            items, more = _cut([*value], formatting)
            return [*(plain_value(element, item, formatting) for item in items), *more]
        case field_types.Octets():
            octets, more = _cut(bytes(value), formatting)
            if formatting.json:
                return "".join([pybase64.b64encode(octets).decode(), *more])
            return [*octets, *more]
        case field_types.String() if not formatting.strings:
            return f"<string length: <{len(value)}>>"
        case field_types.String():
            text, more = _cut(value, formatting)
            return "".join([text, *more])
        case field_types.Float():
            return None if formatting.json and not math.isfinite(value) else float(value)
        case _:
            plain_one: YamlValue = value
            return plain_one


def _time(field_type: field_types.Time | None, value: Any) -> YamlValue:
    assert field_type is not None  # Only times are asked for.
    return {key: int(getattr(value, key)) for key in field_type.keys}


def _cut(items: Items, formatting: Formatting) -> tuple[Items, tuple[str, ...]]:
    """Return as many items as are shown, and a mark if there are more."""
    is_cut = formatting.longest is not None and len(items) > formatting.longest
    return items[: formatting.longest], ("...",) if is_cut else ()


def _only_length(field_type: field_types.Array | field_types.Octets, length: int) -> str:
    element = field_type.element if isinstance(field_type, field_types.Array) else field_types.UINT8
    if field_type.length is not None:
        return f"<array type: {element}[{length}]>"
    return f"<sequence type: {element}, length: {length}>"


# -- one field ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class FieldPath:
    """Path to a field of a message: ``pose.pose.position.x``, ``transforms[0].child_frame_id``."""

    text: str
    steps: tuple[str | int, ...]
    field_type: FieldType

    def of(self, message: Any) -> Any:
        """Return the value of the field in `message`.

        Raises:
            CommandError: an array is too short.
        """
        value = message
        for step in self.steps:
            if isinstance(step, str):
                value = getattr(value, step)
            elif step < len(value):
                value = value[step]
            else:
                raise CommandError(f"--field {self.text}: there are only {len(value)} items in this message")
        return value


def field_path(message_type: MessageType, text: str) -> FieldPath:
    """Find a field by its path.

    Raises:
        CommandError: there is no such field; names the nearest.
    """
    steps: list[str | int] = []
    field_type: FieldType = field_types.Message(message_type)
    for word in text.split("."):
        found = _STEP.fullmatch(word)
        if found is None:
            raise CommandError(
                f"--field {text}: expected names and indices, as in pose.position.x or ranges[0]",
                CALLED_WRONGLY,
            )
        attribute, field_type = _field_of(field_type, found[1], text)
        steps.append(attribute)
        for index in re.findall(r"[0-9]+", found[2]):
            steps.append(int(index))
            field_type = _element_of(field_type, text)
    return FieldPath(text, tuple(steps), field_type)


def _field_of(field_type: FieldType, name: str, text: str) -> tuple[str, FieldType]:
    time = field_type.type.time if isinstance(field_type, field_types.Message) else field_type
    if isinstance(time, field_types.Time):
        known: dict[str, tuple[str, FieldType]] = {
            key: (key, part) for key, part in zip(time.keys, (time.seconds, time.nanoseconds), strict=True)
        }
    elif isinstance(field_type, field_types.Message):
        known = {slot.name: (slot.attribute, slot.type) for slot in field_type.type.slots}
    else:
        raise CommandError(f"--field {text}: {field_type} has no fields, so no {name}", CALLED_WRONGLY)
    if name not in known:
        meant = did_you_mean(name, known) or f"; it has {', '.join(known) or 'none'}"
        raise CommandError(f"--field {text}: {field_type} has no field {name}{meant}", CALLED_WRONGLY)
    return known[name]


def _element_of(field_type: FieldType, text: str) -> FieldType:
    if isinstance(field_type, field_types.Array):
        return field_type.element
    if isinstance(field_type, field_types.Octets):
        return field_types.UINT8
    raise CommandError(f"--field {text}: {field_type} is not an array", CALLED_WRONGLY)


# -- other texts -------------------------------------------------------------------------------------------


def csv_line(value: YamlValue) -> str:
    """Return all values in order, separated by commas (RFC 4180 without the line end)."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="").writerow(_leaves(value))
    return buffer.getvalue()


def _leaves(value: YamlValue) -> Iterator[YamlValue]:
    if isinstance(value, dict):
        for item in value.values():
            yield from _leaves(item)
    elif isinstance(value, list):
        for item in value:
            yield from _leaves(item)
    else:
        yield value


def constructor(message_type: MessageType, message: Any) -> str:
    """Return a message as the ``ros2`` tool prints those it sends: ``std_msgs.msg.String(data='hello')``."""
    return _constructed(field_types.Message(message_type), message)


def _constructed(field_type: FieldType, value: Any) -> str:
    match field_type:
        case field_types.Message(type=nested) if nested.time is not None:
            return _constructed(nested.time, value)
        case field_types.Message(type=nested):
            fields = (
                f"{slot.name}={_constructed(slot.type, getattr(value, slot.attribute))}"
                for slot in nested.slots
            )
            return f"{nested.registry.full_name(nested.name).replace('/', '.')}({', '.join(fields)})"
        case field_types.Time(is_duration=is_duration, keys=keys):
            name = "Duration" if is_duration else "Time"
            parts = (f"{key}={getattr(value, key)}" for key in keys)
            return f"builtin_interfaces.msg.{name}({', '.join(parts)})"
        case field_types.Array(element=element):
            return f"[{', '.join(_constructed(element, item) for item in value)}]"
        case field_types.Octets():
            return repr([*value])
        case _:
            return repr(value)
