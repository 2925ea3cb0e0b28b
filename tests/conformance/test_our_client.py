"""The client cases against the project's own client: all pass, and small faults put into it are found."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import anyio
import pytest

from rosbridge_conformance.reports.terminal import failure
from rosbridge_conformance.runner import select
from rosbridge_conformance.suite.loading import CLIENT_CASES, load_cases
from rosbridge_conformance.suite.rules import load_rules
from rosbridge_conformance.suite.target import find_client_target
from tests.conformance.client_faults import CLIENT_FAULTS, TARGET, ClientFault, asked, play_client

pytestmark = pytest.mark.usefixtures("quiet")


def test_our_client_passes_every_case() -> None:
    cases = select(load_cases(CLIENT_CASES), find_client_target(str(TARGET)))
    run = anyio.run(play_client, cases)
    assert not [failure(result, load_rules()) for result in run.results if result.unexpected]
    assert not run.stale
    assert sum(result.verdict == "pass" for result in run.results) > 120


@pytest.mark.extended
def test_the_suite_finds_every_fault_of_a_client() -> None:
    cases = load_cases(CLIENT_CASES)
    missed: list[str] = []

    async def hunt(fault: ClientFault) -> None:
        fitting = asked(cases, fault)
        assert fitting, fault.name
        fine = await play_client(fitting)
        assert [result.verdict for result in fine.results] == ["pass"] * len(fitting), fault.name
        spoiled = await play_client(fitting, fault)
        if not any(result.verdict in ("fail", "non-strict") for result in spoiled.results):
            missed.append(fault.name)

    async def hunt_all() -> None:
        gate = asyncio.Semaphore(4)

        async def one(fault: ClientFault) -> None:
            async with gate:
                await hunt(fault)

        await asyncio.gather(*(one(fault) for fault in CLIENT_FAULTS))

    anyio.run(hunt_all)
    assert missed == []
    assert len({fault.name for fault in CLIENT_FAULTS}) == len(CLIENT_FAULTS) >= 50


def test_a_fault_that_is_none_is_not_found() -> None:
    nothing = replace(CLIENT_FAULTS[0], name="nothing", cases=("publish/*",), out=None)
    run = anyio.run(play_client, asked(load_cases(CLIENT_CASES), nothing), nothing)
    assert run.ok
