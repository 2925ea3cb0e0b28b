"""Short runs of the two long programs: nothing lost, nothing left behind."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.docs.blocks import ROOT

pytestmark = [pytest.mark.skipif(sys.platform != "linux", reason="they read /proc"), pytest.mark.timeout(60)]


def run(*arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", *arguments], cwd=ROOT, capture_output=True, text=True, timeout=50
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_clients_that_come_and_go_leave_nothing_behind() -> None:
    printed = run("bench.fleet.soak", "--seconds", "20")
    assert "in the handshake" in printed and "in a call, reset" in printed


def test_the_healthy_lose_nothing_to_those_that_stopped() -> None:
    printed = run(
        "bench.fleet.load_1000", "--clients", "100", "--operators", "60", "--settle", "2", "--seconds", "2"
    )
    assert "lost by operators           0" in printed
