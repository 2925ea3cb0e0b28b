"""Runner of many cases against one server or client library, and their verdicts."""

from __future__ import annotations

import asyncio
import fnmatch
import itertools
import os
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from rosbridge_conformance.case_player import Fault, Line, Played
from rosbridge_conformance.suite.case import Case, Close, ExpectNothing, Wait
from rosbridge_conformance.suite.matching import Difference
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.tempo import Tempo
from rosbridge_conformance.wire.pace import Pace, RealPace
from rosbridge_conformance.wire.wires import Dial, Framing

Verdict: TypeAlias = Literal["pass", "non-strict", "informational", "unimplemented", "fail"]

VERDICTS: tuple[Verdict, ...] = ("pass", "non-strict", "informational", "unimplemented", "fail")

PlayOne: TypeAlias = Callable[[Case, str], Awaitable[Played]]
"""Plays one case, with a unique part of names."""

_LONGEST_CASE = 60.0

_ASKED_AGAIN = 20
"""Maximum number of failed cases that are repeated: if more fail, lack of time is not the cause."""


@dataclass(frozen=True, slots=True)
class Result:
    """Result of one case.

    Attributes:
        expected: reason in the target file for an expected failure, or None.
        missing: feature that the target does not declare, or a client library lacks, for `unimplemented`.
        again: True if it failed first, and passed when repeated alone and with more time.
    """

    case: Case
    verdict: Verdict
    fault: Fault | None = None
    remarks: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    expected: str | None = None
    transcript: tuple[Line, ...] = ()
    seconds: float = 0.0
    again: bool = False

    @property
    def robustness(self) -> bool:
        """True if the case is reported separately from conformance."""
        return self.case.level == "HARDEN"

    @property
    def unexpected(self) -> bool:
        """True if the case failed unexpectedly."""
        return self.verdict == "fail" and self.expected is None


@dataclass(frozen=True, slots=True)
class Run:
    """All results of a run.

    Attributes:
        stale: expected failures of the target that did not occur.
    """

    target: Target
    url: str
    results: tuple[Result, ...]
    stale: tuple[str, ...]
    seconds: float

    @property
    def ok(self) -> bool:
        """True if nothing failed unexpectedly and no expectation is stale."""
        return not self.stale and not any(result.unexpected for result in self.results)


