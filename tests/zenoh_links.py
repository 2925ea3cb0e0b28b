"""Zenoh on loopback for tests: free ports, and a way to wait until everything on a link has arrived."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path

import anyio
import zenoh

from rwt.extensions.zenoh import ZenohGraph
from tests.processes import free_port
from tests.waiting import PATIENCE

#: Where tests need not wait for peers to turn up.
QUICK = Path(__file__).parent / "quick.zenoh.json5"


def free_endpoint() -> str:
    """An endpoint on loopback without a listener."""
    return f"tcp/127.0.0.1:{free_port()}"


class Counting:
    """Counts what is handed over to a graph's thread, the ripples of its own measuring left out."""

    def __init__(self, graph: ZenohGraph) -> None:
        self.count = 0
        self._run = graph.run_on_graph
        graph.run_on_graph = self._run_on_graph  # type: ignore[method-assign]  # wrapped, to count the calls of links

    def _run_on_graph(self, call: Callable[[], None]) -> None:
        self.count += 1
        self._run(call)


class Ripple:
    """Sends a mark over the link after everything else, there and back, until nothing moves any more.

    Links keep the order of what is sent, so what was sent before a mark has arrived when the mark has. Needs
    graphs whose inlets are prompt, for those that are not have a queue of their own.
    """

    def __init__(self, graphs: tuple[ZenohGraph, ZenohGraph], counts: tuple[Counting, Counting]) -> None:
        self._graphs = graphs
        self._counts = counts
        self._arrived = [anyio.Event(), anyio.Event()]
        self._subscribers: list[object] = []

    async def start(self) -> None:
        """Listen for marks on both sides, and wait until each hears the other's."""
        for side in (0, 1):
            handler = zenoh.handlers.Callback(partial(self._on_mark, side), indirect=False)
            self._subscribers.append(
                session_of(self._graphs[side]).declare_subscriber(f"@mark/{side}", handler)
            )
        for side in (0, 1):
            with anyio.fail_after(PATIENCE):
                while not self._arrived[side].is_set():
                    session_of(self._graphs[1 - side]).put(f"@mark/{side}", b"")
                    await anyio.sleep(0.002)

    def _on_mark(self, side: int, _sample: zenoh.Sample) -> None:
        # Past the counting one.
        ZenohGraph.run_on_graph(self._graphs[side], lambda: self._arrived[side].set())

    async def _pass(self, side: int) -> None:
        self._arrived[side] = anyio.Event()
        session_of(self._graphs[1 - side]).put(f"@mark/{side}", b"")
        with anyio.fail_after(PATIENCE):
            await self._arrived[side].wait()

    async def settle(self) -> None:
        """Return when nothing has been handed over for two rounds."""
        quiet = 0
        while quiet < 2:
            before = [count.count for count in self._counts]
            await anyio.wait_all_tasks_blocked()
            for side in (0, 1):
                await self._pass(side)
            await anyio.wait_all_tasks_blocked()
            quiet = quiet + 1 if before == [count.count for count in self._counts] else 0


def session_of(graph: ZenohGraph) -> zenoh.Session:
    """The open session of a graph that runs."""
    assert graph.link is not None
    return graph.link.session


Settle = Callable[[], Awaitable[None]]
