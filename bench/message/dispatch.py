"""CPU time of a message in the bridge alone, from bytes to frames, without a network.

A publish goes to one subscriber; a call to a service of a node in the same process, or to one that another
client offers and answers. `one` is a message in each read of the connection, `16` are sixteen messages in one
read. Rounds of both checkouts take turns, and what is compared is the best of each: other work on the machine
makes rounds longer, never shorter.

Example: python -m bench.message.dispatch --against ../before
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import islice, repeat
from pathlib import Path
from typing import Final

from rwt import Settings
from rwt.rosbridge import Bridge
from rwt_graph import Node, SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.registry import Registry
from rwt_protocol.frames import Burst, Frame
from rwt_transports.endpoint import AS_MANY_AS_FIT, DropReason, Endpoint, FlowRules, PeerInfo, Traffic
from rwt_transports.shared_pool import Holder

ROOT: Final = Path(__file__).parent.parent.parent
ROUNDS: Final = 15
MESSAGES: Final = 2_000
"""Of one round of each case."""

TWIST: Final = {"linear": {"x": 0.25, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": -0.5}}
OPS: Final = {
    "publish": {"op": "publish", "topic": "/cmd_vel", "type": "geometry_msgs/Twist", "msg": TWIST},
    "call": {"op": "call_service", "service": "/add_two_ints", "id": "1", "args": {"a": 1, "b": 2}},
}
CASES: Final = ("publish, one", "publish, 16", "call, one", "call, 16", "call of a client, 16")


class TurningClock(SimulatedClock):
    """Real time, with turns of an event loop when they are asked for: `advance(0.0)` is one."""

    monotonic = staticmethod(time.monotonic)


class Flow:
    """A topic's way to a client that counts what it is sent."""

    def __init__(self, client: Client) -> None:
        self._client = client

    def send(self, frame: Frame) -> None:
        """Count one frame."""
        self._client.sent += 1

    def join(self, burst: Burst) -> bool:
        """Take each frame by itself."""
        return False

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """Count some frames."""
        self._client.sent += len(pieces)

    def configure(self, rules: FlowRules) -> None:
        """No-op: frames are not queued."""

    def close(self) -> None:
        """No-op: frames are not queued."""


class Client:
    """A rosbridge client without a network, which counts the frames that it is sent.

    Attributes:
        received: bytes that have come from it; as many as reads.
        sent: frames that were sent to it.
    """

    backlog = 0
    traffic = Traffic()

    def __init__(self, bridge: Bridge) -> None:
        self.received = 0
        self.sent = 0
        self.endpoint = bridge.accept(self, PeerInfo("memory", "127.0.0.1"))

    def send(self, frame: Frame) -> None:
        """Count one frame."""
        self.sent += 1

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time.time_ns,
    ) -> Flow:
        """A way for samples."""
        return Flow(self)

    def close(self, code: int = 1000, reason: str = "") -> None:
        """A client is not closed here, unless something is wrong."""
        raise RuntimeError(reason)

    def count_for(self, holder: Holder) -> None:
        """No-op: there is no pool of connections."""

    def hand_over(self, endpoint: Endpoint) -> None:
        """No-op: clients do not authenticate."""

    def say(self, op: Mapping[str, object]) -> None:
        """Send one op, in a read of its own."""
        self.received += 1
        self.endpoint.receive(json.dumps(op).encode(), False)


class Provider:
    """A client that offers the service, and the answers to what it will be asked.

    Attributes:
        client: the client.
    """

    def __init__(self, bridge: Bridge) -> None:
        self.client = Client(bridge)
        service = str(OPS["call"]["service"])
        self.client.say(
            {"op": "advertise_service", "service": service, "type": "example_interfaces/AddTwoInts"}
        )
        self._asked = 0
        self._answers = iter(
            [
                json.dumps(
                    {
                        "op": "service_response",
                        "id": f"service_request:{service}:{number}",
                        "service": service,
                        "values": {"sum": 3},
                        "result": True,
                    }
                ).encode()
                for number in range(1, 2 * MESSAGES + 1)
            ]
        )

    def answer(self, clock: TurningClock) -> None:
        """Answer sixteen calls, in one read."""
        self._asked += 16
        while self.client.sent < self._asked:  # On a busy machine some wait for a turn.
            clock.advance(0.0)
        self.client.received += 1
        for answer in islice(self._answers, 16):
            self.client.endpoint.receive(answer, False)