def select(
    cases: Sequence[Case], target: Target, run: Sequence[str] = (), skip: Sequence[str] = ()
) -> tuple[Case, ...]:
    """Return cases for the target that match a glob of `run` and none of `skip`, by id, section or rule."""

    def fits(case: Case, globs: Sequence[str]) -> bool:
        names = (case.id, case.section, *case.rules)
        return any(fnmatch.fnmatchcase(name, glob) for glob in globs for name in names)

    return tuple(
        case for case in cases if target.asked(case) and (not run or fits(case, run)) and not fits(case, skip)
    )


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions of a run.

    Attributes:
        jobs: number of concurrent cases.
        strict: True if non-strict is a failure.
        framing: how the wire delimits messages.
        several_clients: True if several connections reach the same server.
        outlives: True if the server outlives the first connection.
    """

    jobs: int = 16
    strict: bool = False
    framing: Framing = "messages"
    several_clients: bool = True
    outlives: bool = True

    def missing(self, case: Case) -> tuple[str, ...]:
        """Return the feature of the wire that a case requires and this wire lacks."""
        several = len(case.clients) > 1
        first_leaves = any(isinstance(step, Close) and step.client == case.clients[0] for step in case.steps)
        lacks = (
            ("several-clients", several and not self.several_clients),
            ("a server that outlives its first client", several and first_leaves and not self.outlives),
        )
        return tuple(name for name, missing in lacks if missing)

    @property
    def features(self) -> frozenset[str]:
        """Features of the wire, by their names in cases."""
        return frozenset({self.framing, *(("several-clients",) if self.several_clients else ())})


async def run_cases(
    cases: Sequence[Case],
    target: Target,
    dial: Dial,
    url: str,
    conditions: Conditions,
    pace: Pace | None = None,
    told: Callable[[Result], None] = lambda result: None,
) -> Run:
    """Play cases, several at once, then those that measure time, then those that must run alone.

    Timeouts follow the response times of the server, see :class:`Tempo`. A case that failed is
    repeated at the end, alone and with twice the time, before it counts: the machine may have been
    busy.

    Args:
        cases: selected cases.
        target: description of the server.
        dial: opens a connection to the server.
        url: URL for the reports.
        conditions: conditions of the run.
        pace: clock; by default that of the machine.
        told: called with each result.
    """
    pace = pace or RealPace()
    tempo = Tempo(target, dial, pace, one_server=conditions.several_clients)
    await tempo.measure()
    return await judge_cases(cases, target, tempo.play, url, conditions, pace, told, tempo.again)


async def judge_cases(
    cases: Sequence[Case],
    target: Target,
    play_one: PlayOne,
    url: str,
    conditions: Conditions,
    pace: Pace,
    told: Callable[[Result], None] = lambda result: None,
    again: PlayOne | None = None,
) -> Run:
    """Play and judge cases like `run_cases`, by a given function.

    Args:
        again: plays a failed case again; by default failures are final.
    """
    began = pace.now()
    judge = _Judge(target, play_one, conditions)
    gate = asyncio.Semaphore(conditions.jobs)
    failed: list[Result] = []

    async def one(case: Case) -> Result:
        result = await judge.result(case)
        if result.unexpected and again is not None:
            failed.append(result)
            if len(failed) == _ASKED_AGAIN + 1:
                for known in failed:
                    told(known)
            if len(failed) <= _ASKED_AGAIN:
                return result
        told(result)
        return result

    async def beside(case: Case) -> Result:
        async with gate:
            return await one(case)

    async def in_company(case: Case) -> Result:
        async with gate:
            result = await judge.result(case)
        if result.verdict != "fail":
            told(result)
        return result

    order = _Order.of(cases, target, conditions.jobs)
    results = list(await asyncio.gather(*map(beside, order.together)))
    timed = await asyncio.gather(*map(in_company, order.timed))
    results += [result for result in timed if result.verdict != "fail"]
    # A case that measures time may have failed because of concurrent ones.
    not_yet = [result.case for result in timed if result.verdict == "fail"]
    results += [await one(case) for case in (*not_yet, *order.alone)]
    if again is not None and len(failed) <= _ASKED_AGAIN:
        patient = _Judge(target, again, conditions)
        for result in failed:
            second = await patient.result(result.case)
            results.remove(result)
            results.append(result if second.verdict == "fail" else replace(second, again=True))
            told(results[-1])
    results.sort(key=lambda result: result.case.id)
    return Run(target, url, tuple(results), _stale(target, results), pace.now() - began)


@dataclass(frozen=True, slots=True)
class _Order:
    """Groups of cases by concurrency.

    Attributes:
        together: cases that are played concurrently, as many as there are jobs.
        timed: cases that measure time. They mostly wait, and so are played concurrently, when all
            others are done.
        alone: cases that are played alone.
    """

    together: Sequence[Case]
    timed: Sequence[Case]
    alone: Sequence[Case]

    @classmethod
    def of(cls, cases: Sequence[Case], target: Target, jobs: int) -> _Order:
        """Return cases with the longest waits first, so that all end at about the same time."""
        together: list[Case] = []
        timed: list[Case] = []
        alone: list[Case] = []
        for case in cases:
            if target.alone_with(case):
                alone.append(case)
            elif case.timed:
                (timed if jobs > 1 else alone).append(case)
            else:
                together.append(case)
        # Expected failures are last: they may leave the server busy forever.
        together.sort(key=lambda case: (target.reason(case.id) is not None, -_waiting(case)))
        timed.sort(key=_waiting, reverse=True)
        return cls(together, timed, alone)


def _waiting(case: Case) -> float:
    """Return the fixed waiting time of a case in seconds."""
    return sum(step.seconds for step in case.steps if isinstance(step, Wait | ExpectNothing))


def _stale(target: Target, results: Sequence[Result]) -> tuple[str, ...]:
    """Return the expected failures that were played and did not fail."""

    def answered(key: str) -> bool:
        asked = [result for result in results if fnmatch.fnmatchcase(result.case.id, key)]
        return not asked or any(result.verdict == "fail" for result in asked)

    return tuple(key for key in target.expected if not answered(key))


class _Judge:
    _numbers = itertools.count(1)

    def __init__(self, target: Target, play_one: PlayOne, conditions: Conditions) -> None:
        self._target = target
        self._play_one = play_one
        self._conditions = conditions

    async def result(self, case: Case) -> Result:
        missing = self._target.missing(case, self._conditions.features)
        missing = (*missing, *self._conditions.missing(case))
        if missing:
            return Result(case, "unimplemented", missing=missing)
        tag = f"c{os.getpid():x}_{next(self._numbers)}"
        try:
            async with asyncio.timeout(_LONGEST_CASE):
                played = await self._play_one(case, tag)
        except TimeoutError:
            late = Difference("", f"an end within {_LONGEST_CASE:g} s", "none")
            played = Played(Fault(0, "the whole case", late), (), (), _LONGEST_CASE)
        if played.unsupported:
            return Result(case, "unimplemented", missing=(played.unsupported,), transcript=played.transcript)
        return Result(
            case,
            self._verdict(case, played),
            played.fault,
            played.remarks,
            expected=self._target.reason(case.id),
            transcript=played.transcript,
            seconds=played.seconds,
        )

    def _verdict(self, case: Case, played: Played) -> Verdict:
        if case.level == "INFO":
            return "informational"
        if played.fault is not None:
            return "fail"
        if played.remarks:
            return "fail" if self._conditions.strict else "non-strict"
        return "pass"
