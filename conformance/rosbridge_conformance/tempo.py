"""Speed of the server under test, and the timeouts that follow from it."""

from __future__ import annotations

import asyncio
import itertools
import math
import os
from collections import deque
from dataclasses import dataclass, replace

from rosbridge_conformance.player import Played, play
from rosbridge_conformance.suite.case import Case, Send, Settle, Step
from rosbridge_conformance.suite.stretch import MOST, factor, stretched
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.suite.values import Json
from rosbridge_conformance.wire.pace import Pace
from rosbridge_conformance.wire.wires import Dial

LEAST_TIMEOUT = 0.5
"""Seconds for an answer, however fast the server is, unless the target's own `timeout` is less."""

ANSWERS = 25.0
"""An answer is waited for so many times as long as the slowest sign of life took of late."""

LEAST_SETTLE = 0.1
"""Seconds until what one client did counts as seen by others, at the least."""

SPREADS = 8.0
"""Factor from a client's own measured time to the time allowed until others see its effect."""

_OF_LATE = 32
"""Number of signs of life that are remembered."""

_MEASURED = 40
"""Number of answers in a measurement, for cases that measure time."""

_BURST = 100
"""Number of messages sent at once before it."""

_WHOLE_SECOND = 1.0
"""Seconds for an answer in a case that measures time; they are stretched with it."""

_SILENCE = 15.0
"""Seconds in which a server has to answer again after a case that failed, before the next is asked."""

_EVERY = 0.02


@dataclass(frozen=True, slots=True)
class _Load:
    """Load of a server.

    Attributes:
        answer: seconds of the slowest of some answers.
        message: seconds for one of many messages that arrive at once.
    """

    answer: float
    message: float

    def times(self, case: Case) -> float:
        """Factor for the times of a case, relative to its file."""
        sent = sum(step.times for step in case.steps if isinstance(step, Send))
        return factor(max(self.answer, sent * self.message))


class Tempo:
    """The time of one server: answers are waited for in proportion to what its own take.

    `timeout` and `settle` of the target are the most that is waited. Cases that measure time are stretched:
    a server that is busy is no faulty one. After a case that failed, the next waits until the server answers
    a new connection, so that who hangs for a while fails once for it.
    """

    _numbers = itertools.count(1)

    def __init__(self, target: Target, dial: Dial, pace: Pace, *, one_server: bool = True) -> None:
        """Know nothing of the server yet.

        Args:
            target: what is known about it.
            dial: opens a connection to it.
            pace: the clock to go by.
            one_server: whether all connections reach the same server.
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
        """Look how long it takes until one client hears what another begins to publish."""
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
        """The target with the times that are waited for it now."""
        if not self._answers:
            return self._target
        slowest = max(self._answers)
        seen = self._target.settle if self._spread is None else SPREADS * self._spread
        settle = min(self._target.settle, max(LEAST_SETTLE, seen, 2 * slowest))
        timeout = min(self._target.timeout, max(LEAST_TIMEOUT, ANSWERS * slowest, 2 * settle))
        return replace(self._target, timeout=timeout, settle=settle)

    async def play(self, case: Case, tag: str) -> Played:
        """Play a case in the time that the server needs."""
        if not case.timed:
            return await self._play(case, tag)
        async with self._measuring:  # Several may come at once.
            if self._load is None:
                self._load = await self._measured()
        return await self._stretched(case, self._load.times(case), tag)

    async def again(self, case: Case, tag: str) -> Played:
        """Play a case that has failed, with at least twice the time, and that of the target."""
        self._load = await self._measured()
        return await self._stretched(case, min(MOST, 2 * self._load.times(case)), tag, self._target.timeout)

    async def _stretched(self, case: Case, times: float, tag: str, least: float = 0.0) -> Played:
        limits = self.limits()
        longer = replace(
            limits,
            timeout=max(limits.timeout, _WHOLE_SECOND * times, least),
            settle=max(limits.settle, min(self._target.settle, LEAST_SETTLE) * times),
        )
        return await self._play(stretched(case, times), tag, longer)

    async def _play(self, case: Case, tag: str, target: Target | None = None) -> Played:
        async with self._answering:  # Nothing is asked while the server is waited for.
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
        """Ask a new connection for a sign of life; one that gives none is waited for once."""
        self._asked_at = self._pace.now()
        patient = replace(self._target, timeout=_SILENCE)
        played = await self._ask("It answers again", (Settle(("a",)),) * 2, ("a",), patient)
        self._silent = played.fault is not None
        # The first may have waited for the server to come back; the next is what an answer takes now.
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
