"""Patterns that describe a frame, and their matching.

A pattern is JSON. Plain values match equal values: numbers compare as numbers (`1` matches `1.0`), objects
need the same keys, lists the same items in order. An object with a key that begins with `$` is a
matcher.
"""

from __future__ import annotations

import base64
import itertools
import math
import re
import time
from collections.abc import Callable, Mapping, MutableMapping
from dataclasses import dataclass, field

from rosbridge_conformance.suite.values import (
    Json,
    NarrowFloat,
    NotJson,
    Tagged,
    Value,
    as_text,
    as_value,
    read_json,
    shorten,
)
from rosbridge_conformance.wire.cbor import same_float, typed_array

KINDS = ("anything", "string", "text", "number", "int", "bool", "object", "array", "null")
"""Kinds for `$any`; `text` is a non-empty string."""

MATCHERS: Mapping[str, tuple[str, ...]] = {
    "$any": (),
    "$bind": ("$is",),
    "$use": (),
    "$near": ("$within",),
    "$int": (),
    "$float": (),
    "$unordered": (),
    "$contains": (),
    "$each": (),
    "$regex": (),
    "$one_of": (),
    "$not": (),
    "$all": (),
    "$absent": (),
    "$optional": (),
    "$type_name": (),
    "$time": (),
    "$now": (),
    "$base64": (),
    "$bytes": (),
    "$tag": ("$values",),
    "$json": (),
    "$index": (),
}
"""Matchers, and the keys allowed beside them. `$open` is used in plain objects and not listed."""

_CLOCK_SLACK = 3600.0


def check_pattern(pattern: Json) -> str | None:
    """Describe the error in a pattern; None if it is valid."""
    if isinstance(pattern, list):
        return next((fault for item in pattern if (fault := check_pattern(item))), None)
    if not isinstance(pattern, dict):
        return None
    marks = [key for key in pattern if key.startswith("$") and key != "$open"]
    for mark in marks:
        if mark in MATCHERS:
            allowed = (mark, *MATCHERS[mark])
            strange = [key for key in pattern if key not in allowed]
            if strange:
                return f"`{strange[0]}` cannot stand beside the matcher `{mark}`"
            if mark == "$any" and pattern[mark] not in KINDS:
                return f"`$any` takes one of {', '.join(KINDS)}"
            break
    else:
        if marks:
            return f"unknown matcher `{marks[0]}`; known are {', '.join(MATCHERS)}"
    return next((fault for item in pattern.values() if (fault := check_pattern(item))), None)


@dataclass(slots=True)
class Context:
    """Context of a match, besides the frame.

    Attributes:
        names: values bound so far; a failed match binds nothing.
        ros: ROS generation of the target, which determines the form of times.
        three_part: True if the target reports type names in three parts.
        now: time of the target, seconds since 1970.
    """

    names: MutableMapping[str, Value] = field(default_factory=dict)
    ros: int = 2
    three_part: bool = True
    now: Callable[[], float] = time.time


@dataclass(frozen=True, slots=True)
class Difference:
    """Place where a frame does not match its pattern.

    Attributes:
        path: path such as `msg.header.stamp`.
        expected: expected value in words or JSON.
        got: actual value in JSON, or "nothing".
    """

    path: str
    expected: str
    got: str

    def __str__(self) -> str:
        where = f"at {self.path}: " if self.path else ""
        return f"{where}expected {shorten(self.expected)}, got {shorten(self.got)}"


@dataclass(frozen=True, slots=True)
class Match:
    """Match of a frame; `extra` are keys of the frame itself that the pattern does not have."""

    extra: tuple[str, ...] = ()


def match_frame(pattern: Json, frame: Value, context: Context) -> Match | Difference:
    """Match a whole frame; extra keys at top level are reported, nested ones are a difference."""
    trial = Context(dict(context.names), context.ros, context.three_part, context.now)
    extra: tuple[str, ...] = ()
    if isinstance(pattern, dict) and isinstance(frame, dict) and not _is_matcher(pattern):
        if "$open" not in pattern:
            extra = tuple(key for key in frame if key not in pattern)
        pattern = {**pattern, "$open": True}
    difference = _differ(pattern, frame, "", trial)
    if difference is not None:
        return difference
    context.names.update(trial.names)
    return Match(extra)


def fill(pattern: Json, context: Context, index: int = 0) -> Json:
    """Return the frame to send: `$use` replaced by the bound value, `$index` by the repetition's number."""
    if isinstance(pattern, list):
        return [fill(item, context, index) for item in pattern]
    if not isinstance(pattern, dict):
        return pattern
    if set(pattern) == {"$use"}:
        return _plain(context.names[str(pattern["$use"])])
    if set(pattern) == {"$index"}:
        return index
    return {key: fill(item, context, index) for key, item in pattern.items()}


def _plain(value: Value) -> Json:
    if isinstance(value, bytes | Tagged):
        return as_text(value)
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return value


def _is_matcher(pattern: dict[str, Json]) -> bool:
    return any(key in MATCHERS for key in pattern)


