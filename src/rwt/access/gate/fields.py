"""Limits of the fields of messages: ranges, rates, texts, and numbers that are none."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

import msgspec

from rwt.access.errors import GateRefused
from rwt_interfaces import field_types
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload

if TYPE_CHECKING:
    from rwt.access.gate.rules import Rule
    from rwt.access.settings.gate import FieldLimit
    from rwt_interfaces.structs import MessageType

#: The longest time between two messages, in seconds, that counts for a rate: after a pause nothing may jump.
_LONGEST_STEP: Final = 0.1

#: Silence, in seconds, after which the robot is taken to have stopped by itself.
_STANDS_AFTER: Final = 0.5

_find_null: Final = re.compile(rb"null").search

Change = Callable[[object, str], object]
"""Checks the value of one field, whose way is given, and returns the one to take in its place."""


class NoSuchField(Exception):
    """A rule limits a field that the type has not, or that holds something else. The text says which."""


class Motion:
    """What a topic was last told, for limits of rates.

    Attributes:
        at: when, in seconds of a steady clock.
    """

    __slots__ = ("_next", "_values", "at")

    def __init__(self) -> None:
        self.at = -math.inf
        self._values: dict[str, float] = {}
        self._next: dict[str, float] = {}

    def bounds(self, where: str, neutral: float, rate: float, now: float) -> tuple[float, float]:
        """Between which numbers a field may be now.

        Towards the neutral one it may jump; so braking is never limited.
        """
        silence = now - self.at
        last = neutral if silence > _STANDS_AFTER else self._values.get(where, neutral)
        most = rate * min(silence, _LONGEST_STEP)
        return min(last, neutral) - most, max(last, neutral) + most

    def note(self, where: str, value: float) -> None:
        """Remember a number of the message at hand."""
        self._next[where] = value

    def passed(self, now: float) -> None:
        """The message at hand has gone to the robot."""
        self.at = now
        if self._next:
            self._values.update(self._next)
            self._next.clear()

    def refused(self) -> None:
        """The message at hand has not gone to the robot."""
        self._next.clear()

    def reset(self) -> None:
        """The robot was told to stand."""
        self.at = -math.inf
        self._values.clear()
        self._next.clear()


class FieldChecks:
    """The limits of one rule, for messages of one type.

    Args:
        rule: see above.
        type: see above.
        neutral: the stop message, away from which rates count; None: zeros.

    Raises:
        NoSuchField: the type has no such field, or a number is limited like a text.
    """

    __slots__ = ("_finite", "_limits", "_neutral", "_rule", "_type")

    def __init__(self, rule: Rule, type: MessageType, neutral: msgspec.Struct | None = None) -> None:
        settings = rule.settings
        self._rule = rule
        self._type = type
        self._neutral = neutral
        self._finite = _float_fields(type) if settings.finite else ()
        self._limits = tuple(
            (_compiled(type, path, limit, f"{rule.key}.fields"), limit)
            for path, limit in settings.fields.items()
        )

    @property
    def is_empty(self) -> bool:
        """Whether every message of the type passes."""
        return not (self._finite or self._limits or self._rule.settings.largest_bytes)

    def check(self, payload: Payload, motion: Motion | None, now: float) -> tuple[Payload, str]:
        """The message to hand on, and what was brought within its limits, in words; empty: nothing.

        Args:
            payload: of the type.
            motion: of the topic; None for requests and goals.
            now: seconds of a steady clock.

        Raises:
            GateRefused: it is beyond a limit; the text names the field and the rule.
        """
        key = self._rule.key
        largest = self._rule.settings.largest_bytes
        if largest and payload.size > largest:
            raise GateRefused(
                f"a message of {payload.size} bytes: {largest} is the limit", f"{key}.largest_bytes"
            )
        # JSON that is passed on as received has no NaN and no infinity, but it may have `null`, which is NaN.
        is_finite = not self._finite or (payload.is_passthrough and not _find_null(payload.json()))
        if not self._limits and is_finite:
            return payload, ""
        given = payload.value()
        value: object = given
        where = _not_finite(given, self._finite, "")
        if where:
            raise GateRefused(f"{where}: expected a finite number", f"{key}.finite")
        changes: list[str] = []
        for steps, limit in self._limits:
            change = self._change(limit, motion, now, changes)
            value = _applied(value, steps, "", change)
        if value is given:
            return payload, ""
        try:
            return Payload.from_value(self._type, value), "; ".join(changes)
        except InvalidMessage as error:
            # The limit itself is beyond what the field holds.
            raise GateRefused(str(error), f"{key}.fields") from None

    def _change(self, limit: FieldLimit, motion: Motion | None, now: float, changes: list[str]) -> Change:
        def text(value: object, where: str) -> object:
            if value not in limit.one_of:
                raise GateRefused(
                    f"{where}: expected {' or '.join(map(repr, limit.one_of))}, got {str(value)[:100]!r}",
                    f"{self._rule.key}.fields",
                )
            return value

        def number(value: object, where: str) -> object:
            assert isinstance(value, int | float)  # The type's field is a number.
            low = -math.inf if limit.min is None else limit.min
            high = math.inf if limit.max is None else limit.max
            if limit.rate is not None and motion is not None:
                slowest, fastest = motion.bounds(where, self._neutral_at(where), limit.rate, now)
                low, high = max(low, min(slowest, high)), min(high, max(fastest, low))
            taken: float = value
            if not low <= value <= high:
                within = min(max(value, low), high)
                if isinstance(value, int):
                    within = math.ceil(within) if value < low else math.floor(within)
                if limit.beyond == "refuse" or not low <= within <= high:
                    raise GateRefused(
                        f"{where}: expected {_range(low, high)}, got {value:g}", f"{self._rule.key}.fields"
                    )
                taken = within
                changes.append(f"{where}: {taken:g} in place of {value:g}")
            if limit.rate is not None and motion is not None:
                motion.note(where, taken)
            return value if taken == value else taken

        return text if limit.one_of else number

    def _neutral_at(self, where: str) -> float:
        value: object = self._neutral
        for part in where.split("."):
            name, _, index = part.partition("[")
            value = getattr(value, _attribute(name), None)
            if index:
                place = int(index[:-1])
                value = value[place] if isinstance(value, Sequence) and place < len(value) else None
        return float(value) if isinstance(value, int | float) else 0.0


def _range(low: float, high: float) -> str:
    if low == -math.inf:
        return f"at most {high:g}"
    return f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"


def _attribute(name: str) -> str:
    from rwt_interfaces.structs import python_name

    return python_name(name)


Steps = tuple[str, ...]
"""The parts of a way: names of fields, and `[]` for every item of a list."""


def _compiled(type: MessageType, path: str, limit: FieldLimit, key: str) -> Steps:
    """The steps of a path, whose fields the type has."""
    steps: list[str] = []
    kind: field_types.FieldType = field_types.Message(type)
    for part in path.split("."):
        name, brackets, _ = part.partition("[]")
        if not isinstance(kind, field_types.Message):
            raise NoSuchField(f'`{key}."{path}"`: {name} is looked for in {kind}, which has no fields')
        slot = next((slot for slot in kind.type.slots if slot.name == name), None)
        if slot is None:
            known = ", ".join(slot.name for slot in kind.type.slots) or "none"
            raise NoSuchField(f'`{key}."{path}"`: {kind} has no field {name}; it has {known}')
        kind = slot.type
        steps.append(name)
        if brackets:
            if not isinstance(kind, field_types.Array):
                raise NoSuchField(f'`{key}."{path}"`: {name} is {kind} and no list: expected it without `[]`')
            kind = kind.element
            steps.append("[]")
    wanted = field_types.String if limit.one_of else (field_types.Int, field_types.Float)
    if not isinstance(kind, wanted):
        raise NoSuchField(
            f'`{key}."{path}"`: expected a {"text" if limit.one_of else "number"}, and it is {kind}'
        )
    return tuple(steps)


def _applied(value: object, steps: Steps, where: str, change: Change) -> object:
    """The value with one of its fields changed; itself where nothing is."""
    if not steps:
        return change(value, where)
    step, rest = steps[0], steps[1:]
    if step == "[]":
        assert isinstance(value, Sequence)  # Only lists have this step.
        taken = [_applied(item, rest, f"{where}[{index}]", change) for index, item in enumerate(value)]
        return value if all(map(_is, taken, value)) else taken
    assert isinstance(value, msgspec.Struct)  # Only messages have fields.
    name = _attribute(step)
    inner = getattr(value, name)
    changed = _applied(inner, rest, f"{where}.{step}" if where else step, change)
    return value if changed is inner else msgspec.structs.replace(value, **{name: changed})


def _is(one: object, other: object) -> bool:
    return one is other


FloatFields = tuple[tuple[str, bool, "FloatFields | None"], ...]
"""The fields of a type in which floats are: the name, whether it is a list, and those of the message in it;
None where it is a float itself."""


def _float_fields(type: MessageType) -> FloatFields:
    found: list[tuple[str, bool, FloatFields | None]] = []
    for slot in type.slots:
        is_list = isinstance(slot.type, field_types.Array)
        kind = slot.type.element if isinstance(slot.type, field_types.Array) else slot.type
        if isinstance(kind, field_types.Float):
            found.append((slot.name, is_list, None))
        elif isinstance(kind, field_types.Message):
            within = _float_fields(kind.type)
            if within:
                found.append((slot.name, is_list, within))
    return tuple(found)


def _not_finite(value: object, fields: FloatFields, where: str) -> str:
    """The way to the first float that is none or infinite; empty where all are finite."""
    for name, is_list, within in fields:
        inner = getattr(value, _attribute(name))
        path = f"{where}.{name}" if where else name
        if not is_list:
            if within is None:
                if not math.isfinite(inner):
                    return path
            elif found := _not_finite(inner, within, path):
                return found
        elif within is None:
            # A sum is a quick proof; where it overflows, each number is looked at.
            if not math.isfinite(sum(inner)):
                for index, item in enumerate(inner):
                    if not math.isfinite(item):
                        return f"{path}[{index}]"
        else:
            for index, item in enumerate(inner):
                if found := _not_finite(item, within, f"{path}[{index}]"):
                    return found
    return ""
