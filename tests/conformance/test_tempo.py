"""Timeouts of the suite, in proportion to the latency of the server."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from rosbridge_conformance.runner import Conditions, Run, run_cases, select
from rosbridge_conformance.suite.case import Case
from rosbridge_conformance.suite.loading import load_cases
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.tempo import LEAST_TIMEOUT, Tempo
from rosbridge_conformance.wire.wires import Wire
from tests.conformance.memory_server import MemoryServer, MemoryWire, VirtualPace, memory_server

SLOW = Target(name="slow", profiles=("CORE", "ROSAPI"), settle=1.5, timeout=4.0, probe="get_time")
"""Settings of a target for a server with slow discovery."""


pytestmark = pytest.mark.usefixtures("quiet")


@dataclass
class Faulty:
    """Connections to a server that loses some messages, answers late, or hangs for a while.

    Attributes:
        loses: whether a message never reaches the server.
        late: seconds that every message to the server takes.
        hangs: a message that contains this makes the server hang.
        hangs_for: seconds.
    """

    server: MemoryServer
    pace: VirtualPace
    loses: Callable[[str], bool] = lambda text: False
    late: float = 0.0
    hangs: str = "\0"
    hangs_for: float = 0.0
    until: float = field(default=0.0, init=False)

    async def dial(self, tag: str) -> Wire:
        return _FaultyWire(self)

    async def play(self, cases: tuple[Case, ...], target: Target = SLOW) -> Run:
        return await run_cases(cases, target, self.dial, "memory", Conditions(jobs=1), self.pace)


class _FaultyWire(MemoryWire):
    def __init__(self, faulty: Faulty) -> None:
        super().__init__(faulty.server.accept)
        self._faulty = faulty

    async def send(self, data: str | bytes) -> None:
        text = data if isinstance(data, str) else data.decode("latin-1")
        if self._faulty.late:
            await self._faulty.pace.sleep(self._faulty.late)
        if self._faulty.hangs in text:
            self._faulty.until = self._faulty.pace.now() + self._faulty.hangs_for
        if self._faulty.pace.now() >= self._faulty.until and not self._faulty.loses(text):
            await super().send(data)


def _loses_subscriptions(text: str) -> bool:
    return '"op": "subscribe"' in text and '/t"' in text


async def _failing() -> Run:
    cases = tuple(case for case in select(load_cases(), SLOW) if not case.timed)
    async with memory_server("jazzy") as server:
        return await Faulty(server, VirtualPace(server.clock), _loses_subscriptions).play(cases)


def test_a_server_that_fails_much_costs_no_full_limit_for_each_case() -> None:
    run = asyncio.run(_failing())
    failed = sum(result.verdict == "fail" for result in run.results)
    asked = sum(result.verdict != "unimplemented" for result in run.results)
    assert failed > 100
    # What cases wait by themselves, half a second for a failure, and a tenth for each that is asked.
    assert run.seconds < 30 + LEAST_TIMEOUT * failed + 0.15 * asked
    assert run.seconds < 0.3 * (SLOW.timeout * failed + SLOW.settle * asked)


async def _limits(late: float) -> tuple[Target, Target]:
    case = next(case for case in load_cases() if case.id == "publish/order")
    async with memory_server("jazzy") as server:
        pace = VirtualPace(server.clock)
        tempo = Tempo(SLOW, Faulty(server, pace, late=late).dial, pace)
        before = tempo.limits()
        await tempo.measure()
        await tempo.play(case, "t1")
        return before, tempo.limits()


def test_limits_follow_what_answers_take() -> None:
    before, quick = asyncio.run(_limits(0.0))
    assert before == SLOW
    assert quick.timeout == LEAST_TIMEOUT
    assert quick.settle < 0.2
    _, slower = asyncio.run(_limits(0.05))
    assert LEAST_TIMEOUT < slower.timeout < SLOW.timeout
    _, slowest = asyncio.run(_limits(1.0))
    assert (slowest.timeout, slowest.settle) == (SLOW.timeout, SLOW.settle)


async def _hanging() -> Run:
    cases = tuple(case for case in select(load_cases(), SLOW) if case.section == "publish")
    async with memory_server("jazzy") as server:
        faulty = Faulty(server, VirtualPace(server.clock), hangs='"msg": [', hangs_for=8.0)
        return await faulty.play(cases)


def test_who_hangs_for_a_while_fails_once_for_it() -> None:
    run = asyncio.run(_hanging())
    assert len(run.results) > 15
    assert [result.case.id for result in run.results if result.verdict == "fail"] == ["publish/msg-is-list"]
