"""Limits on the fields of messages: ranges, rates of change, allowed strings, and non-finite numbers."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from operator import attrgetter, is_
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import msgspec

from rwt.access.errors import GateRefused
from rwt_interfaces import field_types
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload

if TYPE_CHECKING:
    from rwt.access.gate.rules import Rule
    from rwt.access.settings import FieldLimit
    from rwt_interfaces.structs import MessageType

#: Longest interval, in seconds, that counts for a rate: a value must not jump after a pause.
_MAX_STEP_SECONDS: Final = 0.1

#: Seconds of silence after which the robot is assumed to have stopped by itself.
_STANDSTILL_SECONDS: Final = 0.5

#: A JSON text that is passed on as received has no NaN and no infinity, but it may have `null`, which is NaN.
_find_null: Final = re.compile(rb"null").search

#: Brackets of a path: every item of a list, or one.
_BRACKETS: Final = re.compile(r"\[([0-9]*)\]")

#: String in a JSON text.
_STRING: Final = re.compile(r'"[^"\\]*(?:\\.[^"\\]*)*"')

MAX_APPROVED_BYTES: Final = 1 << 20
"""Maximum size of a message that may require approval: it is digested at once."""

BYTES_OF_ITEM: Final = 32
"""Bytes of a message that is decoded to be checked, for each item that its lists may have."""

#: Maximum number of clamped numbers that a description of the changes names.
_MAX_CHANGES: Final = 8


#: Maximum number of values of a field from which a description states the range.
_MAX_DESCRIBED: Final = 10_000


class Change(NamedTuple):
    """Number that a limit has changed."""

    where: str
    before: float
    after: float


#: Stands in a list of changes for one that the description does not name.
_UNNAMED: Final = Change("", 0.0, 0.0)

_Check = Callable[[Any, str, float, list[Change]], object]
"""Check of a value at a path at a time. Returns the value or its replacement, which it adds to the list."""


class Clamped:
    """Numbers of a message that limits have changed.

    Args:
        changes: changes in the order of the limits; one number may be changed several times.
    """

    __slots__ = ("_changes",)

    def __init__(self, changes: Sequence[Change]) -> None:
        self._changes = tuple(changes)

    @property
    def _named(self) -> list[Change]:
        return [change for change in self._changes if change is not _UNNAMED][:_MAX_CHANGES]

    def __str__(self) -> str:
        texts = [f"{where}: {after:g} in place of {before:g}" for where, before, after in self._named]
        more = len(self._changes) - len(texts)
        return "; ".join([*texts, f"{more} more"] if more else texts)

    def before(self) -> Mapping[str, float]:
        """Return the numbers before, by path."""
        return {change.where: change.before for change in reversed(self._named)}

    def after(self) -> Mapping[str, float]:
        """Return the numbers after the last change, by path."""
        return {change.where: change.after for change in self._named}


class NoSuchField(Exception):
    """A rule limits a field that the type does not have, or whose type does not fit. The text names it."""


class Motion:
    """Values that were last passed on to a topic, for limits on rates.

    The values of one message are collected by :meth:`note`, until :meth:`passed` or :meth:`refused`.

    Attributes:
        at: time of the last message, in seconds of a steady clock.
    """

    __slots__ = ("_next", "_values", "at")

    def __init__(self) -> None:
        self.at = -math.inf
        self._values: dict[str, float] = {}
        self._next: dict[str, float] = {}

    def bounds(self, where: str, neutral: float | None, rate: float, now: float) -> tuple[float, float]:
        """Return the smallest and the largest value that a field may have now.

        A field may jump towards its neutral value, so that braking is never limited. Without one, the value
        stays during silence, and the first one is not limited.
        """
        silence = now - self.at
        if neutral is None:
            before, step = self._values.get(where), rate * min(silence, _MAX_STEP_SECONDS)
            return (-math.inf, math.inf) if before is None else (before - step, before + step)
        last = neutral if silence > _STANDSTILL_SECONDS else self._values.get(where, neutral)
        step = rate * min(silence, _MAX_STEP_SECONDS)
        return min(last, neutral) - step, max(last, neutral) + step

    def note(self, where: str, value: float) -> None:
        """Collect a value of the current message."""
        self._next[where] = value

    def passed(self, now: float) -> None:
        """Store the values of the current message, which was passed on."""
        self.at = now
        if self._next:
            # Replaced, so that fields of longer lists are not kept.
            self._values, self._next = self._next, {}

    def refused(self) -> None:
        """Discard the values of the current message, which was rejected."""
        self._next.clear()

    def take_over(self, other: Motion) -> None:
        """Continue the values of another topic object, whose rules were replaced."""
        self.at = other.at
        self._values.update(other._values)

    def reset(self) -> None:
        """Forget all values: the robot was told to stop."""
        self.at = -math.inf
        self._values.clear()
        self._next.clear()


class FieldChecks:
    """Limits of one rule, compiled for messages of one type.

    Args:
        motion: values last passed on to the topic; None for requests and goals, whose rates are not limited.
        neutral: stop message, away from which rates count; None: zeros.
        limits: limits in place of the rule's own.

    Raises:
        NoSuchField: the type has no such field, or it does not have the type that the limit is for.
    """

    def __init__(
        self,
        rule: Rule,
        type: MessageType,
        motion: Motion | None = None,
        neutral: msgspec.Struct | None = None,
        limits: Mapping[str, FieldLimit] | None = None,
    ) -> None:
        settings, key = rule.settings, f"{rule.key}.fields"
        self._key = rule.key
        self._type = type
        self._max_bytes = settings.largest_bytes
        self._max_items = settings.largest_items
        self._count = _compile_count(type)
        self._has_lists = has_lists(type)
        self._colons = _colons_of(type)
        self._float_sum = _compile_float_sum(type) if settings.finite else None
        checks: list[_Check] = []
        for path, limit in (settings.fields if limits is None else limits).items():
            parts = _resolve(type, path, limit, key)
            leaf: _Check
            if limit.one_of:
                leaf = _one_of(limit, key)
            else:
                is_from_stop = limit.rate is not None and limit.rate_from == "stop"
                neutrals = dict(_values_at(parts, neutral)) if is_from_stop and neutral is not None else {}
                leaf = _Range(limit, key, motion, neutrals)
            checks.append(_at(parts, leaf))
        self._checks = tuple(checks)

    @property
    def is_empty(self) -> bool:
        """True if every message of the type passes."""
        return not (self._checks or self._float_sum or self._max_bytes)

    def check(self, payload: Payload, now: float) -> tuple[Payload, Sequence[Change]]:
        """Check a message; return the one to pass on, and what was clamped.

        Args:
            now: seconds of a steady clock.

        Raises:
            GateRefused: a limit is exceeded; the text names the field and the rule.
        """
        if self._max_bytes and payload.size > self._max_bytes:
            raise GateRefused(
                f"a message of {payload.size} bytes: {self._max_bytes} is the limit",
                f"{self._key}.largest_bytes",
            )
        if not self._checks and (
            self._float_sum is None or (payload.is_passthrough and not _find_null(payload.json()))
        ):
            return payload, ()
        if self._has_lists:
            self._require_few(payload)
        given = payload.value()
        # A finite sum proves that every number is finite. Finite numbers may overflow: then look at each.
        if self._float_sum is not None and not math.isfinite(self._float_sum(given)):
            where = _not_finite(given, self._type, "")
            if where:
                raise GateRefused(f"{where}: expected a finite number", f"{self._key}.finite")
        changes: list[Change] = []
        value: object = given
        for check in self._checks:
            value = check(value, "", now, changes)
        if value is given:
            text = payload.received_json
            if not self._checks or text is None or bytes(text).count(b":") == self._colons:
                return payload, ()
            return Payload.from_value(self._type, given), ()
        try:
            return Payload.from_value(self._type, value), changes
        except InvalidMessage as error:
            # The limit itself is outside the range of the field's type.
            raise GateRefused(str(error), f"{self._key}.fields") from None

    def _require_few(self, payload: Payload) -> None:
        """Raise GateRefused for a message that is too large to be checked at once, if possible undecoded."""
        most, key = self._max_items, f"{self._key}.largest_items"
        if not payload.is_decoded:
            size, most_bytes = payload.kept_size, BYTES_OF_ITEM * most
            if size > most_bytes:
                raise GateRefused(
                    f"a message of {size} bytes: {most_bytes} is the limit where fields are checked", key
                )
        if self._count is not None and self._count(payload.value(), most) > most:
            raise GateRefused(f"more than {most} items in its lists, the limit where fields are checked", key)


def has_finite_numbers(text: str) -> bool:
    """Return True if no number of a JSON text is NaN or infinite, and nothing in it is null.

    A text that is not JSON has none: what reads it rejects it.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return True
    try:
        json.dumps(value, allow_nan=False)  # In C: a walk in Python takes 50 ms for the largest texts.
    except (ValueError, RecursionError):
        return False
    return "null" not in _STRING.sub("", text)