def _differ(pattern: Json, value: Value, path: str, context: Context) -> Difference | None:
    """Return the first difference, or None."""
    if isinstance(pattern, dict):
        if _is_matcher(pattern):
            return _differ_matcher(pattern, value, path, context)
        return _differ_object(pattern, value, path, context)
    if isinstance(pattern, list):
        return _differ_list(pattern, value, path, context)
    if _same_scalar(pattern, value):
        return None
    return Difference(path, as_text(as_value(pattern)), as_text(value))


def _same_scalar(pattern: Json, value: Value) -> bool:
    if isinstance(pattern, bool) or isinstance(value, bool) or pattern is None or value is None:
        return pattern is value
    if isinstance(pattern, int | float) and isinstance(value, int | float):
        return pattern == value
    return isinstance(pattern, str) and isinstance(value, str) and pattern == value


def _differ_object(pattern: dict[str, Json], value: Value, path: str, context: Context) -> Difference | None:
    if not isinstance(value, dict):
        return Difference(path, "an object", as_text(value))
    for key, wanted in pattern.items():
        if key == "$open":
            continue
        place = f"{path}.{key}" if path else key
        if isinstance(wanted, dict) and "$absent" in wanted:
            if key in value:
                return Difference(place, "no such key", as_text(value[key]))
        elif key not in value:
            if isinstance(wanted, dict) and "$optional" in wanted:
                continue
            return Difference(place, _words(wanted), "nothing")
        elif (found := _differ(wanted, value[key], place, context)) is not None:
            return found
    if "$open" not in pattern:
        for key in value:
            if key not in pattern:
                return Difference(f"{path}.{key}" if path else key, "no such key", as_text(value[key]))
    return None


def _differ_list(pattern: list[Json], value: Value, path: str, context: Context) -> Difference | None:
    if not isinstance(value, list):
        return Difference(path, "a list", as_text(value))
    if len(pattern) != len(value):
        return Difference(path, f"{len(pattern)} items, {_words(pattern)}", as_text(value))
    for number, (wanted, item) in enumerate(zip(pattern, value, strict=True)):
        found = _differ(wanted, item, f"{path}[{number}]", context)
        if found is not None:
            return found
    return None


def _differ_matcher(pattern: dict[str, Json], value: Value, path: str, context: Context) -> Difference | None:
    mark = next(key for key in pattern if key in MATCHERS)
    operand = pattern[mark]
    match mark:
        case "$bind":
            found = _differ(pattern["$is"], value, path, context) if "$is" in pattern else None
            if found is None:
                context.names[str(operand)] = value
            return found
        case "$optional":
            return _differ(operand, value, path, context)
        case "$all":
            wanted = operand if isinstance(operand, list) else [operand]
            return next((d for item in wanted if (d := _differ(item, value, path, context))), None)
        case "$each":
            if not isinstance(value, list):
                return Difference(path, "a list", as_text(value))
            places = ((f"{path}[{number}]", item) for number, item in enumerate(value))
            return next((d for place, item in places if (d := _differ(operand, item, place, context))), None)
        case "$json":
            return _differ_json_text(operand, value, path, context)
        case "$tag":
            return _differ_tagged(pattern, value, path, context)
    if _TESTS[mark](pattern, operand, value, context):
        return None
    return Difference(path, _words(pattern), as_text(value))


def _differ_json_text(operand: Json, value: Value, path: str, context: Context) -> Difference | None:
    if not isinstance(value, str):
        return Difference(path, "JSON in a string", as_text(value))
    try:
        inner = read_json(value)
    except NotJson as error:
        return Difference(path, f"JSON in a string ({error})", as_text(value))
    return _differ(operand, as_value(inner), f"{path}(JSON)", context)


def _differ_tagged(pattern: dict[str, Json], value: Value, path: str, context: Context) -> Difference | None:
    if not isinstance(value, Tagged) or value.tag != pattern["$tag"]:
        return Difference(path, f"CBOR tag {pattern['$tag']}", as_text(value))
    numbers = typed_array(value)
    if numbers is None:
        return Difference(path, f"a typed array of tag {value.tag} (RFC 8746)", as_text(value))
    return _differ(pattern.get("$values", {"$any": "array"}), numbers, f"{path}(tag {value.tag})", context)


def _words(pattern: Json) -> str:
    """Return a pattern as text for people."""
    if not isinstance(pattern, dict) or not _is_matcher(pattern):
        return as_text(as_value(pattern))
    if "$any" in pattern:
        return {"anything": "anything", "text": "a string that is not empty", "int": "an integer"}.get(
            str(pattern["$any"]), f"any {pattern['$any']}"
        )
    if "$near" in pattern:
        return f"{pattern['$near']} ± {pattern.get('$within', 1e-6)}"
    return as_text(as_value(pattern))


def _is_kind(kind: str, value: Value) -> bool:
    match kind:
        case "anything":
            return True
        case "string":
            return isinstance(value, str)
        case "text":
            return isinstance(value, str) and value != ""
        case "number":
            return isinstance(value, int | float) and not isinstance(value, bool)
        case "int":
            return isinstance(value, int) and not isinstance(value, bool)
        case "bool":
            return isinstance(value, bool)
        case "object":
            return isinstance(value, dict)
        case "array":
            return isinstance(value, list)
    return value is None


