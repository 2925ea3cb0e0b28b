"""The calls of small operations stay within two of the recorded table (`make bench-ratchet` counts all)."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from bench.ratchet.__main__ import TABLE, allowed, main
from bench.ratchet.operations import count, operations
from tools.size.layout import Layout

RECORDED: dict[str, int] = json.loads(TABLE.read_text())
SMALL = [
    "publish Twist to JSON",
    "publish Twist to cbor-raw",
    "publish Twist, missing fields to JSON",
    "publish LaserScan to JSON",
    "publish Twist to JSON, 10 clients",
    "publish Twist to JSON, and to a node",
    "publish Twist to JSON, through the gate",
    "call rosapi",
    "call a node's service",
    "call a client's service",
    "goal with feedback",
]


def test_every_operation_is_recorded() -> None:
    assert list(RECORDED) == list(operations())


@pytest.mark.parametrize("name", SMALL)
def test_an_operation_needs_no_more_calls_than_recorded(name: str) -> None:
    calls = asyncio.run(count(operations()[name], Layout().packages.values()))
    assert 0 < calls <= allowed(RECORDED[name])


def test_a_regression_is_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    name = "call a node's service"
    faster = tmp_path / "table.json"
    faster.write_text(json.dumps({name: RECORDED[name] - 10}))
    monkeypatch.setattr("bench.ratchet.__main__.TABLE", faster)
    assert main(["--only", name]) == 1
    assert "REGRESSION" in capsys.readouterr().out
