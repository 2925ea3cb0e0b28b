"""Access to a graph from any thread."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING, TypeVar
from weakref import WeakSet

from rwt_graph import MemoryGraph
from rwt_graph.clock import SimulatedClock
from rwt_graph.errors import NotRunning
from rwt_rclpy.clocks.timekeeper import Timekeeper, VirtualTime, current, keep_time_by
from rwt_rclpy.messages.loaded import classes

if TYPE_CHECKING:
    from rwt_graph.api import Graph, Publisher
    from rwt_interfaces.payload import Payload
    from rwt_rclpy.endpoints.client import Client

T = TypeVar("T")

#: Default domain, without ROS_DOMAIN_ID.
DEFAULT_DOMAIN = 2**32 - 1


class Link:
    """Graph with access from any thread.

    A graph that runs on an event loop is used on that loop's thread; one that does not run is used
    in the caller's thread, one thread at a time.

    Attributes:
        graph: graph.
        timekeeper: source of time of its nodes.
        clients: service clients of this process, which the graph does not know.
    """

    def __init__(self, graph: Graph, timekeeper: Timekeeper | None = None) -> None:
        self.graph = graph
        self.clients: WeakSet[Client] = WeakSet()
        self.timekeeper = timekeeper or current()
        self._lock = self.timekeeper.lock

    def run(self, function: Callable[[], T]) -> T:
        """Run a function that uses the graph; return its result or raise its exception."""
        graph = self.graph
        if not graph.running:
            with self._lock:
                return function()
        if graph.on_graph_thread():
            return function()
        outcome: Future[T] = Future()

        def run() -> None:
            try:
                outcome.set_result(function())
            except Exception as error:
                outcome.set_exception(error)

        graph.run_on_graph(run)
        return outcome.result()

    def post(self, function: Callable[[], object]) -> None:
        """Run a function that uses the graph, in order with others of this thread, without waiting."""
        graph = self.graph
        if not graph.running:
            with self._lock:
                function()
        elif graph.on_graph_thread():
            function()
        else:
            graph.run_on_graph(partial(_discard, function))

    def publish(self, publisher: Publisher, payload: Payload) -> None:
        """Publish from any thread."""
        graph = self.graph
        if not graph.running:
            with self._lock:
                publisher.publish(payload)
        elif graph.on_graph_thread():
            publisher.publish(payload)
        else:
            graph.run_on_graph(partial(publisher.publish, payload))


def _discard(function: Callable[[], object]) -> None:
    function()


class Domains:
    """Graphs of the process: one for each ROS domain, unless one is set for all of them.

    Attributes:
        given: graph that is set for all domains; None for a graph of this process for each.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._links: dict[int, Link] = {}
        self.given: Link | None = None

    def link(self, domain: int) -> Link:
        """Return the graph of a domain, created on first use."""
        if self.given is not None:
            return self.given
        with self._lock:
            found = self._links.get(domain)
            if found is None:
                found = self._links[domain] = Link(MemoryGraph(classes().registry, dds_rules=True))
            return found

    def reset(self) -> None:
        """Drop the graphs of this process; existing nodes keep theirs."""
        with self._lock:
            self._links.clear()


#: Graphs of this process.
DOMAINS = Domains()


def domain_of(domain: int | None) -> int:
    """Return the number of a domain; None for the value of ROS_DOMAIN_ID, by default 0.

    Raises:
        RuntimeError: it is negative, or not a number.
    """
    if domain is None or domain == DEFAULT_DOMAIN:
        text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
        if not text.isdecimal():
            raise RuntimeError(f"ROS_DOMAIN_ID is {text!r}: expected a number from 0")
        return int(text)
    if domain < 0:
        raise RuntimeError(f"Domain id ({domain}) should not be lower than zero.")
    return domain


class VirtualDomain:
    """Context manager of a separate graph in virtual time.

    Args:
        start_ns: ROS time at the start, nanoseconds since the epoch.

    Attributes:
        graph: graph.
        time: virtual time.
    """

    def __init__(self, start_ns: int = 1_700_000_000_000_000_000) -> None:
        self.time = VirtualTime(SimulatedClock(start_ns))
        self.graph = MemoryGraph(classes().registry, self.time.clock, dds_rules=True)
        self._before: tuple[Timekeeper, Link | None] | None = None

    def __enter__(self) -> VirtualDomain:
        self._before = keep_time_by(self.time), DOMAINS.given
        DOMAINS.given = Link(self.graph, self.time)
        return self

    def __exit__(self, *exc: object) -> None:
        assert self._before is not None  # It was entered.
        timekeeper, DOMAINS.given = self._before
        keep_time_by(timekeeper)

    @property
    def now(self) -> float:
        """Return the seconds since the start."""
        return self.time.clock.monotonic()

    def advance(self, seconds: float) -> None:
        """Advance time. Raises ValueError for a negative duration."""
        self.time.advance(seconds)


__all__ = ["DEFAULT_DOMAIN", "DOMAINS", "Domains", "Link", "NotRunning", "VirtualDomain", "domain_of"]
