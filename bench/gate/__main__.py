"""Latency of the gate's stops, with attackers and without: `python -m bench.gate --over all`.

An emergency stop is timed from before an operator's program sends `/gate/stop` until the
robot's callback has the stop message; a dead-man's stop from the end of the lease; an approval from before it
is sent until the robot's callback has the call. Attackers have a role that may publish, advertise, call and
provide everything, but not stop. The longest turn is CPU time of the event loop's thread between two polls:
other programs do not add to it. Prints a table in Markdown, with p50, p99 and maximum of each.

A second table is about floods of frames that look like presses of the stop (:mod:`bench.gate.floods`), over
the gateway that the operator uses: how long the operator's stop takes, and how long an ordinary client waits
for the answer of a service meanwhile.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import anyio

from bench.gate.floods import GATEWAYS
from bench.gate.operators import OVER, PATIENCE_SECONDS, TOKENLESS, Operator
from bench.gate.robot import ASKER_TOKEN, LEASE_SECONDS, LIST, TOKEN, URLS
from bench.traffic.processes import Server, ServerFailed
from rwt_client import Robot, connect

STOP, LEASE, APPROVAL = "emergency stop", "dead-man's stop", "approval"
ORDINARY = "call of an ordinary client"
TURN = "longest turn (CPU time) between commands"
STOPS = 200
LEASES = 100
APPROVALS = 50
ATTACKERS = 10
FLOODS = 1, 8, 40, 200
FLOODS_OF_PROCESS = 50
"""Connections of one process that floods."""
ORDINARY_SECONDS = 0.02
"""Pause between two calls of an ordinary client."""
SETTLE_SECONDS = 2.0
"""Time for the attackers to fill every queue and quota."""
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

    async def driven(self, operator: Operator, topic: str) -> float:
        """Drive until the robot hears it, and return when it did."""
        with anyio.fail_after(PATIENCE_SECONDS):
            while True:
                await operator.publish(topic, SPEED)
                # Rejected for a moment if the end of a lease was noticed late.
                with anyio.move_on_after(RETRY_SECONDS):
                    return await self.wait(SPEED)

    async def stop(self, operator: Operator, topic: str) -> float:
        """Drive, press the emergency stop and release it; return the latency of the stop."""
        await self.driven(operator, topic)
        began = time.monotonic()
        await operator.call("stop", {})
        latency = await self.wait(0.0) - began
        await operator.call("release_stop", {})
        await operator.publish(topic, 0.0)  # Else the gate waits for a second of silence.
        return latency

    async def wait(self, speed: float) -> float:
        """Return when the robot heard a speed; others before it are dropped."""
        with anyio.fail_after(PATIENCE_SECONDS):
            while True:
                heard, at = await self._receive.receive()
                if heard == speed:
                    return at


class Asked:
    """Calls of a client whose role requires approval, and what the robot hears of them."""

    def __init__(self, client: Robot, asker: Robot) -> None:
        self._asker = asker
        self._ids = anyio.create_memory_object_stream[str](1000)
        self._done = anyio.create_memory_object_stream[float](1000)
        self._seen: set[str] = set()
        client.subscribe("/gate/approvals", self._note, "rwt_gate_msgs/Approvals")
        client.subscribe("/heard/confirm", lambda heard: self._done[0].send_nowait(heard.data[0]), LIST)

    def _note(self, message: Any) -> None:
        for each in message.approvals:
            if each.role == "asker" and each.id not in self._seen:
                self._seen.add(each.id)
                self._ids[0].send_nowait(each.id)

    async def approved(self, operator: Operator) -> float:
        """Call a service, approve it, and return the latency."""
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(self._asker.call, "/confirm", {}, "std_srvs/Trigger")
            with anyio.fail_after(PATIENCE_SECONDS):
                id = await self._ids[1].receive()
                began = time.monotonic()
                await operator.call("approve", {"id": id, "approve": True, "seconds": 0.0})
                return await self._done[1].receive() - began
        raise AssertionError  # Not reached.


async def measure(urls: Mapping[str, str], over: str, options: argparse.Namespace) -> dict[str, list[float]]:
    """Return the sorted latencies in seconds of an operator over one of :data:`OVER`."""
    found: dict[str, list[float]] = {STOP: [], LEASE: [], APPROVAL: []}
    url = urls["ws"]
    connecting = (
        connect(f"{url}?token={token}", timeout=PATIENCE_SECONDS, status_level="error")
        for token in (TOKEN, ASKER_TOKEN)
    )
    async with (
        next(connecting) as client,
        next(connecting) as asker,
        OVER[over](urls, client) as operator,
    ):
        stopped, leased, asked = Heard(client, "/stopped"), Heard(client, "/leased"), Asked(client, asker)
        await operator.call("release_stop", {})  # The subscriptions are there.
        found[STOP] += [await stopped.stop(operator, "/stopped") for _ in range(options.stops)]
        for _ in range(options.leases if operator.drives else 0):
            ends = await leased.driven(operator, "/leased") + LEASE_SECONDS
            found[LEASE].append(max(0.0, await leased.wait(0.0) - ends))
        for _ in range(0 if over in TOKENLESS else options.approvals):
            found[APPROVAL].append(await asked.approved(operator))
    found[TURN] = stopped.turns[1:] + leased.turns
    return {name: sorted(values) for name, values in found.items() if values}


async def measure_flooded(
    urls: Mapping[str, str], over: str, options: argparse.Namespace
) -> dict[str, list[float]]:
    """Return the sorted latencies in seconds of an operator's stops, and of an ordinary client's calls."""
    found: dict[str, list[float]] = {STOP: [], ORDINARY: []}
    url = f"{urls['ws']}?token={TOKEN}"
    async with (
        connect(url, timeout=PATIENCE_SECONDS, status_level="error") as client,
        connect(url, timeout=PATIENCE_SECONDS, status_level="error") as ordinary,
        OVER[over](urls, client) as operator,
        anyio.create_task_group() as tasks,
    ):

        async def call() -> None:
            while True:
                began = time.monotonic()
                await ordinary.call("/rosapi/get_time")
                found[ORDINARY].append(time.monotonic() - began)
                await anyio.sleep(ORDINARY_SECONDS)

        stopped = Heard(client, "/stopped")
        await operator.call("release_stop", {})  # The subscriptions are there.
        tasks.start_soon(call)
        found[STOP] += [await stopped.stop(operator, "/stopped") for _ in range(options.stops)]
        tasks.cancel_scope.cancel()
    found[TURN] = stopped.turns[1:]
    return {name: sorted(values) for name, values in found.items() if values}


@contextmanager
def attackers(server: Server, number: int) -> Iterator[None]:
    """Attack the server meanwhile; prints at the end what each attacker sent."""
    commands = [["bench.gate.attackers", server.host, str(server.port), str(number)]] if number else []
    with running(commands):
        yield


@contextmanager
def flood_of(over: str, server: Server, number: int) -> Iterator[None]:
    """Flood the gateway that an operator uses over a number of connections meanwhile."""
    gateway = over if over in GATEWAYS else "rosbridge"
    firsts = range(0, number, FLOODS_OF_PROCESS)
    counts = (min(FLOODS_OF_PROCESS, number - first) for first in firsts)
    address = ["bench.gate.floods", gateway, server.host, str(server.port)]
    with running([[*address, str(first), str(count)] for first, count in zip(firsts, counts, strict=True)]):
        yield


@contextmanager
def running(commands: Iterable[Sequence[str]]) -> Iterator[None]:
    """Run modules that attack until their input ends, and print their reports at the end."""
    pipe = subprocess.PIPE
    processes = [
        subprocess.Popen([sys.executable, "-m", *command], stdin=pipe, stdout=pipe, text=True)
        for command in commands
    ]
    for process in processes:
        assert process.stdout is not None
        process.stdout.readline()
    time.sleep(SETTLE_SECONDS if processes else 0.0)
    try:
        yield
    finally:
        for process in processes:
            report, _ = process.communicate()
            sys.stderr.write(report)


Attack = Callable[[Server, int], AbstractContextManager[None]]
Measure = Callable[[Mapping[str, str], str, argparse.Namespace], Awaitable[dict[str, list[float]]]]


def run(
    options: argparse.Namespace, over: str, number: int, attack: Attack, measure: Measure
) -> dict[str, list[float]]:
    """Measure one server with that many attackers, or connections of a flood."""
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        hub = []
        if over == "hub":
            relay = Server("hub", ["-m", "rwt.cli", "hub", "ws://127.0.0.1:0"], quiet=True)
            stack.callback(relay.stop)
            os.setpriority(os.PRIO_PROCESS, relay.pid, options.nice)
            hub = [f"ws://{relay.host}:{relay.port}"]
        server = Server("this server", ["-m", "bench.gate.robot", folder, *hub], quiet=True)
        stack.callback(server.stop)
        stack.callback(os.setpriority, os.PRIO_PROCESS, 0, 0)
        os.setpriority(os.PRIO_PROCESS, server.pid, options.nice)
        urls = {**json.loads((Path(folder) / URLS).read_text(encoding="utf-8")), "hub": "".join(hub)}
        stack.enter_context(attack(server, number))
        os.setpriority(os.PRIO_PROCESS, 0, options.nice)  # Not of the attackers.
        return anyio.run(measure, urls, over, options)


Results = Iterable[tuple[str, Mapping[int, Mapping[str, Sequence[float]]]]]


def table(
    results: Results,
    *numbers: int,
    names: Sequence[str] = (STOP, LEASE, APPROVAL, TURN),
    of: str = "attackers",
) -> Iterator[str]:
    """Yield the lines of a table in Markdown of the results, by operator and number of attackers."""
    columns = [(name, number) for name in names for number in numbers]
    yield f"| ms: p50 / p99 / max | {' | '.join(f'{name}, {number} {of}' for name, number in columns)} |"
    yield f"|---|{'---:|' * len(columns)}"
    for over, found in results:
        cells = (_summary(found[number].get(name, ())) for name, number in columns)
        yield f"| {over} | {' | '.join(cells)} |"


def _summary(values: Sequence[float]) -> str:
    if not values:
        return "-"
    chosen = values[len(values) // 2], values[min(len(values) - 1, len(values) * 99 // 100)], values[-1]
    return " / ".join(f"{1000 * each:.1f}" for each in chosen)


def main(argv: Sequence[str] | None = None) -> int:
    """Measure without attackers and with them."""
    parser = argparse.ArgumentParser(prog="python -m bench.gate", description=__doc__)
    parser.add_argument("--stops", type=int, default=STOPS, help=f"emergency stops (default {STOPS})")
    parser.add_argument("--leases", type=int, default=LEASES, help=f"ends of a lease (default {LEASES})")
    parser.add_argument("--approvals", type=int, default=APPROVALS, help=f"approvals (default {APPROVALS})")
    parser.add_argument(
        "--over",
        nargs="+",
        choices=(*OVER, "all"),
        default=["websocket"],
        metavar="NAME",
        help=f"what the operator uses: {', '.join(OVER)}, or all (default websocket)",
    )
    parser.add_argument(
        "--attackers", type=int, default=ATTACKERS, help=f"default {ATTACKERS}; 0: only the second table"
    )
    parser.add_argument(
        "--floods",
        nargs="*",
        type=int,
        default=FLOODS,
        metavar="N",
        help=f"connections of each flood (default {' '.join(map(str, FLOODS))}); none: only the first table",
    )
    parser.add_argument("--json", metavar="FILE", type=Path, help="write every latency to FILE")
    parser.add_argument(
        "--nice",
        type=int,
        default=0,
        help="priority of server and operator: -15 (as root) on a machine that other programs use",
    )
    options = parser.parse_args(argv)
    numbers = 0, options.attackers
    operators = list(OVER) if "all" in options.over else options.over
    results: dict[str, dict[int, dict[str, list[float]]]] = {}
    flooded: dict[str, dict[int, dict[str, list[float]]]] = {}

    def measured() -> Results:
        for over in operators:
            results[over] = {number: run(options, over, number, attackers, measure) for number in numbers}
            yield over, results[over]

    def measured_floods() -> Results:
        for over in operators:
            attack = partial(flood_of, over)
            flooded[over] = {
                number: run(options, over, number, attack, measure_flooded) for number in options.floods
            }
            yield over, flooded[over]

    if options.attackers:
        for line in table(measured(), *numbers):
            print(line, flush=True)
    if options.floods:
        print()
        columns = STOP, ORDINARY, TURN
        for line in table(measured_floods(), *options.floods, names=columns, of="flooding connections"):
            print(line, flush=True)
    if options.json:
        options.json.write_text(
            json.dumps({"attacks": results, "floods": flooded}, indent=2) + "\n", encoding="utf-8"
        )
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ServerFailed as error:
        sys.exit(f"bench: {error}")