def describe_fields(payload: Payload, limits: Mapping[str, FieldLimit]) -> str:
    """Return the values of the fields of a message that have limits; of a list, the range and the number."""
    found: list[str] = []
    for path, limit in limits.items():
        try:
            parts = _resolve(payload.type, path, limit, "")
        except NoSuchField:
            continue  # Of another rule, for another kind of act.
        values = [value for _, value in islice(_values_at(parts, payload.value()), _MAX_DESCRIBED + 1)]
        if len(values) > _MAX_DESCRIBED:
            found.append(f"{path} has more than {_MAX_DESCRIBED} values")
            continue
        if len(values) == 1:
            found.append(f"{path} = {_described(values[0])}")
        elif values:
            span = f"{_described(min(values))} to {_described(max(values))}"
            found.append(f"{path} = {span} ({len(values)} values)")
    return ", ".join(found)


def _described(value: object) -> str:
    """Return a value as it is shown to a person; a quoted text cannot look like other fields."""
    return json.dumps(value[:100]) if isinstance(value, str) else str(value)[:100]


class _Part(NamedTuple):
    """Part of a path between brackets.

    Attributes:
        text: the part as ROS spells it.
        attributes: the part as Python spells it.
        item: brackets that follow: the index of an item, empty for every item, None at the end of the path.
    """

    text: str
    attributes: str
    item: str | None


