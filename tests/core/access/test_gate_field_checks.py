"""Compiled field checks, compared with an oracle that reads the rule anew for each message."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from types import FrameType
from typing import Any, Final, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rwt.access.errors import GateRefused
from rwt.access.gate.fields import Clamped, FieldChecks, Motion
from rwt.access.gate.rules import Rule
from rwt.access.settings import FieldLimit, GateRule
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from tests.call_counts import count_calls
from tests.core.access.gated_robot import GatedRobot, drive
from tests.held import held

REGISTRY: Final = Registry(JAZZY)
REGISTRY.add_text("float64[] values\nfloat32 from\nint32 count\nstring name", "pkg/Joint")
REGISTRY.add_text(
    "float64 x\nint32 n\nuint8 small\nstring class\nJoint only\nJoint[] joints\nbool ok", "pkg/Arm"
)
ARM: Final = REGISTRY.message("pkg/Arm")
ARM_FIELDS: Final = tuple(slot.name for slot in ARM.slots)
JOINT_FIELDS: Final = tuple(slot.name for slot in REGISTRY.message("pkg/Joint").slots)

NUMBERS: Final = (
    "x", "n", "small", "only.from", "only.values[]", "joints[].from", "joints[].count", "joints[].values[]",
)  # fmt: skip
TEXTS: Final = ("class", "only.name", "joints[].name")


class Oracle:
    """Field rules as the documentation words them, for messages of plain data.

    Attributes:
        last: values that were last passed on, by path.
        passed_at: time of that message.
    """

    def __init__(self, rule: GateRule, stop: Mapping[str, Any]) -> None:
        self.rule = rule
        self.stop = stop
        self.last: dict[str, float] = {}
        self.passed_at = -math.inf

    def outcome(self, message: dict[str, Any], now: float) -> tuple[str, str]:
        """Return the JSON of the message to pass on and what was clamped, or "refused" and the reason.

        The message is changed in place.
        """
        if self.rule.finite:
            for where, value in _leaves(message, ""):
                if isinstance(value, float) and not math.isfinite(value):
                    return "refused", f"{where}: expected a finite number (gate.rules.it.finite)"
        changes: list[str] = []
        seen: dict[str, float] = {}
        try:
            for path, limit in self.rule.fields.items():
                for owner, key, where in _places(message, path.split("."), ""):
                    self._limit(limit, owner, key, where, now, changes, seen)
            text = bytes(Payload.from_value(ARM, message).json()).decode()
        except (_Beyond, InvalidMessage) as error:
            return "refused", f"{error} (gate.rules.it.fields)"
        self.passed_at = now
        self.last = seen or self.last
        named, more = changes[:8], len(changes) - 8
        return text, "; ".join([*named, f"{more} more"] if more > 0 else named)

    def _limit(
        self,
        limit: FieldLimit,
        owner: Any,
        key: Any,
        where: str,
        now: float,
        changes: list[str],
        seen: dict[str, float],
    ) -> None:
        value = owner[key]
        if limit.one_of:
            if value not in limit.one_of:
                raise _Beyond(f"{where}: expected {' or '.join(map(repr, limit.one_of))}, got {value!r}")
            return
        low, high = self._bounds(limit, where, now)
        owner[key] = taken = _within(value, low, high)
        if not low <= value <= high:
            if limit.beyond == "refuse" or not low <= taken <= high:
                raise _Beyond(f"{where}: expected {_words(low, high)}, got {value:g}")
            changes.append(f"{where}: {taken:g} in place of {value:g}")
        if limit.rate is not None:
            seen[where] = taken

    def _bounds(self, limit: FieldLimit, where: str, now: float) -> tuple[float, float]:
        low = -math.inf if limit.min is None else limit.min
        high = math.inf if limit.max is None else limit.max
        if limit.rate is None:
            return low, high
        silence = now - self.passed_at
        still = float(dict(_leaves(self.stop, "")).get(where, 0.0))
        last = self.last.get(where, still) if silence <= 0.5 else still
        step = limit.rate * min(silence, 0.1)
        return _within(min(last, still) - step, low, high), _within(max(last, still) + step, low, high)


class _Beyond(Exception):
    pass


def _within(value: float, low: float, high: float) -> float:
    if low <= value <= high:
        return value
    if isinstance(value, int):
        return math.ceil(low) if value < low else math.floor(high)
    return low if value < low else high if value > high else value


def _words(low: float, high: float) -> str:
    if low == -math.inf:
        return f"at most {high:g}"
    return f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"


def _leaves(value: Any, where: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _leaves(inner, f"{where}.{name}" if where else name)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{where}[{index}]")
    else:
        yield where, value


def _places(owner: Any, parts: list[str], where: str) -> Iterator[tuple[Any, Any, str]]:
    name, brackets, _ = parts[0].partition("[]")
    at = f"{where}.{name}" if where else name
    places: list[tuple[Any, Any, str]] = [(owner, name, at)]
    if brackets:
        places = [(owner[name], index, f"{at}[{index}]") for index in range(len(owner[name]))]
    for container, key, path in places:
        if parts[1:]:
            yield from _places(container[key], parts[1:], path)
        else:
            yield container, key, path


def _floats(width: Literal[32, 64]) -> st.SearchStrategy[float]:
    usual = st.floats(-4, 4, width=32)
    return st.one_of(usual, usual, usual, st.floats(width=width), st.sampled_from([0.0, -0.0, 3e38]))


def _is_limit(limit: Any) -> bool:
    low, high = limit["min"], limit["max"]
    return {low, high, limit["rate"]} != {None} and (low is None or high is None or low <= high)


BOUND = st.one_of(st.none(), st.integers(-3, 3), st.floats(-3, 3, width=16))


def _ordered(message: dict[str, Any]) -> dict[str, Any]:
    """Return a message with its fields in the order of its type: Hypothesis shuffles them."""
    joints = [{name: joint[name] for name in JOINT_FIELDS} for joint in (message["only"], *message["joints"])]
    return {name: {**message, "only": joints[0], "joints": joints[1:]}[name] for name in ARM_FIELDS}


JOINT = st.fixed_dictionaries(
    {
        "values": st.lists(_floats(64), max_size=3),
        "from": _floats(32),
        "count": st.integers(-5, 5),
        "name": st.sampled_from(["", "a", "b"]),
    }
)
MESSAGE = st.fixed_dictionaries(
    {
        "x": _floats(64),
        "n": st.integers(-5, 5),
        "small": st.integers(0, 5),
        "class": st.sampled_from(["a", "b", "null"]),
        "only": JOINT,
        "joints": st.lists(JOINT, max_size=2),
        "ok": st.booleans(),
    }
)
LIMIT: Final[st.SearchStrategy[Any]] = st.fixed_dictionaries(
    {
        "min": BOUND,
        "max": BOUND,
        "rate": st.one_of(st.none(), st.floats(0.5, 30, width=16)),
        "beyond": st.sampled_from(["refuse", "clamp", "clamp"]),
    }
).filter(_is_limit)
RULE = st.fixed_dictionaries(
    {
        "fields": st.tuples(
            st.dictionaries(st.sampled_from(NUMBERS), LIMIT, max_size=3),
            st.dictionaries(st.sampled_from(TEXTS), st.just({"one_of": ["a", "b"]}), max_size=1),
        ).map(lambda both: {**both[0], **both[1]}),
        "finite": st.booleans(),
    }
)
STOPS: Final[tuple[Mapping[str, Any], ...]] = (
    {},
    {"x": 0.5, "n": 1},
    {"only": {"from": -0.5}, "joints": [{"from": 0.5, "values": [0.25, 1.0], "count": 1}]},
)
GAPS: Final = (0.0, 0.02, 0.1, 0.3, 0.7)


@settings(max_examples=300, deadline=None)
@given(
    rule=RULE,
    stop=st.sampled_from(STOPS),
    messages=st.lists(st.tuples(MESSAGE, st.sampled_from(GAPS), st.booleans()), min_size=1, max_size=4),
)
def test_compiled_checks_equal_the_oracle(
    rule: dict[str, Any], stop: Mapping[str, Any], messages: list[tuple[dict[str, Any], float, bool]]
) -> None:
    limits = GateRule.model_validate({"topics": ["*"], **rule})
    oracle, motion = Oracle(limits, stop), Motion()
    checks = FieldChecks(Rule("it", limits), ARM, motion, Payload.from_value(ARM, dict(stop)).value())
    now = 0.0
    for message, gap, as_json in messages:
        now += gap
        message = _ordered(message)
        payload = Payload.from_value(ARM, message)
        if as_json:
            text = bytes(payload.json())
            payload = Payload.from_json(ARM, text)
            assert payload.is_passthrough
            message = _decoded(json.loads(text))
        assert _unsigned(_outcome(checks, motion, payload, now)) == _unsigned(oracle.outcome(message, now))


def _unsigned(outcome: tuple[str, str]) -> tuple[str, ...]:
    """Return the texts without the sign of zeros: which of two equal bounds wins is not specified."""
    return tuple(re.sub(r"-(0(?:\.0)?)(?![\d.eE])", r"\1", text) for text in outcome)


def _outcome(checks: FieldChecks, motion: Motion, payload: Payload, now: float) -> tuple[str, str]:
    try:
        passed, changes = checks.check(payload, now)
    except GateRefused as refused:
        motion.refused()
        return "refused", str(refused)
    motion.passed(now)
    return bytes(passed.json()).decode(), str(Clamped(changes))


def _decoded(value: Any) -> Any:
    """Return JSON with NaN for null."""
    if isinstance(value, dict):
        return {name: _decoded(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_decoded(inner) for inner in value]
    return math.nan if value is None else value


def test_a_message_costs_few_calls() -> None:
    lease = {"topics": ["/cmd_vel"], "lease": {"seconds": 5.0}, "stop": {}}
    robot = GatedRobot({"drive": {**lease, "fields": {"linear.x": {"min": -0.3, "max": 0.8}}}})
    client = robot.client()
    assert drive(client, 0.1) == ""
    calls: list[str] = []

    def profile(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and "/src/rwt/access/" in frame.f_code.co_filename:
            calls.append(frame.f_code.co_qualname)

    sys.setprofile(profile)
    try:
        drive(client, 0.2)
    finally:
        sys.setprofile(None)
    assert len(calls) <= 14, calls
    assert [speed for speed, _ in robot.take()] == [0.1, 0.2]


# -- lists -------------------------------------------------------------------------------------------------

ARRAY: Final = REGISTRY.message("std_msgs/Float64MultiArray")


def _array(items: str) -> Payload:
    layout = b'{"layout": {"dim": [], "data_offset": 0}, "data": [%s]}'
    return Payload.from_json(ARRAY, layout % items.encode())


def _checks(limit: Mapping[str, Any], motion: Motion | None = None, **rule: Any) -> FieldChecks:
    return FieldChecks(
        Rule("it", GateRule.model_validate({"topics": ["/it"], "fields": {"data[]": limit}, **rule})),
        ARRAY,
        motion,
    )


@pytest.mark.parametrize("beyond", ["refuse", "clamp"])
def test_a_large_message_is_rejected_before_it_is_decoded(beyond: str) -> None:
    payload = _array(",".join(["0.5"] * 100_000))
    with pytest.raises(
        GateRefused, match=r"a message of \d+ bytes: 320000 is the limit .*rules.it.largest_items"
    ):
        _checks({"max": 0.1, "beyond": beyond}).check(payload, 0.0)
    assert not payload.is_decoded
    with pytest.raises(GateRefused, match=r"data.0.: expected at most 0.1"):
        _checks({"max": 0.1}, largest_items=100_000).check(payload, 0.0)


def test_items_of_nested_lists_count_together() -> None:
    arm: dict[str, Any] = {"joints": [{"values": [0.5] * 99}] * 100}
    rule = {"topics": ["/it"], "fields": {"joints[].values[]": {"max": 1}}}
    checks = FieldChecks(Rule("it", GateRule.model_validate(rule)), ARM)
    assert checks.check(Payload.from_value(ARM, arm), 0.0)[1] == ()
    arm["joints"][-1] = {"values": [0.5] * 100}
    with pytest.raises(GateRefused, match="more than 10000 items in its lists"):
        checks.check(Payload.from_value(ARM, arm), 0.0)


def test_a_list_within_its_range_is_not_looked_at_item_by_item() -> None:
    checks = _checks({"min": -1, "max": 1})
    counts = []
    for size in (10, 10_000):
        payload = _array(",".join(["0.5"] * size))
        payload.value()
        counts.append(count_calls(partial(checks.check, payload, 0.0), ["call"]))
    assert counts[0] == counts[1]


@pytest.mark.parametrize("finite", [True, False])
@pytest.mark.parametrize("items", ["NaN, 0.5", "0.5, NaN", "0.5, 2.0", "-2.0, 0.5"])
def test_an_item_out_of_range_is_found_anywhere(items: str, finite: bool) -> None:
    with pytest.raises(GateRefused, match=r"data\[[01]\]"):
        _checks({"min": -1, "max": 1}, finite=finite).check(_array(items), 0.0)


def test_the_description_of_what_was_clamped_is_bounded() -> None:
    payload, changes = _checks({"max": 0.1, "beyond": "clamp"}).check(_array(",".join(["0.5"] * 9000)), 0.0)
    text = str(Clamped(changes))
    assert text.startswith("data[0]: 0.1 in place of 0.5; data[1]: ")
    assert text.endswith("data[7]: 0.1 in place of 0.5; 8992 more")
    value: Any = payload.value()
    assert set(value.data) == {0.1}


def test_values_of_the_items_of_longer_lists_are_not_kept() -> None:
    motion = Motion()
    checks = _checks({"rate": 100.0}, motion)
    for number, items in enumerate(("0.5," * 5000 + "0.5", "0.5", "0.5")):
        checks.check(_array(items), float(number))
        motion.passed(float(number))
    assert held(motion) < 100


@pytest.mark.parametrize(
    "twist",
    [
        '{"linear":{"x":9.0,"x":0.1,"y":0.0,"z":0.0},"angular":{"x":0.0,"y":0.0,"z":0.0}}',
        (
            '{"linear" :{"x":9.0,"y":0.0,"z":0.0},"linear" : {"x":0.1,"y":0.0,"z":0.0},'
            '"angular":{"x":0.0,"y":0.0,"z":0.0}}'
        ),
        '{"linear":{"\\u0078":9.0,"x":0.1,"y":0.0,"z":0.0},"angular":{"x":0.0,"y":0.0,"z":0.0}}',
    ],
)
def test_a_member_that_occurs_twice_is_sent_once_as_it_was_checked(twist: str) -> None:
    """Attack: readers of JSON differ in which of the two counts."""
    robot = GatedRobot({"drive": {"topics": ["/cmd_vel"], "fields": {"linear.x": {"max": 1}}}})
    sent: list[str] = []
    robot.graph.participant("/reader").subscribe(
        "/cmd_vel", lambda sample: sent.append(bytes(sample.payload.json()).decode())
    )
    client = robot.client()
    head = '{"op":"publish","topic":"/cmd_vel","type":"geometry_msgs/Twist","msg":'
    client.say_raw(f"{head}{twist}}}")
    assert not any("9.0" in each for each in sent)
    plain = '{"linear":{"x":0.1,"y":0.0,"z":0.0},"angular":{"x":0.0,"y":0.0,"z":0.0}}'
    client.say_raw(f"{head}{plain}}}")
    assert sent[-1] == plain
