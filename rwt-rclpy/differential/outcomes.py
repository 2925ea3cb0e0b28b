"""Pytest plugin that writes the outcome of each test as a line of JSON, so that a crash loses no line.

It runs in the interpreter of ROS as well, and therefore imports nothing of this project but for ours.
"""

from __future__ import annotations

import importlib
import json
import os
from pathlib import Path

import pytest

#: Number of each test among those of one function: the names of parameters may differ.
_numbers: dict[str, tuple[str, int]] = {}
#: Variable with the file of the outcomes, variable that chooses this project's rclpy, and variable with the
#: real one's folder of Python packages, from which that takes the messages of `test_msgs`.
FILE, OURS, PACKAGES = "RCLPY_TEST_OUTCOMES", "RCLPY_TEST_OURS", "RCLPY_TEST_PACKAGES"

if os.environ.get(OURS):
    import rwt_rclpy

    rwt_rclpy.install([Path(__file__).parent / "interfaces"])
    if PACKAGES in os.environ:
        importlib.import_module("test_msgs").__path__.append(str(Path(os.environ[PACKAGES], "test_msgs")))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Number the tests of each function."""
    seen: dict[str, int] = {}
    for item in items:
        name = item.nodeid.partition("::")[2].partition("[")[0]
        _numbers[item.nodeid] = name, seen.get(name, 0)
        seen[name] = seen.get(name, 0) + 1


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Write the outcome of a test, or of its preparation if that failed or skipped it."""
    if report.when == "call" or report.outcome != "passed":
        test, number = _numbers[report.nodeid]
        name = f"{test}[{number}]" if number else test
        why = "" if report.outcome == "passed" else str(report.longrepr).strip().rpartition("\n")[2]
        with open(os.environ[FILE], "a", encoding="utf-8") as file:
            file.write(json.dumps([name, report.outcome, why]) + "\n")


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Write that a file can't be imported."""
    if report.failed:
        why = str(report.longrepr).strip().rpartition("\n")[2]
        with open(os.environ[FILE], "a", encoding="utf-8") as file:
            file.write(json.dumps(["", "failed", why]) + "\n")
