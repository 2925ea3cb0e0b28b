"""What the real client libraries are graded is what their target files say."""

from __future__ import annotations

import asyncio
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from conformance.client_runner import run_client_cases
from conformance.command import ADAPTERS
from conformance.loading import CLIENT_CASES, load_cases
from conformance.reports.terminal import failure
from conformance.rules import load_rules
from conformance.runner import Conditions, select
from conformance.target import find_client_target

NODE = str(Path(__file__).parent / "node")

COMMANDS = {
    "roslib-2": ["node", str(ADAPTERS / "roslib.mjs"), NODE],
    "roslib-1": ["node", str(ADAPTERS / "roslib.mjs"), NODE, "roslib1"],
    "roslibpy": [sys.executable, str(ADAPTERS / "roslibpy_adapter.py")],
}


@pytest.mark.clients
@pytest.mark.timeout(120)
@pytest.mark.usefixtures("client_packages")
@pytest.mark.parametrize("name", COMMANDS)
def test_grades_are_as_expected(name: str) -> None:
    target = replace(find_client_target(name), timeout=6.0)  # Other tests may keep the machine busy.
    cases = select(load_cases(CLIENT_CASES), target)
    run = asyncio.run(run_client_cases(cases, target, COMMANDS[name], "ws://127.0.0.1:0", Conditions(jobs=4)))
    assert not [failure(result, load_rules()) for result in run.results if result.unexpected]
    assert not run.stale
    assert run.target.name == target.name
