"""Benchmark of the gate's stops: its table, and the frames of its attackers."""

from __future__ import annotations

from bench.gate.__main__ import LEASE, STOP, TURN, table
from bench.gate.attackers import KINDS


def test_the_table_has_a_row_for_each_operator() -> None:
    found = {STOP: [0.001 * each for each in range(1, 201)], LEASE: [0.002], TURN: [0.003]}
    results = [("websocket", {0: found, 10: found}), ("mcp", {0: {STOP: [0.004]}, 10: {}})]
    lines = list(table(results, 0, 10))
    stop, one, none = "101.0 / 199.0 / 200.0", "2.0 / 2.0 / 2.0", "-"
    turn = "3.0 / 3.0 / 3.0"
    assert [line.split(" | ") for line in lines[2:]] == [
        ["| websocket", stop, stop, one, one, none, none, turn, f"{turn} |"],
        ["| mcp", "4.0 / 4.0 / 4.0", none, none, none, none, none, none, f"{none} |"],
    ]


def test_every_attacker_has_frames() -> None:
    assert len(KINDS) == 10
    assert all(frames and all(frames) for _, make, _ in KINDS for frames in [make()])
