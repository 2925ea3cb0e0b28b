"""Attacks of peers on third-party parsers: the event loop stays responsive, and memory is bounded.

Each runs in a process with limits, so that a parser that never returns fails its test only.
"""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tests.faults.peers import (  # noqa: F401 - the imports register the attacks in ATTACKS
    datagram_attacks,
    hub_attacks,
    sctp_attacks,
    turn_attacks,
)
from tests.faults.peers.attacks import ATTACKS, Damage
from tests.processes import ROOT

TIMEOUT = 120
HELD_MS = 50
GROWN_MIB = 24
LOG_BYTES = 40_000


def suffer(name: str) -> Damage:
    """Run an attack; fails if its process hangs or does not serve another peer afterwards."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.faults.peers", name],
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return Damage(**json.loads(done.stdout))


@pytest.mark.slow
@pytest.mark.parametrize("name", ATTACKS)
def test_an_attack_holds_nobody_up(name: str) -> None:
    damage = suffer(name)
    assert damage.held_ms < HELD_MS
    assert damage.grown_mib < GROWN_MIB
    assert damage.log_bytes < LOG_BYTES, damage.log
    assert "Traceback" not in damage.log
    assert not damage.sent


PEERS = 1000
LEFT_OBJECTS = PEERS // 4
"""Fewer than one for each peer, without a collection of cyclic garbage."""
LEFT_MIB = 16


@pytest.mark.extended
@pytest.mark.timeout(400)
@pytest.mark.parametrize("kind", ["connected", "unanswered", "rejected"])
def test_ended_peers_leave_nothing_behind(kind: str) -> None:
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "tests.faults.peers.released",
            kind,
            str(PEERS if kind != "connected" else 300),
        ],
        capture_output=True,
        text=True,
        timeout=3 * TIMEOUT,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    left = json.loads(done.stdout)
    assert left["objects"] < LEFT_OBJECTS
    assert left["mib"] < LEFT_MIB
    assert (left["files"], left["tasks"]) == (0, 0)
