"""Cases that measure time, on the time of the server that is asked.

A case that is timed says its times for a server and a machine that answer at once. Where an answer takes
longer, all its times become longer alike: what it waits, and the throttle that it asks for. What it asks
about, the order of things and their relation, stays.
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
"""Seconds for an answer, or for all messages of a case, up to which its times are as its file says."""

MOST = 8.0
"""A server that is slower still is asked with times that are so many times longer."""

_THROTTLE = "throttle_rate"


def factor(slowest: float) -> float:
    """Return the factor for all times, for a server whose slowest answer took `slowest` seconds."""
    return min(MOST, max(1.0, slowest / AT_ONCE))


def stretched(case: Case, times: float) -> Case:
    """The case with all its times so many times longer."""
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
    """A subscription with a longer throttle; it is in whole milliseconds, of which odd values may matter."""
    if not isinstance(body, Mapping):
        return body
    rate = body.get(_THROTTLE)
    if isinstance(rate, bool) or not isinstance(rate, int):
        return body
    return {**body, _THROTTLE: round(rate * times)}
