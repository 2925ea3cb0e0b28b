"""Clients that vanish while they drive: the demo robot stands within the lease's time, by its own stamps."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from typing import Any

import pytest

from rwt import Server
from rwt_graph.api import Sample
from rwt_webrtc.settings import WebRtcSettings
from tests.core.access.network import Cable, why_no_cables
from tests.processes import LONGEST
from tests.waiting import until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="it has no SIGSTOP"),
]

LEASE = 0.4
MARGIN = 0.1
SPEED = 0.05
"""Slow, since what it takes to brake (2 m/s²) counts."""

GATE = {
    "rules": {
        "drive": {
            "topics": ["/cmd_vel"],
            "lease": {"seconds": LEASE},
            "stop": {"repeat_seconds": 0.3},
            "fields": {"linear.x": {"min": -1, "max": 1}},
        }
    }
}


class Witness:
    """Commands to the robot and its motion, with times of its own clock in seconds.

    Attributes:
        told: times, speeds and nodes of `/cmd_vel`.
        moved: times and speeds of `/odom`.
        lateness: seconds since :meth:`begin` for which this process was not given a processor. Several delays
            may add up between a message and the stop.
    """

    def __init__(self, server: Server) -> None:
        self.told: list[tuple[float, float, str]] = []
        self.moved: list[tuple[float, float]] = []
        self.lateness = 0.0
        self._clock = server.graph.clock
        participant = server.graph.participant("/witness")
        participant.subscribe("/cmd_vel", self._on_told)
        participant.subscribe("/odom", self._on_moved)
        self._due, self._worked = time.monotonic(), time.thread_time()
        self._look()

    def begin(self) -> None:
        """Forget what was so far."""
        self.lateness = 0.0

    def _look(self) -> None:
        now, worked = time.monotonic(), time.thread_time()
        self.lateness += max(0.0, now - self._due - (worked - self._worked))
        self._due, self._worked = now + 0.01, worked
        self._clock.call_later(0.01, self._look)

    def _on_told(self, sample: Sample) -> None:
        value: Any = sample.payload.value()
        self.told.append((sample.stamp_ns / 1e9, value.linear.x, sample.node))

    def _on_moved(self, sample: Sample) -> None:
        value: Any = sample.payload.value()
        stamp = value.header.stamp
        self.moved.append((stamp.sec + stamp.nanosec / 1e9, value.twist.twist.linear.x))

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait until a condition is true; a driver may start slowly on a busy machine."""
        await until(condition, seconds=3 * LONGEST)

    @property
    def drives(self) -> bool:
        """True if the robot has moved for a few samples."""
        return len(self.moved) > 3 and all(abs(speed) > SPEED / 2 for _, speed in self.moved[-3:])

    @property
    def stands(self) -> bool:
        """True if the gate has stopped it, and it stands."""
        return self.told[-1][2] == "/gate" and self.moved[-1][1] == 0.0

    def check(self) -> None:
        """Hold that the robot stood in time after the last message of a client."""
        last = max(at for at, _, node in self.told if node != "/gate")
        stopped = min(at for at, _, node in self.told if node == "/gate" and at >= last)
        stood = min(at for at, speed in self.moved if at >= last and speed == 0.0)
        allowed = LEASE + MARGIN + self.lateness
        assert stopped - last <= allowed, (stopped - last, self.lateness)
        # Its odometry comes every 50 ms.
        assert stood - last <= allowed + 0.05, (stood - last, self.lateness)


@asynccontextmanager
async def _server(scheme: str = "ws", host: str = "127.0.0.1") -> AsyncIterator[tuple[Server, Witness]]:
    async with Server(
        f"{scheme}://{host}:0",
        demo=True,
        gate=GATE,
        gateways=("foxglove", "http", "mcp"),
        mcp={"default_role": "admin"},
        webrtc=WebRtcSettings(enabled=True),
    ) as server:
        # It would stop by itself; here only the gate does.
        robot = server.node("setter")
        await robot.call(
            "/demo_robot/set_parameters",
            {"parameters": [{"name": "command_timeout", "value": {"type": 3, "double_value": 60.0}}]},
        )
        yield server, Witness(server)


@contextmanager
def _driver(
    server: Server,
    way: str = "rosbridge",
    speed: float = SPEED,
    period: float = 0.05,
    before: Sequence[str] = (),
) -> Iterator[subprocess.Popen[str]]:
    """A program that drives; `before` stands before its command."""
    url = server.urls[0]
    if way == "webrtc":
        way, url = "rosbridge", url.replace("ws:", "webrtc+http:")
    process = subprocess.Popen(
        [*before, sys.executable, "-m", "tests.core.access.driver", way, url, str(speed), str(period)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def _silent(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


ENDS: dict[str, Callable[[subprocess.Popen[str]], None]] = {
    "killed": lambda process: process.kill(),
    "stopped": lambda process: process.send_signal(signal.SIGSTOP),
    "silent": _silent,
}


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("scheme", "way", "end"),
    [
        ("ws", "rosbridge", "killed"),
        ("ws", "rosbridge", "stopped"),
        ("ws", "rosbridge", "silent"),
        ("tcp", "rosbridge", "stopped"),
        ("ws", "webrtc", "killed"),
        ("ws", "webrtc", "stopped"),
        ("ws", "foxglove", "stopped"),
        ("ws", "http", "stopped"),
        ("ws", "mcp", "killed"),
        ("ws", "mcp", "stopped"),
    ],
)
async def test_the_robot_stands_when_its_driver_is_gone(scheme: str, way: str, end: str) -> None:
    async with _server(scheme) as (server, witness):
        with _driver(server, way) as driver:
            await witness.until(lambda: witness.drives)
            witness.begin()
            ENDS[end](driver)
            await witness.until(lambda: witness.stands)
            witness.check()


@pytest.mark.anyio
@pytest.mark.skipif(bool(why_no_cables()), reason=why_no_cables())
@pytest.mark.parametrize(
    ("scheme", "way"), [("ws", "rosbridge"), ("tcp", "rosbridge"), ("ws", "webrtc"), ("ws", "mcp")]
)
async def test_the_robot_stands_when_the_cable_is_pulled(scheme: str, way: str) -> None:
    with Cable() as cable:
        async with _server(scheme, cable.here) as (server, witness):
            with _driver(server, way, before=cable.there_runs):
                await witness.until(lambda: witness.drives)
                witness.begin()
                cable.pull()
                await witness.until(lambda: witness.stands)
                witness.check()


@pytest.mark.anyio
async def test_the_robot_stands_while_another_client_floods_the_server() -> None:
    async with _server() as (server, witness):
        with _driver(server) as driver:
            await witness.until(lambda: witness.drives)
            # A busy machine stalls the driver before the signal does, which ends the lease as well.
            last = len(witness.told)
            witness.begin()
            with _driver(server, speed=-0.9, period=0.0):
                bridge = server.bridge
                await witness.until(lambda: sum(peer.messages for peer in bridge.clients) > 3000)
                driver.send_signal(signal.SIGSTOP)
                # When the lease is over, the one who floods is given it, and drives.
                await witness.until(
                    lambda: (
                        any(node == "/gate" for _, _, node in witness.told[last:])
                        or witness.told[-1][1] == -0.9
                    )
                )
        stop = next(at for at, _, node in witness.told[last:] if node == "/gate")
        before = max(at for at, speed, _ in witness.told if at < stop and speed == SPEED)
        assert stop - before <= LEASE + MARGIN + witness.lateness
        # Nothing of the one who floods came before it.
        assert all(speed != -0.9 for at, speed, _ in witness.told if at < stop)
