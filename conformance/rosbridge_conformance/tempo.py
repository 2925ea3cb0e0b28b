"""Speed of the server under test, and the timeouts that follow from it."""

from __future__ import annotations

import asyncio
import itertools
import math
import os
from collections import deque
from dataclasses import dataclass, replace

from rosbridge_conformance.case_player import Played
from rosbridge_conformance.player import play
from rosbridge_conformance.suite.case import Case, Send, Settle, Step
from rosbridge_conformance.suite.stretch import MOST, factor, stretched
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.suite.values import Json
from rosbridge_conformance.wire.pace import Pace
from rosbridge_conformance.wire.wires import Dial

LEAST_TIMEOUT = 0.5
"""Minimum timeout of a response in seconds, unless the target's `timeout` is less."""

ANSWERS = 25.0
"""Ratio of the timeout to the slowest recent response to a probe."""

LEAST_SETTLE = 0.1
"""Minimum time until others see the effect of a client's action, in seconds."""

SPREADS = 8.0
"""Factor from a client's own measured time to the time allowed until others see its effect."""

_OF_LATE = 32
"""Number of responses to probes that are remembered."""

_MEASURED = 40
"""Number of responses in a measurement, for cases that measure time."""

_BURST = 100
"""Number of messages sent at once before a measurement."""

_WHOLE_SECOND = 1.0
"""Timeout of a response in a case that measures time, in seconds; scaled with the case."""

_SILENCE = 15.0
"""Time for a server to recover after a failed case, before the next one, in seconds."""

_EVERY = 0.02


@dataclass(frozen=True, slots=True)
class _Load:
    """Load of a server.

    Attributes:
        answer: slowest of some response times, in seconds.
        message: seconds for one of many messages that arrive at once.
    """

    answer: float
    message: float

    def times(self, case: Case) -> float:
        """Factor for the times of a case, relative to its file."""
        sent = sum(step.times for step in case.steps if isinstance(step, Send))
        return factor(max(self.answer, sent * self.message))


class Tempo:
    """Timeouts for one server, in proportion to its response times.

    `timeout` and `settle` of the target are the maximum. Cases that measure time are scaled:
    a busy server is not faulty. After a failed case, the next one waits until the server accepts
    a new connection, so that a server that hangs for a time fails only once.
    """

    _numbers = itertools.count(1)

    def __init__(self, target: Target, dial: Dial, pace: Pace, *, one_server: bool = True) -> None:
        """Start without measurements.

        Args:
            target: description of the server.
            dial: opens a connection to the server.
            pace: clock.
            one_server: True if all connections reach the same server.
        """
        self._target = target
        self._dial = dial
        self._pace = pace
        self._one_server = one_server
        self._answers: deque[float] = deque(maxlen=_OF_LATE)
        self._spread: float | None = None
        self._load: _Load | None = None
        self._silent = False
        self._failed_at = -math.inf
        self._asked_at = -math.inf
        self._answering = asyncio.Lock()
        self._measuring = asyncio.Lock()

    async def measure(self) -> None:
        """Measure the time until one client receives messages of another's new topic."""
        most = self._target.settle
        if most <= LEAST_SETTLE or not self._one_server:
            return
        topic: dict[str, Json] = {"topic": "/@/seen", "type": "std_msgs/Int32"}
        message: Json = {"op": "publish", "topic": "/@/seen", "msg": {"data": 0}}
        steps: tuple[Step, ...] = (
            Send("a", "json", {"op": "subscribe", **topic}),
            Settle(("a",)),
            Send("b", "json", {"op": "advertise", **topic}),
            Send("b", "json", message, times=round(most / _EVERY), every=_EVERY),
        )
        played = await self._ask("It is seen", steps, ("a", "b"))
        self._answers.extend(played.answers)
        began = next((line.at for line in played.transcript if line.client == "b"), 0.0)
        heard = (line.at for line in played.transcript if line.way == "<" and "/seen" in line.text)
        self._spread = next(heard, began + most) - began

    def limits(self) -> Target:
        """Return the target with the current timeouts."""
        if not self._answers:
            return self._target
        slowest = max(self._answers)
        seen = self._target.settle if self._spread is None else SPREADS * self._spread
        settle = min(self._target.settle, max(LEAST_SETTLE, seen, 2 * slowest))
        timeout = min(self._target.timeout, max(LEAST_TIMEOUT, ANSWERS * slowest, 2 * settle))
        return replace(self._target, timeout=timeout, settle=settle)

    async def play(self, case: Case, tag: str) -> Played:
        """Play a case with timeouts for this server."""
        if not case.timed:
            return await self._play(case, tag)
        async with self._measuring:  # Several cases may fail at once.
            if self._load is None:
                self._load = await self._measured()
        return await self._stretched(case, self._load.times(case), tag)

    async def again(self, case: Case, tag: str) -> Played:
        """Repeat a failed case with at least twice the time, and at least the times of the target.

        Discovery, as in DDS, may take longer than the responses suggest.
        """
        self._load = await self._measured()
        return await self._stretched(case, min(MOST, 2 * self._load.times(case)), tag, self._target)

    async def _stretched(self, case: Case, times: float, tag: str, least: Target | None = None) -> Played:
        limits = self.limits()
        longer = replace(
            limits,
            timeout=max(limits.timeout, _WHOLE_SECOND * times, least.timeout if least else 0.0),
            settle=max(
                limits.settle, min(self._target.settle, LEAST_SETTLE) * times, least.settle if least else 0.0
            ),
        )
        return await self._play(stretched(case, times), tag, longer)

    async def _play(self, case: Case, tag: str, target: Target | None = None) -> Played:
        async with self._answering:  # No case is played while the server recovers.
            if self._failed_at > self._asked_at and not self._silent:
                await self._wait_until_it_answers()
            target = target or self.limits()
        played = await play(case, target, self._dial, self._pace, tag)
        self._answers.extend(played.answers)
        if played.fault is None:
            self._silent = False
        elif self._one_server:
            self._failed_at = self._pace.now()
        return played

    async def _wait_until_it_answers(self) -> None:
        """Probe the server over a new connection, and wait once for its recovery."""
        self._asked_at = self._pace.now()
        patient = replace(self._target, timeout=_SILENCE)
        played = await self._ask("It answers again", (Settle(("a",)),) * 2, ("a",), patient)
        self._silent = played.fault is not None
        # The first response may include the recovery; the second one is typical.
        self._answers.extend(played.answers[1:])

    async def _measured(self) -> _Load:
        """Measure the current load of the server."""
        topic: dict[str, Json] = {"topic": "/@/beat", "type": "std_msgs/Int32"}
        steps: tuple[Step, ...] = (
            Send("a", "json", {"op": "advertise", **topic}),
            Send("a", "json", {"op": "publish", "topic": "/@/beat", "msg": {"data": 0}}, times=_BURST),
            *(Settle(("a",)),) * _MEASURED,
        )
        played = await self._ask("It answers", steps, ("a",))
        if played.fault is not None:
            return _Load(math.inf, math.inf)
        began = played.transcript[0].at
        burst = next(line.at for line in played.transcript if line.way == "<") - began
        return _Load(max(played.answers[1:]), burst / _BURST)

    async def _ask(
        self, title: str, steps: tuple[Step, ...], clients: tuple[str, ...], target: Target | None = None
    ) -> Played:
        case = Case("tempo", title, (), {}, "INFO", "CORE", steps, ("",) * len(steps), clients, probe=False)
        patient = replace(target or self._target, settle=0.0)
        tag = f"p{os.getpid():x}_{next(self._numbers)}"
        return await play(case, patient, self._dial, self._pace, tag)
