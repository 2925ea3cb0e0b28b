"""Latency of the gate's stops, with attackers and without: `python -m bench.gate`.

An emergency stop is timed from before an operator's program sends `/gate/stop` over rosbridge (WebSocket)
until the robot's callback has the stop message; a dead-man's stop from the end of the lease. Attackers have a
role that may publish, advertise, call and provide everything, but not stop. The longest turn is CPU time of
the event loop's thread between two polls: other programs do not add to it. Prints a table in Markdown.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import anyio

from bench.gate.robot import LEASE_SECONDS, LIST, TOKEN, TWIST
from bench.traffic.processes import Server, ServerFailed
from rwt_client import RemotePublisher, Robot, connect

ROBOT = Path(__file__).parent / "robot.py"
STOP, LEASE, TURN = "emergency stop", "dead-man's stop", "longest turn (CPU time) between commands"
STOPS = 200
LEASES = 100
ATTACKERS = 10
SETTLE_SECONDS = 2.0
"""Time for the attackers to fill every queue and quota."""
PATIENCE_SECONDS = 30.0
RETRY_SECONDS = 1.0
SPEED = 0.5


class Heard:
    """Velocities that the robot heard on one topic, with their times.

    Attributes:
        turns: longest turns of the server's event loop between two of them, in seconds.
    """

    def __init__(self, client: Robot, topic: str) -> None:
        self.turns: list[float] = []
        self._send, self._receive = anyio.create_memory_object_stream[tuple[float, float]](1000)
        client.subscribe(f"/heard{topic}", self._note, LIST)

    def _note(self, message: Any) -> None:
        speed, at, turn = message.data
        self.turns.append(float(turn))
        self._send.send_nowait((float(speed), float(at)))

    async def driven(self, drive: RemotePublisher) -> float:
        """Drive until the robot hears it, and return when it did."""
        with anyio.fail_after(PATIENCE_SECONDS):
            while True:
                drive.publish({"linear": {"x": SPEED}})
                # Rejected for a moment if the end of a lease was noticed late.
                with anyio.move_on_after(RETRY_SECONDS):
                    return await self.wait(SPEED)

    async def wait(self, speed: float) -> float:
        """Return when the robot heard a speed; others before it are dropped."""
        with anyio.fail_after(PATIENCE_SECONDS):
            while True:
                heard, at = await self._receive.receive()
                if heard == speed:
                    return at


async def measure(url: str, stops: int, leases: int) -> dict[str, list[float]]:
    """Return the sorted latencies in seconds."""
    found: dict[str, list[float]] = {STOP: [], LEASE: []}
    async with connect(url, headers={"Authorization": f"Bearer {TOKEN}"}, timeout=PATIENCE_SECONDS) as client:
        stopped, leased = Heard(client, "/stopped"), Heard(client, "/leased")
        drive = client.advertise("/stopped", TWIST)
        await client.call("/gate/release_stop", {}, "rwt_gate_msgs/Stop")  # The subscriptions are there.
        for _ in range(stops):
            await stopped.driven(drive)
            began = time.monotonic()
            await client.call("/gate/stop", {}, "rwt_gate_msgs/Stop")
            found[STOP].append(await stopped.wait(0.0) - began)
            await client.call("/gate/release_stop", {}, "rwt_gate_msgs/Stop")
            drive.publish({})  # The stop message: else the gate waits for a second of silence.
        drive = client.advertise("/leased", TWIST)
        for _ in range(leases):
            ends = await leased.driven(drive) + LEASE_SECONDS
            found[LEASE].append(max(0.0, await leased.wait(0.0) - ends))
    found[TURN] = stopped.turns[1:] + leased.turns
    return {name: sorted(values) for name, values in found.items()}


@contextmanager
def attackers(server: Server, number: int) -> Iterator[None]:
    """Attack the server meanwhile; prints at the end what each attacker sent."""
    if not number:
        yield
        return
    command = [sys.executable, "-m", "bench.gate.attackers", server.host, str(server.port), str(number)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(SETTLE_SECONDS)
        try:
            yield
        finally:
            process.stdin.close()
            sys.stderr.write(process.stdout.read())


def run(stops: int, leases: int, number: int, nice: int) -> dict[str, list[float]]:
    """Measure one server with that many attackers."""
    with tempfile.TemporaryDirectory() as folder:
        server = Server("this server", [str(ROBOT), folder], quiet=True)
        try:
            os.setpriority(os.PRIO_PROCESS, server.pid, nice)
            with attackers(server, number):
                os.setpriority(os.PRIO_PROCESS, 0, nice)  # Not of the attackers.
                return anyio.run(measure, f"ws://{server.host}:{server.port}", stops, leases)
        finally:
            os.setpriority(os.PRIO_PROCESS, 0, 0)
            server.stop()


def table(results: Mapping[int, Mapping[str, Sequence[float]]]) -> str:
    """Return the results, by number of attackers, as a table in Markdown."""
    lines = ["| | attackers | p50 | p99 | max |", "|---|---:|---:|---:|---:|"]
    for name in next(iter(results.values())):
        for number, found in results.items():
            values = found[name]
            chosen = (
                values[len(values) // 2],
                values[min(len(values) - 1, len(values) * 99 // 100)],
                values[-1],
            )
            cells = " | ".join(f"{1000 * each:.1f} ms" for each in chosen)
            lines.append(f"| {name} | {number} | {cells} |")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure without attackers and with them."""
    parser = argparse.ArgumentParser(prog="python -m bench.gate", description=__doc__)
    parser.add_argument("--stops", type=int, default=STOPS, help=f"emergency stops (default {STOPS})")
    parser.add_argument("--leases", type=int, default=LEASES, help=f"ends of a lease (default {LEASES})")
    parser.add_argument("--attackers", type=int, default=ATTACKERS, help=f"default {ATTACKERS}")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write every latency to FILE")
    parser.add_argument(
        "--nice",
        type=int,
        default=0,
        help="priority of server and operator: -15 (as root) on a machine that other programs use",
    )
    options = parser.parse_args(argv)
    results = {
        number: run(options.stops, options.leases, number, options.nice) for number in (0, options.attackers)
    }
    print(table(results))
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ServerFailed as error:
        sys.exit(f"bench: {error}")