_END: Final = _Part("", "", None)


def _resolve(type: MessageType, path: str, limit: FieldLimit, key: str) -> list[_Part]:
    """Return the parts of a path between the brackets. Raises NoSuchField."""
    attributes: list[str] = []
    kind: field_types.FieldType = field_types.Message(type)
    for part in path.split("."):
        name, bracket, item = part.partition("[")
        if not isinstance(kind, field_types.Message):
            raise NoSuchField(f'`{key}."{path}"`: {name} is looked for in {kind}, which has no fields')
        slot = next((slot for slot in kind.type.slots if slot.name == name), None)
        if slot is None:
            known = ", ".join(slot.name for slot in kind.type.slots) or "none"
            raise NoSuchField(f'`{key}."{path}"`: {kind} has no field {name}; it has {known}')
        kind = slot.type
        attributes.append(slot.attribute + bracket + item)
        if bracket:
            if not isinstance(kind, field_types.Array):
                raise NoSuchField(
                    f'`{key}."{path}"`: {name} is {kind} and no list: expected it without `[{item}`'
                )
            kind = kind.element
    wanted = field_types.String if limit.one_of else (field_types.Int, field_types.Float)
    if not isinstance(kind, wanted):
        raise NoSuchField(
            f'`{key}."{path}"`: expected a {"text" if limit.one_of else "number"}, and it is {kind}'
        )
    texts, names = _BRACKETS.split(path), _BRACKETS.split(".".join(attributes))
    return list(map(_Part, texts[::2], names[::2], [*texts[1::2], None]))


def _at(parts: Sequence[_Part], leaf: _Check) -> _Check:
    """Compile a check of the fields at a path of a message.

    Args:
        parts: parts of the path, from :func:`_resolve`.
    """
    (text, attributes, item), *rest = parts
    inner = leaf
    if item:
        inner = _item(int(item), _at(rest, leaf))
    elif rest:
        is_leaf = rest == [_END]
        inner = leaf.of_list() if is_leaf and isinstance(leaf, _Range) else _each(_at(rest, leaf))
    if not attributes:  # The path ends with brackets.
        return inner
    attributes = attributes.removeprefix(".")
    get = attrgetter(attributes)
    names = attributes.split(".")

    def check(value: Any, where: str, now: float, changes: list[Change]) -> object:
        found = get(value)
        taken = inner(found, where + text, now, changes)
        return value if taken is found else _replaced(value, names, taken)

    return check


