"""Waiting for what the robot should receive, and saying what came instead."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import anyio

from rwt.testing.errors import BlockingWait
from rwt.testing.journal import OF_THE_SERVER, Journal, Kind, Received
from rwt.testing.matching import Matching, mismatch
from rwt_participant.messages import Message

#: Seconds that an expectation waits when its caller says nothing: long, since a test that passes never waits.
PATIENCE = 5.0
#: The same for "nothing comes", which always waits to the end.
QUIET = 0.2
#: How often a coroutine looks, seconds.
_LOOK = 0.005
#: What a failed expectation shows of what came instead.
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
    """What should come.

    Attributes:
        kind: message, call or goal.
        name: absolute name of the topic, service or action.
        matching: what it should hold.
        count: how many, exactly; None for at least one.
        within: seconds of real time, whatever the graph's clock.
    """

    kind: Kind
    name: str
    matching: Matching
    count: int | None = None
    within: float | None = None

    @property
    def seconds(self) -> float:
        """How long to wait."""
        if self.within is not None:
            return self.within
        return QUIET if self.count == 0 else PATIENCE

    def found(self, journal: Journal) -> list[Received]:
        """What came and matches."""
        return [e for e in journal.of(self.kind, self.name) if not mismatch(e.message, self.matching)]

    def enough(self, found: list[Received]) -> bool:
        """Whether the outcome can no longer change by waiting."""
        if self.count == 0:
            return bool(found)
        return len(found) >= (1 if self.count is None else self.count)


def expect(journal: Journal, wanted: Expectation) -> list[Message]:
    """Block until what is wanted has come.

    Raises:
        AssertionError: it did not; the text shows what came instead.
        BlockingWait: called from a coroutine.
        ScriptError: `matching` names an unknown field.
    """
    __tracebackhide__ = True
    refuse_on_an_event_loop(f"use `await robot.{_UNTIL[wanted.kind]}(...)`")
    deadline = time.monotonic() + wanted.seconds
    while True:
        seen = journal.version
        found = wanted.found(journal)
        left = deadline - time.monotonic()
        if wanted.enough(found) or left <= 0:
            return _judged(journal, wanted, found)
        journal.wait(seen, left)


async def expect_soon(journal: Journal, wanted: Expectation) -> list[Message]:
    """As :func:`expect`, for coroutines on asyncio or trio."""
    __tracebackhide__ = True
    deadline = time.monotonic() + wanted.seconds
    while True:
        found = wanted.found(journal)
        if wanted.enough(found) or time.monotonic() >= deadline:
            return _judged(journal, wanted, found)
        await anyio.sleep(_LOOK)


def refuse_on_an_event_loop(instead: str) -> None:
    """Raise :exc:`BlockingWait` where blocking would stop the client that is waited for."""
    if on_an_event_loop():
        raise BlockingWait(
            f"this blocks, and a coroutine called it, whose event loop would stand still meanwhile: {instead}"
        )


def on_an_event_loop() -> bool:
    """Whether an event loop, of asyncio or trio, runs on this thread."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        trio = sys.modules.get("trio")
        return trio is not None and bool(trio.lowlevel.in_trio_run())
    return True


def _judged(journal: Journal, wanted: Expectation, found: list[Received]) -> list[Message]:
    __tracebackhide__ = True
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
