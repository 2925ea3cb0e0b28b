"""`python -m bench.fleet.node_killed`: how long robots are gone when one of a hub's nodes dies.

Robots dial in as `rwt serve` does, spread over three nodes, with the other nodes as alternatives. One node is
killed by SIGKILL, or stopped by SIGSTOP (`--silent`), so that nothing ends its connections. Printed are the
times until its robots have dialled in elsewhere, and until clients of another node, who connect again ten
times a second, reach them.
"""

from __future__ import annotations

import argparse
import os
import signal
import statistics
import sys
import time
from collections.abc import Sequence
from contextlib import AsyncExitStack, ExitStack
from typing import Final

import anyio
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from bench.network.hub import Part, started
from rwt.extensions.hub.uplink.dial import UplinkStatus, dial
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from tests.waiting import until

NODES: Final = 3
KILLED: Final = 1
"""The directories of the others meet at the first node."""
PATIENCE: Final = 60.0


class Robot(Endpoint):
    """End of a client at a robot, which says nothing."""

    def receive(self, data: bytes, binary: bool) -> None:
        """Ignore a message."""

    def closed(self, code: int, reason: str) -> None:
        """Ignore the end."""


def accept(sink: Sink, info: PeerInfo) -> Endpoint:
    return Robot()


async def served_again(status: UplinkStatus, old: str, began: float, times: list[float]) -> None:
    """Add the time until a robot has dialled in at another node."""
    await until(lambda: status.connected and status.url != old)
    times.append(time.monotonic() - began)


async def reached_again(link: ClientConnection, url: str, began: float, times: list[float]) -> None:
    """Add the time until the client of an ended connection reaches its robot."""
    await link.wait_closed()
    while True:
        try:
            async with connect(url, ping_interval=None):
                times.append(time.monotonic() - began)
                return
        except (OSError, WebSocketException):
            await anyio.sleep(0.1)


async def measure(nodes: Sequence[Part], robots: int, clients: int, *, silent: bool) -> None:
    """Print the times for one death."""
    urls = [node.url for node in nodes]
    async with AsyncExitStack() as stack:
        statuses: list[UplinkStatus] = []
        for number in range(robots):
            at = [urls[(number + turn) % NODES] for turn in range(NODES)]
            dialled = dial(",".join(f"{url}/robots/robot{number}" for url in at), accept)
            statuses.append(await stack.enter_async_context(dialled))
        await until(lambda: all(status.connected for status in statuses))
        lost = range(KILLED, robots, NODES)
        await anyio.sleep(1.0)  # Until the first node lists them.
        links = {}
        for number in lost[:clients]:
            url = f"{urls[0]}/robot{number}"
            links[url] = await stack.enter_async_context(connect(url, ping_interval=None))
        served: list[float] = []
        reached: list[float] = []
        os.kill(nodes[KILLED].pid, signal.SIGSTOP if silent else signal.SIGKILL)
        began = time.monotonic()
        with anyio.fail_after(PATIENCE):
            async with anyio.create_task_group() as tasks:
                for number in lost:
                    status = statuses[number]
                    tasks.start_soon(served_again, status, status.url, began, served)
                for url, link in links.items():
                    tasks.start_soon(reached_again, link, url, began, reached)
        print(f"| robots | {summary(served)} |\n| clients | {summary(reached)} |")


def summary(times: list[float]) -> str:
    """Return number, median, 99th percentile and maximum as cells of a table, in seconds."""
    p99 = statistics.quantiles(times, n=100, method="inclusive")[98]
    return f"{len(times)} | {statistics.median(times):.2f} | {p99:.2f} | {max(times):.2f}"


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.fleet.node_killed", description=__doc__)
    parser.add_argument("--robots", type=int, default=300, metavar="N", help="of all nodes (default 300)")
    parser.add_argument("--clients", type=int, default=20, metavar="N", help="of its robots (default 20)")
    parser.add_argument("--silent", action="store_true", help="stop the node instead of killing it")
    options = parser.parse_args(argv)
    with ExitStack() as stack:
        nodes = started(NODES, stack)
        time.sleep(2.0)
        try:
            print("| of the node | number | p50 s | p99 s | most s |\n|---|---:|---:|---:|---:|")
            anyio.run(lambda: measure(nodes, options.robots, options.clients, silent=options.silent))
        finally:
            os.kill(nodes[KILLED].pid, signal.SIGKILL)
    return 0


if __name__ == "__main__":
    sys.exit(main())