def _each(inner: _Check) -> _Check:
    def check(items: Any, where: str, now: float, changes: list[Change]) -> object:
        taken = [inner(item, f"{where}[{index}]", now, changes) for index, item in enumerate(items)]
        return items if all(map(is_, taken, items)) else taken

    return check


def _item(index: int, inner: _Check) -> _Check:
    """Compile a check of one item of a list; a shorter list passes."""

    def check(items: Any, where: str, now: float, changes: list[Change]) -> object:
        if index >= len(items):
            return items
        found = items[index]
        taken = inner(found, f"{where}[{index}]", now, changes)
        return items if taken is found else [*items[:index], taken, *items[index + 1 :]]

    return check


def _replaced(message: msgspec.Struct, names: Sequence[str], new: object) -> msgspec.Struct:
    """Return a copy of a message with another value at a path of attributes."""
    first, *rest = names
    return msgspec.structs.replace(
        message, **{first: _replaced(getattr(message, first), rest, new) if rest else new}
    )


def _one_of(limit: FieldLimit, key: str) -> _Check:
    allowed = frozenset(limit.one_of)
    expected = " or ".join(map(repr, limit.one_of))

    def check(value: Any, where: str, now: float, changes: list[Change]) -> object:
        if value not in allowed:
            raise GateRefused(f"{where}: expected {expected}, got {str(value)[:100]!r}", key)
        return value

    return check


class _Range:
    """Check of numbers; an instance is a `_Check`.

    Args:
        key: key of the setting, for error texts.
        motion: values last passed on; None: rates are not limited.
        neutrals: numbers of the stop message, for limits on rates.
    """

    __slots__ = ("_clamps", "_highest", "_key", "_lowest", "_motion", "_neutrals", "_otherwise", "_rate")

    def __init__(
        self, limit: FieldLimit, key: str, motion: Motion | None, neutrals: Mapping[str, float]
    ) -> None:
        self._lowest = -math.inf if limit.min is None else limit.min
        self._highest = math.inf if limit.max is None else limit.max
        self._clamps = limit.beyond == "clamp"
        self._key = key
        self._motion = motion
        self._neutrals = neutrals
        #: Value away from which the rate counts if the stop message has none; None: the last one.
        self._otherwise = 0.0 if limit.rate_from == "stop" else None
        self._rate = limit.rate

    def __call__(self, value: Any, where: str, now: float, changes: list[Change]) -> object:
        low, high = self._lowest, self._highest
        rate, motion = self._rate, self._motion
        if rate is not None and motion is not None:
            slowest, fastest = motion.bounds(where, self._neutrals.get(where, self._otherwise), rate, now)
            low, high = max(low, min(slowest, high)), min(high, max(fastest, low))
        taken = value
        if not low <= value <= high:
            taken = min(max(value, low), high)
            if isinstance(value, int):
                taken = math.ceil(taken) if value < low else math.floor(taken)
            if not self._clamps or not low <= taken <= high:
                raise GateRefused(f"{where}: expected {_range(low, high)}, got {value:g}", self._key)
            changes.append(
                Change(where, float(value), float(taken)) if len(changes) < _MAX_CHANGES else _UNNAMED
            )
        if rate is not None and motion is not None:
            motion.note(where, taken)
        return taken

    def of_list(self) -> _Check:
        """Return a check of the items of a list, which looks at each only if one is out of range."""
        each = _each(self)
        if self._rate is not None and self._motion is not None:
            return each
        lowest, highest = self._lowest, self._highest

        def check(items: Any, where: str, now: float, changes: list[Change]) -> object:
            # min() and max() miss NaN unless it comes first.
            if not len(items) or (
                lowest <= min(items) and max(items) <= highest and not any(map(math.isnan, items))
            ):
                return items
            return each(items, where, now, changes)

        return check


def _range(low: float, high: float) -> str:
    if low == -math.inf:
        return f"at most {high:g}"
    return f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"


