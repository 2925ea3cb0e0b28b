"""Pytest plugin that writes the outcome of each test as a line of JSON, so that a crash loses no line.

It runs in the interpreter of ROS as well, and therefore imports nothing of this project but for ours.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

#: Variable with the file of the outcomes, and variable that chooses this project's rclpy.
FILE, OURS = "RCLPY_TEST_OUTCOMES", "RCLPY_TEST_OURS"

if os.environ.get(OURS):
    import rwt_rclpy

    rwt_rclpy.install([Path(__file__).parent / "interfaces"])


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Write the outcome of a test, or of its preparation if that failed or skipped it."""
    if report.when == "call" or report.outcome != "passed":
        name = report.nodeid.partition("::")[2]
        why = "" if report.outcome == "passed" else str(report.longrepr).strip().rpartition("\n")[2]
        with open(os.environ[FILE], "a", encoding="utf-8") as file:
            file.write(json.dumps([name, report.outcome, why]) + "\n")


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Write that a file can't be imported."""
    if report.failed:
        why = str(report.longrepr).strip().rpartition("\n")[2]
        with open(os.environ[FILE], "a", encoding="utf-8") as file:
            file.write(json.dumps(["", "failed", why]) + "\n")
