"""Rules of the gate, and the messages that are held to them."""

from __future__ import annotations

import json
import math
from typing import Any

import msgspec
from pydantic import ValidationError

from rwt.access.errors import GateRefused
from rwt.access.gate.fields import FieldChecks, Motion, NoSuchField
from rwt.access.gate.rules import Rule
from rwt.access.settings import GateRule
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.errors import InvalidMessage, UnknownType
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry

_REGISTRY = Registry(JAZZY)


def gate(data: bytes) -> None:
    """A rule's limits as JSON, the name of a type, and messages of it, a line each."""
    limits, name, *messages = [*data.split(b"\n"), b""]
    try:
        rule = GateRule.model_validate({"topics": ["*"], "fields": msgspec.json.decode(limits)})
        type = _REGISTRY.message(name.decode())
    except (ValidationError, UnknownType, msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return
    motion = Motion()
    try:
        checks = FieldChecks(Rule("fuzzed", rule), type, motion)
    except NoSuchField as wrong:
        assert "gate.rules.fuzzed.fields" in str(wrong)
        return
    for now, message in enumerate(messages):
        try:
            payload = Payload.from_json(type, message, lambda: 0)
        except InvalidMessage:
            continue
        try:
            taken, _ = checks.check(payload, now / 20)
        except GateRefused as refused:
            motion.refused()
            assert "(gate.rules.fuzzed." in str(refused)
            continue
        motion.passed(now / 20)
        _hold(taken.value(), rule)
        if rule.fields:
            json.loads(bytes(taken.json()), object_pairs_hook=_members)


def _members(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Hold that no member occurs twice: readers differ in which of the two counts."""
    assert len(dict(pairs)) == len(pairs)
    return dict(pairs)


def _hold(value: Any, rule: GateRule) -> None:
    """Hold that what has passed is within the limits."""
    for path, limit in rule.fields.items():
        for number in _at(value, path.split(".")):
            if limit.one_of:
                assert number in limit.one_of
                continue
            assert math.isfinite(number)
            assert limit.min is None or number >= limit.min
            assert limit.max is None or number <= limit.max


def _at(value: Any, parts: list[str]) -> list[Any]:
    if not parts:
        return [value]
    name, brackets, _ = parts[0].partition("[]")
    inner = getattr(value, name)
    return [leaf for item in (inner if brackets else [inner]) for leaf in _at(item, parts[1:])]
