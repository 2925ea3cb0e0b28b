"""Messages as people and programs read them: plain values, shortened if wanted, one field, text, CSV."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import pybase64

from rwt_cli.errors import CALLED_WRONGLY, CommandError, did_you_mean
from rwt_interfaces import field_types as shapes

if TYPE_CHECKING:
    from rwt_cli.console.yaml_text import YamlValue
    from rwt_interfaces.field_types import Shape
    from rwt_interfaces.structs import MessageType

_STEP: Final = re.compile(r"([A-Za-z][A-Za-z0-9_]*)((?:\[[0-9]{1,9}\])*)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Formatting:
    """How much of a message is told, and for whom.

    Attributes:
        arrays: whether arrays are told; else only how long they are.
        strings: whether strings are told; else only how long they are.
        longest: items and characters after which an array or a string is cut; None for no cut.
        json: octets as base64 and NaN as null, as rosbridge sends them.
    """

    arrays: bool = True
    strings: bool = True
    longest: int | None = None
    json: bool = False


def plain(
    message_type: MessageType, message: Any, formatting: Formatting = Formatting()
) -> dict[str, YamlValue]:
    """A message as plain values, fields in the definition's order."""
    return {
        slot.name: plain_value(slot.shape, getattr(message, slot.attribute), formatting)
        for slot in message_type.slots
    }


def plain_value(shape: Shape, value: Any, formatting: Formatting) -> YamlValue:
    """What a field holds as plain values."""
    match shape:
        case shapes.Message(type=nested) if nested.time is None:
            return plain(nested, value, formatting)
        case shapes.Message(type=nested):
            return _time(nested.time, value)
        case shapes.Time():
            return _time(shape, value)
        case shapes.Array(element=element):
            return _items(shape, [*value], element, formatting)
        case shapes.Octets():
            return _octets(shape, value, formatting)
        case shapes.String():
            return _string(value, formatting)
        case shapes.Float():
            return None if formatting.json and not math.isfinite(value) else float(value)
        case _:
            plain_one: YamlValue = value
            return plain_one


def _time(shape: shapes.Time | None, value: Any) -> YamlValue:
    assert shape is not None  # Only times are asked for.
    return {key: int(getattr(value, key)) for key in shape.keys}


def _items(
    shape: shapes.Array, items: list[Any], element: shapes.Scalar, formatting: Formatting
) -> YamlValue:
    if not formatting.arrays:
        return _only_length(shape.length is not None, str(element), len(items))
    cut = formatting.longest is not None and len(items) > formatting.longest
    told: list[YamlValue] = [
        plain_value(element, item, formatting) for item in (items[: formatting.longest] if cut else items)
    ]
    return [*told, "..."] if cut else told


def _octets(shape: shapes.Octets, octets: Any, formatting: Formatting) -> YamlValue:
    if not formatting.arrays:
        return _only_length(shape.length is not None, "uint8", len(octets))
    cut = formatting.longest is not None and len(octets) > formatting.longest
    told = bytes(octets[: formatting.longest] if cut else octets)
    if formatting.json:
        return pybase64.b64encode(told).decode() + ("..." if cut else "")
    return [*told, "..."] if cut else [*told]


def _only_length(fixed: bool, element: str, length: int) -> str:
    if fixed:
        return f"<array type: {element}[{length}]>"
    return f"<sequence type: {element}, length: {length}>"


def _string(text: str, formatting: Formatting) -> str:
    if not formatting.strings:
        return f"<string length: <{len(text)}>>"
    if formatting.longest is not None and len(text) > formatting.longest:
        return f"{text[: formatting.longest]}..."
    return text


# -- one field ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class FieldPath:
    """A way to one field of a message: ``pose.pose.position.x``, ``transforms[0].child_frame_id``.

    Attributes:
        text: as it was typed.
        steps: names of attributes, and indices.
        shape: what is there.
    """

    text: str
    steps: tuple[str | int, ...]
    shape: Shape

    def of(self, message: Any) -> Any:
        """What `message` holds there.

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
    shape: Shape = shapes.Message(message_type)
    for word in text.split("."):
        found = _STEP.fullmatch(word)
        if found is None:
            raise CommandError(
                f"--field {text}: expected names and indices, as in pose.position.x or ranges[0]",
                CALLED_WRONGLY,
            )
        attribute, shape = _field_of(shape, found[1], text)
        steps.append(attribute)
        for index in re.findall(r"[0-9]+", found[2]):
            steps.append(int(index))
            shape = _element_of(shape, text)
    return FieldPath(text, tuple(steps), shape)


def _field_of(shape: Shape, name: str, text: str) -> tuple[str, Shape]:
    time = shape.type.time if isinstance(shape, shapes.Message) else shape
    if isinstance(time, shapes.Time):
        known: dict[str, tuple[str, Shape]] = {
            key: (key, part) for key, part in zip(time.keys, (time.seconds, time.nanoseconds), strict=True)
        }
    elif isinstance(shape, shapes.Message):
        known = {slot.name: (slot.attribute, slot.shape) for slot in shape.type.slots}
    else:
        raise CommandError(f"--field {text}: {shape} has no fields, so no {name}", CALLED_WRONGLY)
    if name not in known:
        meant = did_you_mean(name, known) or f"; it has {', '.join(known) or 'none'}"
        raise CommandError(f"--field {text}: {shape} has no field {name}{meant}", CALLED_WRONGLY)
    return known[name]


def _element_of(shape: Shape, text: str) -> Shape:
    if isinstance(shape, shapes.Array):
        return shape.element
    if isinstance(shape, shapes.Octets):
        return shapes.UINT8
    raise CommandError(f"--field {text}: {shape} is no array", CALLED_WRONGLY)


# -- other texts -------------------------------------------------------------------------------------------


def csv_line(value: YamlValue) -> str:
    """All values in order, between commas (RFC 4180, but for the line end)."""
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
    """A message as the ``ros2`` tool prints one that it sends: ``std_msgs.msg.String(data='hello')``."""
    return _constructed(shapes.Message(message_type), message)


def _constructed(shape: Shape, value: Any) -> str:
    match shape:
        case shapes.Message(type=nested):
            keys = nested.time.keys if nested.time is not None else None
            inner = (
                ", ".join(f"{key}={getattr(value, key)}" for key in keys)
                if keys is not None
                else ", ".join(
                    f"{slot.name}={_constructed(slot.shape, getattr(value, slot.attribute))}"
                    for slot in nested.slots
                )
            )
            return f"{nested.registry.full_name(nested.name).replace('/', '.')}({inner})"
        case shapes.Time(is_duration=is_duration, keys=keys):
            name = "Duration" if is_duration else "Time"
            return (
                f"builtin_interfaces.msg.{name}({', '.join(f'{key}={getattr(value, key)}' for key in keys)})"
            )
        case shapes.Array(element=element):
            return f"[{', '.join(_constructed(element, item) for item in value)}]"
        case shapes.Octets():
            return repr([*value])
        case _:
            return repr(value)
