"""Wake-ups of the event loop by ROS 2, without polling and without a thread per endpoint.

The middleware calls `eventfd_write` itself when a sample arrives, on its own thread and without the GIL. The
descriptors of all endpoints are in one epoll set, whose descriptor the event loop watches. Beyond a number of
endpoints, several share a descriptor, so that the topics of clients do not use up those of the process.

One thread waits for changes of the ROS graph, which have no such callback. It also waits for the endpoints of
middlewares that do not support the callback.
"""

from __future__ import annotations

import asyncio
import ctypes
import logging
import math
import os
import select
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any, Generic, Literal, TypeVar

import anyio
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from rwt.extensions.ros2.ament import library
from rwt.extensions.ros2.rcl import rcutils
from rwt_graph.backend import DistributedGraph
from rwt_graph.errors import Ros2Error

logger = logging.getLogger(__name__)

T = TypeVar("T")

Kind = Literal["subscription", "client", "service"]

#: rcl's function that sets the callback of an endpoint.
SETTERS: dict[Kind, str] = {
    "subscription": "rcl_subscription_set_on_new_message_callback",
    "client": "rcl_client_set_on_new_response_callback",
    "service": "rcl_service_set_on_new_request_callback",
}

#: Maximum samples, requests or responses of one endpoint per turn, so that a flood does not block the event
#: loop.
_BATCH = 64

#: Time after which a turn takes at most one from each further endpoint, in seconds. Clients get what a turn
#: has taken at its end: without a limit, ten large messages that were waiting arrive with the last one.
_TURN_SECONDS = 0.005

#: Maximum descriptors of one graph.
MOST_DESCRIPTORS = 256

#: Minimum interval between two readings of the ROS graph, in seconds: many endpoints change at once.
_GRAPH_INTERVAL = 0.05

#: Timeout of the thread's end, in seconds.
_JOIN_SECONDS = 2.0


def load_rcl() -> ctypes.CDLL:
    """Return the library rcl, with the functions that `rclpy` does not offer."""
    rcl = ctypes.CDLL(library("librcl.so"))
    pointer = ctypes.c_void_p
    rcl.rcl_node_get_graph_guard_condition.restype = pointer
    rcl.rcl_node_get_graph_guard_condition.argtypes = (pointer,)
    rcl.rcl_wait_set_add_guard_condition.argtypes = (pointer, pointer, pointer)
    for name in SETTERS.values():
        getattr(rcl, name).argtypes = (pointer, pointer, pointer)
    return rcl


class Wakeup:
    """Notification of one endpoint.

    Args:
        drain: takes what has arrived until a time of `time.monotonic`, on the graph's thread; returns True if
            more may be waiting.
        descriptor: of an eventfd, which others may share.
    """

    __slots__ = ("_clear", "descriptor", "drain", "endpoint", "kind")

    def __init__(self, kind: Kind, endpoint: Any, drain: Callable[[float], bool], descriptor: int) -> None:
        self.kind = kind
        self.endpoint = endpoint
        self.drain = drain
        self.descriptor = descriptor
        self._clear: Callable[[], object] | None = None

    def set_callback(self, rcl: ctypes.CDLL) -> bool:
        """Let the middleware write to the descriptor; returns False if it does not support that."""
        setter = getattr(rcl, SETTERS[self.kind])
        pointer = self.endpoint.pointer
        # The C function itself is the callback, called with the descriptor and the number of events.
        write = ctypes.cast(ctypes.CDLL(None).eventfd_write, ctypes.c_void_p)
        if setter(pointer, write, self.descriptor) != 0:
            rcutils().rcutils_reset_error()
            return False
        self._clear = partial(setter, pointer, None, None)
        return True

    def close(self) -> None:
        """End the callback, before its descriptor is closed: the number may be used again at once."""
        if self._clear is not None:
            self._clear()


