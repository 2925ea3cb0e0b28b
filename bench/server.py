"""The server under test: what `rwt serve` runs, with one service of a robot in the same process."""

from __future__ import annotations

import signal
from typing import Any

import anyio

from rwt.server import serve
from rwt_graph import MemoryGraph, Node
from rwt_nodes.rosapi import Rosapi


def add_two_ints(request: Any) -> dict[str, object]:
    """`request` is a Struct of a type that is known at run time only."""
    return {"sum": request.a + request.b}


async def main() -> None:
    graph = MemoryGraph()
    with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
        async with graph:
            with Rosapi(graph), Node(graph, "calculator") as node:
                node.advertise_service("/add_two_ints", "example_interfaces/AddTwoInts", add_two_ints)
                async with serve(graph, "ws://127.0.0.1:0") as server:
                    print(f"listening on {server.urls[0]}", flush=True)
                    async for _ in signals:
                        break


if __name__ == "__main__":
    anyio.run(main)
