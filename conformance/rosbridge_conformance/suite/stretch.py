"""Scaling of cases that measure time to the speed of the server.

The times in a timed case are for a server that responds at once. If responses take
longer, all times are scaled: waits and requested throttles. The tested behaviour,
their order and relation, stays the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from rosbridge_conformance.suite.case import (
    Case,
    Expect,
    ExpectAll,
    ExpectClose,
    ExpectNothing,
    Send,
    Step,
    Wait,
)
from rosbridge_conformance.suite.values import Json

AT_ONCE = 0.02
"""Maximum response time, or time for all messages of a case, without scaling, in seconds."""

MOST = 8.0
"""Maximum scaling factor."""

_THROTTLE = "throttle_rate"


def factor(slowest: float) -> float:
    """Return the scaling factor for a server whose slowest response took `slowest` seconds."""
    return min(MOST, max(1.0, slowest / AT_ONCE))


def stretched(case: Case, times: float) -> Case:
    """Return the case with all its times scaled."""
    if times == 1.0:
        return case
    return replace(case, steps=tuple(_step(step, times) for step in case.steps))


def _step(step: Step, times: float) -> Step:
    match step:
        case Wait() | ExpectNothing():
            return replace(step, seconds=step.seconds * times)
        case Expect() | ExpectAll() | ExpectClose() if step.within is not None:
            return replace(step, within=step.within * times)
        case Send():
            return replace(step, every=step.every * times, body=_throttled(step.body, times))
        case _:
            return step


def _throttled(body: Json, times: float) -> Json:
    """Return a subscription with a scaled throttle, in whole milliseconds; odd values stay odd."""
    if not isinstance(body, Mapping):
        return body
    rate = body.get(_THROTTLE)
    if isinstance(rate, bool) or not isinstance(rate, int):
        return body
    return {**body, _THROTTLE: round(rate * times)}