class Inbox(Generic[T]):
    """Samples, requests or responses of one endpoint, which are taken on the graph's thread.

    Args:
        take: takes the next one; returns None if none is waiting.
        handle: called with each.
    """

    def __init__(
        self,
        wakeups: Wakeups,
        kind: Kind,
        endpoint: Any,
        take: Callable[[], T | None],
        handle: Callable[[T], None],
    ) -> None:
        self.is_closed = False
        self._take = take
        self._handle = handle
        self._wakeups = wakeups
        self._wakeup = wakeups.add(kind, endpoint, self.drain)

    def drain(self, until: float) -> bool:
        """Handle what is waiting, for one turn; returns True if more may be waiting."""
        return self.take(_BATCH, until)

    def take(self, most: int, until: float = math.inf) -> bool:
        """Handle what is waiting, at least one; returns True if it has stopped at a limit."""
        for _ in range(most):
            taken = self._take()
            if taken is None:
                return False
            self._handle(taken)
            if self.is_closed:
                return False
            if time.monotonic() >= until:
                return True
        return True

    def close(self) -> None:
        """Take nothing more, and destroy the endpoint; no-op if it is closed."""
        if not self.is_closed:
            self.is_closed = True
            self._wakeups.remove(self._wakeup)
            self._wakeup.endpoint.destroy_when_not_in_use()


