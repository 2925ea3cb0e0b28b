"""Benchmark of the gate's stops: its table, and the frames of its attackers."""

from __future__ import annotations

from bench.gate.__main__ import LEASE, STOP, TURN, table
from bench.gate.attackers import KINDS


def test_the_table_has_a_row_for_each_number_of_attackers() -> None:
    found = {STOP: [0.001 * each for each in range(1, 201)], LEASE: [0.002], TURN: [0.003]}
    lines = table({0: found, 10: found}).splitlines()
    assert lines[2:4] == [
        "| emergency stop | 0 | 101.0 ms | 199.0 ms | 200.0 ms |",
        "| emergency stop | 10 | 101.0 ms | 199.0 ms | 200.0 ms |",
    ]
    assert len(lines) == 8


def test_every_attacker_has_frames() -> None:
    assert len(KINDS) == 10
    assert all(frames and all(frames) for _, make, _ in KINDS for frames in [make()])
