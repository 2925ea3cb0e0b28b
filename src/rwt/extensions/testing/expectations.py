"""Expectations: wait for what the robot should receive, and report what it received instead."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import anyio

from rwt.extensions.testing.errors import BlockingWait
from rwt.extensions.testing.journal import OF_THE_SERVER, Journal, Kind, Received
from rwt.extensions.testing.matching import Matching, mismatch
from rwt_participant.messages import Message

#: Default timeout of an expectation, in seconds. Long, because a passing test rarely waits.
TIMEOUT_SECONDS = 5.0
#: Default duration, in seconds, of an expectation with ``count=0``, which always waits to the end.
QUIET_SECONDS = 0.2
#: Polling interval.
_POLL_SECONDS = 0.005
#: Limits of what a failed expectation shows.
_SHOWN_ENTRIES = 10
_SHOWN_CHARACTERS = 300

_CAME = {
    Kind.MESSAGE: ("a message on {}", "Published"),
    Kind.CALL: ("a call of {}", "Called"),
    Kind.GOAL: ("a goal of {}", "Sent goals"),
}
_UNTIL = {Kind.MESSAGE: "until_published", Kind.CALL: "until_called", Kind.GOAL: "until_goal"}


@dataclass(frozen=True, slots=True)
class Expectation:
    """Expected messages, calls or goals.

    Attributes:
        name: absolute name of the topic, service or action.
        count: exact number; None for at least one.
        within: seconds of real time, independent of the graph's clock.
    """

    kind: Kind
    name: str
    matching: Matching
    count: int | None = None
    within: float | None = None

    @property
    def seconds(self) -> float:
        """Timeout in seconds."""
        if self.within is not None:
            return self.within
        return QUIET_SECONDS if self.count == 0 else TIMEOUT_SECONDS

    def found(self, journal: Journal) -> list[Received]:
        """Return the matching entries."""
        return [e for e in journal.of(self.kind, self.name) if not mismatch(e.message, self.matching)]

    def is_decided(self, journal: Journal) -> bool:
        """True if waiting can no longer change the outcome."""
        return len(self.found(journal)) >= (self.count or 1)


def expect(journal: Journal, wanted: Expectation) -> list[Message]:
    """Block until the expectation is met.

    Raises:
        AssertionError: the expectation was not met; the text shows what came instead.
        BlockingWait: called from a coroutine.
        ScriptError: `matching` names an unknown field.
    """
    __tracebackhide__ = True
    refuse_on_an_event_loop(f"use `await robot.{_UNTIL[wanted.kind]}(...)`")
    for pause in _pauses(partial(wanted.is_decided, journal), wanted.seconds):
        journal.wait(journal.version, pause)
    return _judged(journal, wanted)


async def expect_soon(journal: Journal, wanted: Expectation) -> list[Message]:
    """Like :func:`expect`, for coroutines on asyncio or trio."""
    __tracebackhide__ = True
    for pause in _pauses(partial(wanted.is_decided, journal), wanted.seconds):
        await anyio.sleep(pause)
    return _judged(journal, wanted)


def block_until(is_met: Callable[[], bool], within: float, failure: Callable[[], str], instead: str) -> None:
    """Poll until a condition is met.

    Args:
        within: timeout in seconds of real time.
        failure: returns the text of the error.
        instead: what to call in a coroutine, for the error.

    Raises:
        AssertionError: timeout.
        BlockingWait: called from a coroutine.
    """
    __tracebackhide__ = True
    refuse_on_an_event_loop(instead)
    for pause in _pauses(is_met, within):
        time.sleep(pause)
    if not is_met():
        raise AssertionError(failure())


async def wait_until(is_met: Callable[[], bool], within: float, failure: Callable[[], str]) -> None:
    """Like :func:`block_until`, for coroutines."""
    __tracebackhide__ = True
    for pause in _pauses(is_met, within):
        await anyio.sleep(pause)
    if not is_met():
        raise AssertionError(failure())


def _pauses(is_met: Callable[[], bool], seconds: float) -> Iterator[float]:
    """Yield the pauses between polls, in seconds, until the condition is met or the time is over."""
    deadline = time.monotonic() + seconds
    while not is_met() and time.monotonic() < deadline:
        yield _POLL_SECONDS


def refuse_on_an_event_loop(instead: str) -> None:
    """Raise :exc:`BlockingWait` if an event loop runs on this thread: blocking would stop its client."""
    if on_an_event_loop():
        raise BlockingWait(f"cannot wait in a coroutine: this call would block its event loop; {instead}")


def on_an_event_loop() -> bool:
    """True if an asyncio or trio event loop runs on this thread."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        trio = sys.modules.get("trio")
        return trio is not None and bool(trio.lowlevel.in_trio_run())
    return True


def _judged(journal: Journal, wanted: Expectation) -> list[Message]:
    __tracebackhide__ = True
    found = wanted.found(journal)
    if len(found) == wanted.count or (wanted.count is None and found):
        return [entry.message for entry in found]
    raise AssertionError("\n".join(_complaint(journal, wanted, found)))


def _complaint(journal: Journal, wanted: Expectation, found: list[Received]) -> list[str]:
    one, verb = _CAME[wanted.kind]
    what = one.format(wanted.name)
    how_many = "at least 1" if wanted.count is None else f"exactly {wanted.count}"
    asked = "" if wanted.matching is None else f" matching {wanted.matching!r}"
    lines = [f"expected {what}{asked}, {how_many} within {wanted.seconds:g} s, and got {len(found)}"]
    came = journal.of(wanted.kind, wanted.name)
    if came:
        lines.append(f"{verb} on {wanted.name}:" if wanted.kind is Kind.MESSAGE else f"{verb}:")
        lines += _entries(came, wanted.matching)
    else:
        lines.append(_other_names(journal, wanted, verb))
    return lines


def _entries(came: Sequence[Received], matching: Matching) -> list[str]:
    lines = []
    if len(came) > _SHOWN_ENTRIES:
        lines.append(f"  … {len(came) - _SHOWN_ENTRIES} earlier ones")
    for entry in came[-_SHOWN_ENTRIES:]:
        text = entry.json
        shown = text if len(text) <= _SHOWN_CHARACTERS else text[:_SHOWN_CHARACTERS] + "…"
        lines.append(f"  {entry.node + ': ' if entry.node else ''}{shown}")
        why = mismatch(entry.message, matching)
        if why:
            lines.append(f"    {why}")
    return lines


def _other_names(journal: Journal, wanted: Expectation, verb: str) -> str:
    everything = journal.everything(wanted.kind)
    others = [f"{name} ({len(kept)})" for name, kept in everything.items() if name not in OF_THE_SERVER]
    return f"{verb} instead: {', '.join(others)}" if others else f"{verb} instead: nothing at all"
