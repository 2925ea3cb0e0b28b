"""Grades of the real client libraries, compared with their target files."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rosbridge_conformance.client_runner import run_client_cases
from rosbridge_conformance.command import ADAPTERS
from rosbridge_conformance.reports import json_file
from rosbridge_conformance.reports.terminal import failure
from rosbridge_conformance.runner import Conditions, select
from rosbridge_conformance.suite.loading import CLIENT_CASES, load_cases
from rosbridge_conformance.suite.rules import load_rules
from rosbridge_conformance.suite.target import find_client_target

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
    run = asyncio.run(run_client_cases(cases, target, COMMANDS[name], "ws://127.0.0.1:0", Conditions(jobs=6)))
    assert not [failure(result, load_rules()) for result in run.results if result.unexpected]
    assert not run.stale
    assert run.target.name == target.name
    report = json.loads(json_file.render(run, load_rules()))
    generator = _generator()
    assert _column_of_page(run.target.name) == generator.column(report["results"]), "run make client-grades"


def _generator() -> Any:
    path = Path(__file__).parents[2] / "tools" / "generate_client_grades.py"
    spec = importlib.util.spec_from_file_location("generate_client_grades", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _column_of_page(library: str) -> dict[str, str]:
    """Return the text of the page about one library, by section."""
    page = (Path(__file__).parents[2] / "docs" / "reference" / "client-grades.md").read_text()
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line[:2] == "| "
    ]
    place = rows[0].index(library)
    table = [row for row in rows[2:] if len(row) == len(rows[0])]
    return {row[0]: row[place] for row in table}
