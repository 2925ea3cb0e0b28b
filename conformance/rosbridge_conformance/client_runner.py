"""Runner of many cases against one client library: a few programs, and a listener for each case."""

from __future__ import annotations

import asyncio
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from urllib.parse import urlsplit

from rosbridge_conformance.case_player import Played
from rosbridge_conformance.client_player import play_as_server
from rosbridge_conformance.program import Program
from rosbridge_conformance.runner import Conditions, Result, Run, judge_cases
from rosbridge_conformance.suite.case import Case
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.wire.listening import listen
from rosbridge_conformance.wire.pace import RealPace
from rosbridge_conformance.wire.wires import WireError


async def run_client_cases(
    cases: Sequence[Case],
    target: Target,
    command: Sequence[str],
    url: str,
    conditions: Conditions,
    told: Callable[[Result], None] = lambda result: None,
) -> Run:
    """Play cases as a server, against as many programs as there are jobs.

    A program plays one case at a time and is restarted after a failure.

    Args:
        cases: selected cases.
        target: description of the client library; its name is reported by the program.
        command: command of the program.
        url: URL to listen on, `ws://HOST:PORT`; more than one job needs port 0.
        conditions: conditions of the run.
        told: called with each result.

    Raises:
        WireError: the URL cannot be listened on.
        ProgramError: the program cannot be started.
    """
    if conditions.jobs > 1 and urlsplit(url).port != 0:
        raise WireError(f"{url}: more than one job needs port 0, or say --jobs 1")
    pace = RealPace()
    programs = _Programs(command)
    first = await programs.take()  # Report a wrong command once, not for every case.
    programs.give_back(first, whole=True)
    target = replace(target, name=first.library)

    async def play_one(case: Case, tag: str) -> Played:
        program = await programs.take()
        whole = False
        try:
            async with listen(url) as listener:
                played = await play_as_server(case, target, program, listener, pace, tag)
            whole = played.fault is None
        finally:
            programs.give_back(program, whole=whole)
        return played

    try:
        return await judge_cases(cases, target, play_one, shlex.join(command), conditions, pace, told)
    finally:
        await programs.end()


class _Programs:
    """Programs that wait for their next case."""

    def __init__(self, command: Sequence[str]) -> None:
        self._command = command
        self._idle: list[Program] = []
        self._ending: set[asyncio.Task[None]] = set()

    async def take(self) -> Program:
        return self._idle.pop() if self._idle else await Program.start(self._command)

    def give_back(self, program: Program, *, whole: bool) -> None:
        if whole:
            self._idle.append(program)
        else:
            program.kill()
            self._end(program)

    def _end(self, program: Program) -> None:
        task = asyncio.create_task(program.end())
        self._ending.add(task)
        task.add_done_callback(self._ending.discard)

    async def end(self) -> None:
        for program in self._idle:
            self._end(program)
        await asyncio.gather(*self._ending)