def spent(
    clock: TurningClock,
    client: Client,
    receiver: Client,
    message: bytes,
    in_a_read: int,
    provider: Provider | None = None,
) -> float:
    """Microseconds of CPU time for one message of which `receiver` is sent one frame, in turns of sixteen."""
    receive, before = client.endpoint.receive, receiver.sent
    begin = time.process_time()
    for _ in repeat(None, MESSAGES // 16):
        for _ in repeat(None, 16 // in_a_read):
            client.received += 1
            for _ in repeat(None, in_a_read):
                receive(message, False)
        if provider is not None:
            provider.answer(clock)
        clock.advance(0.0)
    for _ in range(16):  # Some may wait for a turn.
        clock.advance(0.0)
    seconds = time.process_time() - begin
    if receiver.sent - before != MESSAGES:
        raise RuntimeError(f"{receiver.sent - before} of {MESSAGES} messages went out")
    return seconds / MESSAGES * 1e6


def measured(case: str) -> float:
    """Microseconds of CPU time for one message of a case, in a bridge of its own."""
    clock = TurningClock(time.time_ns())
    graph = MemoryGraph(registry=Registry(JAZZY), clock=clock)
    bridge = Bridge(graph, Settings())
    op, _, in_a_read = case.partition(", ")
    provider: Provider | None = None
    if op == "call":
        node = Node(graph, "adder")
        node.advertise_service(
            "/add_two_ints", "example_interfaces/AddTwoInts", lambda request: {"sum": request.a + request.b}
        )
    elif op == "call of a client":
        provider = Provider(bridge)
    client = receiver = Client(bridge)
    if op == "publish":
        receiver = Client(bridge)
        receiver.say({"op": "subscribe", "topic": "/cmd_vel", "type": "geometry_msgs/Twist"})
    message = json.dumps(OPS[op.removesuffix(" of a client")]).encode()
    spent(clock, client, receiver, message, 1, provider)
    return spent(clock, client, receiver, message, 1 if in_a_read == "one" else 16, provider)


def one_round() -> dict[str, float]:
    """Each case."""
    return {case: measured(case) for case in CASES}


def in_process(checkout: Path) -> dict[str, float]:
    """One round in a process of its own, with the packages of a checkout, and its own file of this name: what
    a client without a network has to offer changes with them."""
    environment = {**os.environ, "PYTHONPATH": str(checkout / "src")}
    command = [sys.executable, str(checkout / "bench" / "message" / "dispatch.py"), "--one-round"]
    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE)
    found: dict[str, float] = json.loads(done.stdout)
    return found


def table(rounds: Mapping[str, Sequence[Mapping[str, float]]]) -> str:
    """A line for each case: the best of each checkout, and the ratio of the last to the first."""
    lines = [f"{'µs for a message':<20}" + "".join(f"{name:>10}" for name in (*rounds, "ratio"))]
    for case in CASES:
        best = [min(each[case] for each in found) for found in rounds.values()]
        lines.append(f"{case:<20}" + "".join(f"{each:10.2f}" for each in (*best, best[-1] / best[0])))
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Print what a message costs."""
    parser = argparse.ArgumentParser(prog="python -m bench.message.dispatch", description=__doc__)
    parser.add_argument("--against", metavar="DIR", type=Path, help="another checkout, to compare with")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"of each checkout (default {ROUNDS})")
    parser.add_argument("--one-round", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.one_round:
        print(json.dumps(one_round()))
        return 0
    checkouts = {"before": options.against, "now": ROOT} if options.against else {"now": ROOT}
    rounds: dict[str, list[dict[str, float]]] = {name: [] for name in checkouts}
    for _ in range(options.rounds):
        for name, checkout in checkouts.items():
            rounds[name].append(in_process(checkout.resolve()))
    print(table(rounds))
    return 0


if __name__ == "__main__":
    sys.exit(main())