class Wakeups:
    """All notifications of one graph.

    Args:
        graph: graph whose event loop is woken.
        context: context of `rclpy`.
        node: node whose view of the ROS graph is watched.
        on_graph_change: called on the thread, after a change of the ROS graph.
        use_callbacks: False to wait for every endpoint in the thread.
    """

    def __init__(
        self,
        graph: DistributedGraph,
        context: Any,
        node: Any,
        on_graph_change: Callable[[], None],
        *,
        use_callbacks: bool = True,
    ) -> None:
        self._graph = graph
        self._context = context
        self._on_graph_change = on_graph_change
        self._use_callbacks = use_callbacks
        self._rcl = load_rcl()
        self._graph_guard = self._rcl.rcl_node_get_graph_guard_condition(node.pointer)
        self._epoll = select.epoll()
        # By descriptor.
        self._wakeups: dict[int, list[Wakeup]] = {}
        # Endpoints without callbacks: all of them, and those that wait for a sample; the others are drained.
        self._polled: set[Wakeup] = set()
        self._armed: set[Wakeup] = set()
        self._lock = threading.Lock()
        self._guard = _rclpy.GuardCondition(context.handle)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ros2 graph", daemon=True)

    def start(self) -> None:
        """Watch the descriptors from the running event loop, and start the thread."""
        try:
            asyncio.get_running_loop().add_reader(self._epoll.fileno(), self._drain_batch)
        except RuntimeError:
            self._graph.spawn(self._watch, "wake-ups by ROS 2")  # On trio.
        self._thread.start()

    async def _watch(self) -> None:
        while not self._closing.is_set():
            await anyio.wait_readable(self._epoll.fileno())
            self._drain()

    def add(self, kind: Kind, endpoint: Any, drain: Callable[[float], bool]) -> Wakeup:
        """Call `drain` on the graph's thread whenever something has arrived at an endpoint."""
        wakeup = Wakeup(kind, endpoint, drain, self._descriptor())
        self._wakeups[wakeup.descriptor].append(wakeup)
        if not (self._use_callbacks and wakeup.set_callback(self._rcl)):
            self._polled.add(wakeup)
            self._arm(wakeup)
        return wakeup

    def _descriptor(self) -> int:
        """Return a new descriptor, or the one with the fewest endpoints."""
        if len(self._wakeups) >= MOST_DESCRIPTORS:
            return min(self._wakeups, key=lambda each: len(self._wakeups[each]))
        descriptor = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._wakeups[descriptor] = []
        # By edges, so that nothing has to be read from the descriptor: its counter never ends.
        self._epoll.register(descriptor, select.EPOLLIN | select.EPOLLET)
        return descriptor

    def remove(self, wakeup: Wakeup) -> None:
        """End the notifications of an endpoint, before the endpoint is destroyed."""
        if wakeup in self._polled:
            self._polled.remove(wakeup)
            with self._lock:
                self._armed.discard(wakeup)
            self._guard.trigger_guard_condition()
        wakeup.close()
        sharing = self._wakeups[wakeup.descriptor]
        sharing.remove(wakeup)
        if not sharing:
            del self._wakeups[wakeup.descriptor]
            self._epoll.unregister(wakeup.descriptor)
            os.close(wakeup.descriptor)

    def _arm(self, wakeup: Wakeup) -> None:
        with self._lock:
            self._armed.add(wakeup)
        self._guard.trigger_guard_condition()

    def _drain_batch(self) -> None:
        self._graph.in_batch(self._drain)

    def _drain(self) -> None:
        ready = [wakeup for descriptor, _ in self._epoll.poll(0) for wakeup in self._wakeups[descriptor]]
        if len(ready) > 1:
            # A goal's feedback before its result, which is a response.
            ready.sort(key=_is_of_call)
        until = time.monotonic() + _TURN_SECONDS
        for wakeup in ready:
            descriptor = wakeup.descriptor
            if wakeup not in self._wakeups.get(descriptor, ()):
                continue  # Removed by an earlier one of this turn.
            try:
                more = wakeup.drain(until)
            except Exception:
                logger.exception("an endpoint of ROS 2 failed")
                more = False
            if wakeup not in self._wakeups.get(descriptor, ()):
                continue
            if more:
                os.eventfd_write(descriptor, 1)
            elif wakeup in self._polled:
                self._arm(wakeup)

    # The thread

    def _run(self) -> None:
        changed = True
        while not self._closing.is_set():
            if changed:
                try:
                    self._on_graph_change()
                except Exception:
                    logger.exception("the ROS graph could not be read; it is read again on its next change")
                self._closing.wait(_GRAPH_INTERVAL)
            changed = self._wait()

    def _wait(self) -> bool:
        """Wait for the graph or an endpoint; return True if the graph has changed."""
        with self._lock:
            armed = tuple(self._armed)
        with ExitStack() as used:
            waiting: list[tuple[Wakeup, int]] = []
            for wakeup in armed:
                with suppress(
                    _rclpy.InvalidHandle
                ):  # Destroyed meanwhile; its removal has triggered the guard.
                    used.enter_context(wakeup.endpoint)  # Not destroyed while it is in use.
                    waiting.append((wakeup, wakeup.endpoint.pointer))
            waits = self._wait_set([wakeup for wakeup, _ in waiting])
            waits.wait(-1)
            ready = {pointer for kind in SETTERS for pointer in waits.get_ready_entities(kind)}
            with self._lock:
                for wakeup, pointer in waiting:
                    # Only a wake-up that is still armed has an open descriptor.
                    if pointer in ready and wakeup in self._armed:
                        self._armed.remove(wakeup)
                        os.eventfd_write(wakeup.descriptor, 1)
        return self._graph_guard in waits.get_ready_entities("guard_condition")

    def _wait_set(self, wakeups: list[Wakeup]) -> Any:
        kinds = [wakeup.kind for wakeup in wakeups]
        waits = _rclpy.WaitSet(
            kinds.count("subscription"),
            2,
            0,
            kinds.count("client"),
            kinds.count("service"),
            0,
            self._context.handle,
        )
        waits.clear_entities()
        waits.add_guard_condition(self._guard)
        if self._rcl.rcl_wait_set_add_guard_condition(waits.pointer, self._graph_guard, None) != 0:
            raise Ros2Error("cannot wait for changes of the ROS graph")
        for wakeup in wakeups:
            getattr(waits, f"add_{wakeup.kind}")(wakeup.endpoint)
        return waits

    def close(self) -> None:
        """Stop the thread and watch nothing any more; the endpoints have been removed."""
        self._closing.set()
        self._guard.trigger_guard_condition()
        if self._thread.is_alive():
            self._thread.join(_JOIN_SECONDS)
        with suppress(RuntimeError):  # On trio, the task ends with the graph.
            asyncio.get_running_loop().remove_reader(self._epoll.fileno())
        self._epoll.close()
        self._guard.destroy_when_not_in_use()


def _is_of_call(wakeup: Wakeup) -> bool:
    return wakeup.kind != "subscription"
