"""Shared resources of the connections of one graph, which run over the transports' drivers."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import TYPE_CHECKING, Final, TypeVar

import anyio

from rwt_graph.errors import Ros1Error
from rwt_transports.api import Attach, BindAddress
from rwt_transports.connection import ListenerState
from rwt_transports.scheduler import READING, Scheduler
from rwt_transports.schemes import stream_driver
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

if TYPE_CHECKING:
    from rwt_graph.backend import DistributedGraph

T = TypeVar("T")


class Unreachable(Ros1Error):
    """Nothing accepts connections at the address of another program: it has ended."""


#: Maximum bytes of incomplete frames, and of incomplete calls, of all connections.
_FRAMES_BYTES: Final = 192 * 1024 * 1024
_CALLS_BYTES: Final = 32 * 1024 * 1024


class Network:
    """Shared state of the connections of one graph.

    Attributes:
        spawn: starts a task on the graph's event loop.
        frames: receive buffers of TCPROS.
        calls: limit on incomplete calls over XML-RPC.
        calling: bytes of large calls that are being answered.
        scheduler: scheduler of the handling of frames.
    """

    def __init__(self, graph: DistributedGraph) -> None:
        self.spawn = graph.spawn
        self._graph = graph
        self.frames = ReceiveBufferPool(_FRAMES_BYTES)
        self.calls = ReceiveBufferPool(_CALLS_BYTES)
        self.calling = 0
        self.scheduler = Scheduler.of_loop(READING)

    def in_batch(self, call: Callable[[], None]) -> None:
        """Call a function that delivers what other programs sent."""
        self._graph.in_batch(call)

    async def open(self, resource: AbstractAsyncContextManager[T], name: str) -> tuple[T, Callable[[], None]]:
        """Enter a context in a task of the graph; returns its value, and a function that ends it.

        Raises:
            Exception: what entering it raises.
        """
        entered, ended = anyio.Event(), anyio.Event()
        values: list[T] = []
        failures: list[Exception] = []

        async def run() -> None:
            try:
                async with resource as value:
                    values.append(value)
                    entered.set()
                    await ended.wait()
            except Exception as error:
                if entered.is_set():
                    raise
                failures.append(error)
                entered.set()

        self.spawn(run, name)
        await entered.wait()
        if failures:
            raise failures[0]
        return values[0], ended.set


@asynccontextmanager
async def listening(state: ListenerState, attach: Attach, host: str, port: int) -> AsyncIterator[int]:
    """Accept connections within the block; yields the port.

    Args:
        host: address to bind; empty for all of this host.

    Raises:
        ListenError: the address cannot be used.
    """
    address = BindAddress(host or "0.0.0.0", port, is_held_back=state.buffers.has_much_unread)
    async with stream_driver().serve(address, attach) as bound, state.serving():
        yield bound