def _values_at(parts: Sequence[_Part], value: Any, where: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of a message at a path, each with its path with indices."""
    (text, attributes, wanted), *rest = parts
    found = attrgetter(attributes.removeprefix("."))(value) if attributes else value
    if not rest:
        yield where + text, found
        return
    for index, item in enumerate(found):
        if not wanted or index == int(wanted):
            yield from _values_at(rest, item, f"{where}{text}[{index}]")


def _parts_of(type: MessageType, prefix: str = "") -> Iterator[tuple[attrgetter[Any], field_types.FieldType]]:
    """Yield getters and types of a message's fields; those of messages in it in their place."""
    for slot in type.slots:
        path = f"{prefix}{slot.attribute}"
        if isinstance(slot.type, field_types.Message):
            yield from _parts_of(slot.type.type, f"{path}.")
        else:
            yield attrgetter(path), slot.type


def _compile_float_sum(type: MessageType) -> Callable[[object], float] | None:
    """Compile a function that adds up all floats of a message; None if the type has none."""
    numbers: list[attrgetter[float]] = []
    lists: list[attrgetter[Iterable[float]]] = []
    messages: list[tuple[attrgetter[Iterable[object]], Callable[[object], float]]] = []
    for get, kind in _parts_of(type):
        match kind:
            case field_types.Float():
                numbers.append(get)
            case field_types.Array(element=field_types.Float()):
                lists.append(get)
            case field_types.Array(element=field_types.Message(inner)):
                inner_sum = _compile_float_sum(inner)
                if inner_sum is not None:
                    messages.append((get, inner_sum))

    def float_sum(message: object) -> float:
        total = 0.0
        for number in numbers:
            total += number(message)
        for items in lists:
            total += sum(items(message))
        for items_of, inner_sum in messages:
            total += sum(map(inner_sum, items_of(message)))
        return total

    return float_sum if numbers or lists or messages else None


def _colons_of(type: MessageType) -> int:
    """Return the number of colons in the JSON text of a message without texts and lists: one per member.

    A member may occur twice in the text of a client. Its readers may differ in which of the two counts, so
    that a robot might act on one and the check on the other. Then the text has more colons.
    """
    return bytes(Payload.from_value(type, {}).json()).count(b":")


def without_repeats(payload: Payload) -> Payload:
    """Return a message whose JSON text has every member once; a very large one is returned as it is."""
    text = payload.received_json
    if text is None or len(text) > MAX_APPROVED_BYTES or bytes(text).count(b":") == _colons_of(payload.type):
        return payload
    return Payload.from_value(payload.type, payload.value())


def has_lists(type: MessageType) -> bool:
    """Return True if messages of a type have lists or long texts, so that decoding one may take long."""
    return _compile_count(type) is not None or bool(type.long_fields)


def _compile_count(type: MessageType) -> Callable[[object, int], int] | None:
    """Compile a function that counts the items of a message's lists, octets apart; None without lists.

    The function stops counting beyond its second argument.
    """
    lists: list[attrgetter[Sequence[object]]] = []
    messages: list[tuple[attrgetter[Sequence[object]], Callable[[object, int], int] | None]] = []
    for get, kind in _parts_of(type):
        match kind:
            case field_types.Array(element=field_types.Message(inner)):
                messages.append((get, _compile_count(inner)))
            case field_types.Array(element=field_types.Int(code="b" | "B")):
                pass
            case field_types.Array():
                lists.append(get)

    def count(message: object, most: int) -> int:
        total = sum(len(items_of(message)) for items_of in lists)
        for items_of, inner in messages:
            items = items_of(message)
            total += len(items)
            if inner is None:
                continue
            for item in items:
                if total > most:
                    return total
                total += inner(item, most - total)
        return total

    return count if lists or messages else None


def _not_finite(message: object, type: MessageType, where: str) -> str:
    """Return the path of the first float that is not finite; empty if there is none."""
    for slot in type.slots:
        is_list = isinstance(slot.type, field_types.Array)
        kind = slot.type.element if isinstance(slot.type, field_types.Array) else slot.type
        if not isinstance(kind, field_types.Float | field_types.Message):
            continue
        value = getattr(message, slot.attribute)
        if is_list and isinstance(kind, field_types.Float) and all(map(math.isfinite, value)):
            continue
        for index, item in enumerate(value if is_list else (value,)):
            path = f"{where}{slot.name}[{index}]" if is_list else f"{where}{slot.name}"
            if isinstance(kind, field_types.Message):
                found = _not_finite(item, kind.type, f"{path}.")
                if found:
                    return found
            elif not math.isfinite(item):
                return path
    return ""
