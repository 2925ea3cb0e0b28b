"""Put each fault into our server and see whether the suite finds it; prints a table (`make mutants`)."""

from __future__ import annotations

import asyncio
import logging
import sys
from dataclasses import dataclass, replace

from rosbridge_conformance.runner import Run, select
from rosbridge_conformance.suite.case import Case
from rosbridge_conformance.suite.loading import load_cases
from rosbridge_conformance.suite.target import Target, find_target
from tests.conformance.fault_list import FAULTS
from tests.conformance.faults import Fault
from tests.conformance.memory_server import memory_server

_TARGETS = {1: "rwt-noetic", 2: "rwt-jazzy"}
_DISTROS = {1: "noetic", 2: "jazzy"}


@dataclass(frozen=True, slots=True)
class Hunt:
    """Result of the search for one fault.

    Attributes:
        asked: cases that were played.
        found: ids of those that fail with the fault and not without it.
    """

    fault: Fault
    asked: int
    found: tuple[str, ...]


async def hunt(fault: Fault, cases: tuple[Case, ...]) -> Hunt:
    """Play the fault's cases against a server with it and one without."""
    target = replace(find_target(_TARGETS[fault.ros]), timeout=0.6)
    asked = select(cases, target, fault.cases)
    before = await _play(asked, target, None)
    after = await _play(asked, target, fault)
    fine = {result.case.id for result in before.results if result.verdict == "pass"}
    found = tuple(
        r.case.id for r in after.results if r.verdict in ("fail", "non-strict") and r.case.id in fine
    )
    return Hunt(fault, len(asked), found)


async def _play(cases: tuple[Case, ...], target: Target, fault: Fault | None) -> Run:
    async with memory_server(_DISTROS[target.ros], spoil=fault.spoil if fault else None) as server:
        return await server.play(cases, target)


async def hunt_all(faults: tuple[Fault, ...] = FAULTS) -> list[Hunt]:
    """Search for every fault."""
    cases = load_cases()
    return [await hunt(fault, cases) for fault in faults]


def table(hunts: list[Hunt]) -> str:
    """A line for each fault."""
    lines = [f"{'fault':46} {'found by':9} first"]
    for one in hunts:
        first = one.found[0] if one.found else "NOT FOUND"
        lines.append(f"{one.fault.name:46} {f'{len(one.found)}/{one.asked}':9} {first}")
    missed = sum(1 for one in hunts if not one.found)
    return "\n".join([*lines, f"{len(hunts)} faults, {missed} not found", ""])


def main() -> int:
    """Print the table; 1 if a fault was not found."""
    logging.disable()
    hunts = asyncio.run(hunt_all())
    sys.stdout.write(table(hunts))
    return 0 if all(one.found for one in hunts) else 1


if __name__ == "__main__":
    raise SystemExit(main())