def _is_near(pattern: dict[str, Json], operand: Json, value: Value, _: Context) -> bool:
    slack = pattern.get("$within", 1e-6)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    if isinstance(operand, dict | list | str | None) or isinstance(slack, dict | list | str | None):
        return False
    return abs(value - operand) <= slack


def _is_float(operand: Json, value: Value) -> bool:
    """Match a float of 64 bits; the operand may be "NaN", "Infinity" or "-Infinity" (CBR-05)."""
    if not isinstance(value, float) or isinstance(value, NarrowFloat):
        return False
    return isinstance(operand, str | int | float) and same_float(value, float(operand))


def _is_permutation(pattern: dict[str, Json], operand: Json, value: Value, context: Context) -> bool:
    if not isinstance(operand, list) or not isinstance(value, list) or len(operand) != len(value):
        return False
    if len(operand) > 7:
        raise ValueError("$unordered takes at most seven items")
    return any(
        all(_differ(wanted, item, "", context) is None for wanted, item in zip(operand, order, strict=True))
        for order in itertools.permutations(value)
    )


def _contains(pattern: dict[str, Json], operand: Json, value: Value, context: Context) -> bool:
    if not isinstance(value, list) or not isinstance(operand, list):
        return False
    return all(any(_differ(wanted, item, "", context) is None for item in value) for wanted in operand)


def _is_type_name(operand: Json, value: Value, context: Context) -> bool:
    """Match a type name `pkg/Name` in the target's form; `pkg/srv/Name`, `pkg/action/Name` give the kind."""
    parts = str(operand).split("/")
    package, name = parts[0], parts[-1]
    kind = parts[1] if len(parts) == 3 else "msg"
    return value == (f"{package}/{kind}/{name}" if context.three_part else f"{package}/{name}")


def _is_time(operand: Json, value: Value, context: Context) -> bool:
    """Match `[seconds, nanoseconds]` in the form of the target's ROS generation (JSN-05)."""
    keys = ("secs", "nsecs") if context.ros == 1 else ("sec", "nanosec")
    if not isinstance(operand, list) or not isinstance(value, dict) or set(value) != set(keys):
        return False
    return all(_is_kind("int", value[key]) for key in keys) and [value[key] for key in keys] == operand


def _is_now(_: Json, value: Value, context: Context) -> bool:
    """Match a time near now; servers with their own clock may differ by an hour."""
    keys = ("secs", "nsecs") if context.ros == 1 else ("sec", "nanosec")
    if not isinstance(value, dict) or set(value) != set(keys):
        return False
    seconds, rest = value[keys[0]], value[keys[1]]
    if not isinstance(seconds, int) or not isinstance(rest, int) or not 0 <= rest < 1_000_000_000:
        return False
    return abs(seconds - context.now()) < _CLOCK_SLACK


def _is_base64(operand: Json, value: Value) -> bool:
    """Match standard padded base64 of bytes given in hexadecimal (JSN-01)."""
    return value == base64.b64encode(bytes.fromhex(str(operand))).decode()


def _is_regex(operand: Json, value: Value) -> bool:
    return isinstance(value, str) and re.search(str(operand), value) is not None


_TESTS: Mapping[str, Callable[[dict[str, Json], Json, Value, Context], bool]] = {
    "$any": lambda _p, operand, value, _c: _is_kind(str(operand), value),
    "$use": lambda _p, operand, value, context: _same(context.names.get(str(operand)), value),
    "$near": _is_near,
    "$int": lambda _p, operand, value, _c: _is_kind("int", value) and value == operand,
    "$float": lambda _p, operand, value, _c: _is_float(operand, value),
    "$unordered": _is_permutation,
    "$contains": _contains,
    "$regex": lambda _p, operand, value, _c: _is_regex(operand, value),
    "$one_of": lambda _p, operand, value, context: (
        isinstance(operand, list) and any(_differ(item, value, "", context) is None for item in operand)
    ),
    "$not": lambda _p, operand, value, context: _differ(operand, value, "", context) is not None,
    "$absent": lambda _p, _o, _v, _c: False,
    "$type_name": lambda _p, operand, value, context: _is_type_name(operand, value, context),
    "$time": lambda _p, operand, value, context: _is_time(operand, value, context),
    "$now": lambda _p, operand, value, context: _is_now(operand, value, context),
    "$base64": lambda _p, operand, value, _c: _is_base64(operand, value),
    "$bytes": lambda _p, operand, value, _c: value == bytes.fromhex(str(operand)),
    "$index": lambda _p, operand, value, _c: value == operand,
}


def _same(left: Value, right: Value) -> bool:
    """Match equal values, where 1, true and 1.0 differ: ids are returned unchanged (ENV-02)."""
    if isinstance(left, float) and isinstance(right, float):
        return left == right or (math.isnan(left) and math.isnan(right))
    return type(left) is type(right) and left == right
