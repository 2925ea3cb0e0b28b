"""`python -m bench --against`: comparison with an earlier commit."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bench.__main__ import against_earlier, earlier_server
from bench.cases import CASES, METRICS, Compared, Peer
from bench.traffic.processes import ServerFailed

ROOT = Path(__file__).parents[2]


def test_every_case_is_compared_with_the_earlier_commit_alone() -> None:
    cases, metrics = against_earlier(CASES, METRICS)
    assert [case.name for case in cases] == [case.name for case in CASES]
    assert {peer for case in cases for peer in case.peers} == {Peer.EARLIER}
    assert {metric.peer for metric in metrics} == {Peer.EARLIER}
    assert {metric.compared for metric in metrics} == {Compared.RATIO}
    assert not any(metric.floor or metric.peer_case for metric in metrics)
    labels = [metric.label for metric in metrics]
    assert len(set(labels)) == len(labels)


def test_a_folder_without_the_server_is_named(tmp_path: Path) -> None:
    missing = "has neither bench/peers/server.py nor bench/server.py"
    with pytest.raises(ServerFailed, match=f"{tmp_path} {missing}"):
        earlier_server(tmp_path, None)


def test_a_checkout_takes_turns_with_this_one() -> None:
    command = [sys.executable, "-m", "bench", "--against", ".", "--only", "calls in server 1"]
    command += ["--rounds", "1", "--seconds", "0.1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "service in the server, 1 at a time, calls/s" in done.stdout
