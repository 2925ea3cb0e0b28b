"""Alert rules: they fire on their faults, query what servers have, and each is explained."""

from __future__ import annotations

import re
import shutil
import subprocess
from typing import Any

import pytest
import yaml

from tests.processes import ROOT

FILES = ROOT / "docs" / "how-to" / "deploy"
PAGE = (ROOT / "docs" / "how-to" / "on-call.md").read_text(encoding="utf-8")
RULES: list[dict[str, Any]] = yaml.safe_load((FILES / "alerts.yml").read_text(encoding="utf-8"))["groups"][0][
    "rules"
]


def test_each_alarm_has_its_row_and_section() -> None:
    rows = re.findall(r"^\| \[(\w+)\]\(#(\w+)\) \|[^|]+\| (\w+) \|$", PAGE, re.MULTILINE)
    assert sorted(rows) == sorted(
        (rule["alert"], rule["alert"].lower(), rule["labels"]["severity"]) for rule in RULES
    )
    sections = re.findall(r"^### (\w+)\n\n\S", PAGE, re.MULTILINE)
    assert sorted(sections) == sorted(rule["alert"] for rule in RULES)


def test_alarms_query_metrics_of_the_server() -> None:
    sources = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "src/rwt").rglob("*.py"))
    for rule in RULES:
        metrics = set(re.findall(r"\b(?:rwt|process)_\w+", rule["expr"]))
        assert metrics or rule["expr"].startswith("up{")
        for metric in metrics:
            family = re.sub(r"_(sum|count)$", "", metric) if "_lag_" in metric else metric
            assert f'"{family}"' in sources, metric


def test_each_alarm_fires_on_its_fault_and_none_on_a_healthy_robot() -> None:
    text = (FILES / "alerts_test.yml").read_text(encoding="utf-8")
    for rule in RULES:
        assert f"alertname: {rule['alert']}," in text and f'alertname="{rule["alert"]}"' in text
    program = shutil.which("promtool")
    if program is None:
        pytest.skip("promtool is not installed (Debian has it, in prometheus)")
    done = subprocess.run(
        [program, "test", "rules", "alerts_test.yml"], cwd=FILES, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
