"""Calls by which the master reports changes to nodes."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Final

import anyio

from rwt.extensions.ros1.wire import rpc
from rwt_graph.errors import Ros1Error

if TYPE_CHECKING:
    from rwt.extensions.ros1.wire.sockets import Sockets
    from rwt.extensions.ros1.wire.xmlrpc import Value

logger = logging.getLogger(__name__)

#: Maximum nodes that are called at once.
_MOST_CALLED: Final = 64

#: Maximum calls that wait, besides one for each node.
_MOST_WAITING: Final = 20_000


class Notifications:
    """Calls that wait for nodes. A newer one replaces an older one of the same method and name.

    If too many wait, the oldest of a node gives way to its newest.

    Args:
        on_deaf: called with the address of a node that takes no calls; those that wait for it are dropped.
    """

    def __init__(self, sockets: Sockets, on_deaf: Callable[[str], None]) -> None:
        self._sockets = sockets
        self._on_deaf = on_deaf
        # By address, method and name; an address stays while it is called.
        self._calls: dict[str, dict[tuple[str, str], tuple[Value, ...]]] = {}
        self._count = 0
        self._queue: deque[str] = deque()
        self._limiter = anyio.CapacityLimiter(_MOST_CALLED)

    def add(self, uri: str, method: str, name: str, *params: Value) -> None:
        """Call a node soon, after the calls that wait for it."""
        calls = self._calls.get(uri)
        if calls is None:
            calls = self._calls[uri] = {}
            self._queue_up(uri)
        self.discard(uri, method, name)
        if calls and self._count >= _MOST_WAITING:
            self.discard(uri, *next(iter(calls)))
        calls[method, name] = params
        self._count += 1

    def discard(self, uri: str, method: str, name: str) -> None:
        """Forget a call that waits; no-op if there is none."""
        if self._calls.get(uri, {}).pop((method, name), None) is not None:
            self._count -= 1

    def _queue_up(self, uri: str) -> None:
        self._queue.append(uri)
        if len(self._queue) == 1:
            self._sockets.spawn(self._run, "calls of ROS 1 nodes")

    async def _run(self) -> None:
        """Begin one call in each turn of the event loop: thousands may be due at once."""
        while self._queue:
            uri = self._queue[0]
            await self._limiter.acquire_on_behalf_of(uri)
            self._sockets.spawn(partial(self._call, uri), f"a call of {uri}")
            self._queue.popleft()

    async def _call(self, uri: str) -> None:
        """Carry out the first call of a node; the node queues for the next one."""
        calls = self._calls[uri]
        try:
            if calls:
                method, name = next(iter(calls))
                params = calls[method, name]
                self.discard(uri, method, name)
                await rpc.call(uri, method, "/master", name, *params)
        except Ros1Error as error:
            logger.info("a node does not take a notification: %s", error)
            self._count -= len(calls)
            calls.clear()
            self._on_deaf(uri)
        finally:
            self._limiter.release_on_behalf_of(uri)
        if calls:
            self._queue_up(uri)
        else:
            del self._calls[uri]
