"""Stop latency of this machine: a server with a gate in this process, driven and stopped over loopback."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from typing import Any, Final

import anyio

from rwt.cli.console.logs import quiet
from rwt.server import Server
from rwt_client import Robot, connect

_TYPE: Final = "geometry_msgs/Twist"
_LEASE_SECONDS: Final = 0.05


def _rule(topic: str, seconds: float) -> dict[str, object]:
    stop = {"repeat_seconds": 0}
    return {"topics": [topic], "type": _TYPE, "emergency": True, "lease": {"seconds": seconds}, "stop": stop}


#: The lease of the first topic must not end while its emergency stop is measured.
_RULES: Final = {"stopped": _rule("/stopped", 60.0), "leased": _rule("/leased", _LEASE_SECONDS)}

_STOPS: Final = 200
_LEASES: Final = 40

#: Timeout of one measurement: a robot that is not stopped by then is reported.
_PATIENCE: Final = 5.0


@dataclass(frozen=True, slots=True)
class Latencies:
    """Sorted latencies in seconds.

    Attributes:
        stops: from sending the call of a client to the stop message in the robot's code.
        leases: from the end of a lease to the stop message.
    """

    stops: list[float]
    leases: list[float]


class _Base:
    """Robot that notes when it hears of another velocity."""

    def __init__(self) -> None:
        self._changed = anyio.Event()
        self.speed = 0.0
        self.heard_at = 0.0

    def on_command(self, command: Any) -> None:
        if command.linear.x != self.speed:
            self.heard_at = time.monotonic()
        self.speed = command.linear.x
        self._changed.set()
        self._changed = anyio.Event()

    async def wait_for(self, speed: float) -> float:
        with anyio.fail_after(_PATIENCE):
            while self.speed != speed:
                await self._changed.wait()
        return self.heard_at


async def measure(stops: int = _STOPS, leases: int = _LEASES) -> Latencies:
    """Measure the latency of the emergency stop and of the dead-man's stop.

    Raises:
        TimeoutError: the robot was not stopped.
        ServerError, TransportError: no server can be started.
    """
    stopped, leased = _Base(), _Base()
    found = Latencies([], [])
    server = Server("ws://127.0.0.1:0", gate={"rules": _RULES}, nodes=(), gateways=())
    with quiet("rwt.bridge", logging.ERROR):  # Each stop is a warning.
        async with server, connect(server.urls[0]) as client:
            robot = server.node("base")
            robot.subscribe("/stopped", stopped.on_command, _TYPE)
            robot.subscribe("/leased", leased.on_command, _TYPE)
            drive = client.advertise("/stopped", _TYPE)
            for _ in range(stops):
                drive.publish({"linear": {"x": 0.5}})
                await stopped.wait_for(0.5)
                began = time.monotonic()
                await _call(client, "/gate/stop")
                found.stops.append(await stopped.wait_for(0.0) - began)
                await _call(client, "/gate/release_stop")
                drive.publish({})  # The stop message: else the gate waits for a second of silence.
            drive = client.advertise("/leased", _TYPE)
            for _ in range(leases):
                drive.publish({"linear": {"x": 0.5}})
                ends = await leased.wait_for(0.5) + _LEASE_SECONDS
                found.leases.append(max(0.0, await leased.wait_for(0.0) - ends))
    found.stops.sort()
    found.leases.sort()
    return found


async def _call(client: Robot, service: str) -> None:
    await client.call(service, {"reason": "rwt doctor"}, "rwt_gate_msgs/Stop")
