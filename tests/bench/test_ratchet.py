"""Ratchet of the calls per operation: `make bench-ratchet` compares all with the table, nightly."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bench.ratchet.__main__ import main

NAME = "call a node's service"


@pytest.mark.parametrize(("recorded", "code"), [(1, 1), (1_000_000, 0)])
def test_a_regression_is_reported(
    recorded: int,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    table = tmp_path / "table.json"
    table.write_text(json.dumps({NAME: recorded}))
    monkeypatch.setattr("bench.ratchet.__main__.TABLE", table)
    assert main(["--only", NAME]) == code
    assert ("REGRESSION" in capsys.readouterr().out) == bool(code)
