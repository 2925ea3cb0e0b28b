"""Services in memory: a call is a function call, in both directions.

Only a call that is still open when its provider's callback returns is added to the provider's list and given
a deadline. Deadlines are kept in one set per tick, visited by one timer: a heap entry per call would be most
of the call's cost, and at 100,000 calls per second half a million cancelled entries would remain.

Services of other processes come through :class:`RemoteServices`, which only a backend over a network has.
"""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from heapq import heappop, heappush
from typing import Generic, Protocol, TypeVar

from rwt_graph.api import CallObserver, OnReply, PendingCall, ServiceCall, ServiceInfo
from rwt_graph.clock import Clock
from rwt_graph.memory.tables import Changes, NodeResources, Provider, ProviderTable, RemoteProviders
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ServiceType
from rwt_participant.errors import CallFailed, CallTimeout, ProviderGone, ProviderNotFound, ServiceFailed
from rwt_participant.timers import LONGEST_DELAY, Timer

logger = logging.getLogger(__name__)

C = TypeVar("C")

OnCall = Callable[[ServiceCall], None]

#: Ticks per second: a call expires up to 1 / this late, and never early.
TICKS = 50


class MemoryCall(ServiceCall, PendingCall):
    """Request as both sides see it."""

    __slots__ = ("_caller", "_due", "_on_reply", "_open", "request", "service")

    def __init__(self, service: str, request: Payload, on_reply: OnReply) -> None:
        self.service = service
        self.request = request
        self._on_reply: OnReply | None = on_reply
        self.on_end: Callable[[], None] | None = None
        self._open: set[MemoryCall] | None = None
        self._due: set[MemoryCall] | None = None

    @property
    def done(self) -> bool:
        return self._on_reply is None

    def wait(
        self, pending: set[MemoryCall], caller: NodeResources, deadlines: Deadlines, timeout: float | None
    ) -> None:
        """Keep the call open: register it with its provider, its caller and its deadline, if any."""
        self._open = pending
        self._caller = caller
        self._due = None if timeout is None else deadlines.add(self, timeout)
        pending.add(self)
        caller.add(self, self.caller_closed)

    def _end(self) -> OnReply | None:
        on_reply, self._on_reply = self._on_reply, None
        if on_reply is not None and self._open is not None:
            self._open.discard(self)
            self._caller.drop(self)
            if self._due is not None:
                self._due.discard(self)
        on_end, self.on_end = self.on_end, None
        if on_end is not None:
            try:
                on_end()
            except Exception:
                logger.exception("the provider of %s failed on the end of a call", self.service)
        return on_reply

    def reply(self, response: Payload) -> None:
        on_reply = self._end()
        if on_reply is not None:
            self._call_back(on_reply, response)

    def fail(self, reason: str) -> None:
        self.end_with(ServiceFailed(reason))

    def end_with(self, failure: CallFailed) -> None:
        """End the call with a failure that is not the provider's answer."""
        on_reply = self._end()
        if on_reply is not None:
            self._call_back(on_reply, failure)

    def caller_closed(self) -> None:
        """End the call because its caller's node leaves."""
        self.end_with(CallFailed(f"node {self._caller.name} was closed"))

    def cancel(self) -> None:
        self._end()

    def _call_back(self, on_reply: OnReply, answer: Payload | CallFailed) -> None:
        try:
            on_reply(answer)
        except Exception:
            logger.exception("the caller of %s failed on its answer", self.service)


class Deadlines:
    """Deadlines of all open calls."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._ticks: dict[int, set[MemoryCall]] = {}
        self._order: list[int] = []
        self._timer: Timer | None = None
        self._armed_for = 0

    def add(self, call: MemoryCall, timeout: float) -> set[MemoryCall]:
        """Expire `call` in `timeout` seconds; to prevent it, discard it from the returned set."""
        tick = math.ceil((self._clock.monotonic() + min(max(0.0, timeout), LONGEST_DELAY)) * TICKS)
        due = self._ticks.get(tick)
        if due is None:
            due = self._ticks[tick] = set()
            heappush(self._order, tick)
            self._arm()
        due.add(call)
        return due

    def _arm(self) -> None:
        first = self._order[0]
        if self._timer is not None:
            if self._armed_for <= first:
                return
            self._timer.cancel()
        self._armed_for = first
        self._timer = self._clock.call_later(first / TICKS - self._clock.monotonic(), self._sweep)

    def _sweep(self) -> None:
        self._timer = None
        now = math.floor(self._clock.monotonic() * TICKS + 1e-6)
        while self._order and self._order[0] <= now:
            for call in tuple(self._ticks.pop(heappop(self._order))):
                call.end_with(CallTimeout("Timeout exceeded while waiting for service response"))
        if self._order and self._timer is None:
            self._arm()


class RemoteServices(RemoteProviders, Protocol):
    """Services of other processes, which are notified of those of this process."""

    def offered(self, provider: MemoryProvider) -> None:
        """Called when a service is offered in this process."""

    def withdrawn(self, provider: MemoryProvider) -> None:
        """Called when a service of this process is withdrawn, before its open calls end."""

    def info(self, name: str) -> ServiceInfo | None:
        """Return a service of another process; None if it does not exist."""

    def call(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: NodeResources
    ) -> PendingCall | None:
        """Call a service of another process; None if no other process offers it."""


class OfferedServices(ABC, Generic[C]):
    """Services of this process, offered to other processes while the graph is connected to them.

    Args:
        services: services of the graph, which notify this object.
    """

    def __init__(self, services: Services) -> None:
        self._services = services
        self._connection: C | None = None
        # Functions that withdraw services.
        self._offers: dict[MemoryProvider, Callable[[], object]] = {}

    def open(self, connection: C) -> None:
        """Offer every service of this process."""
        self._connection = connection
        for provider in self._services:
            self.offered(provider)

    def close(self) -> None:
        """Offer no more services; those offered end with the connection."""
        self._connection = None
        self._offers.clear()

    def offered(self, provider: MemoryProvider) -> None:
        is_local = provider.owner.private or provider.name in self._services.reserved
        if self._connection is not None and not is_local:
            withdraw = self._offer(self._connection, provider)
            if withdraw is not None:
                self._offers[provider] = withdraw

    def withdrawn(self, provider: MemoryProvider) -> None:
        withdraw = self._offers.pop(provider, None)
        if withdraw is not None:
            withdraw()

    @abstractmethod
    def _offer(self, connection: C, provider: MemoryProvider) -> Callable[[], object] | None:
        """Offer a service; return a function that withdraws it, None if it cannot be offered."""


class MemoryProvider(Provider):
    """Service that a node offers; `open` are its pending calls."""

    def __init__(
        self, services: Services, name: str, interface: ServiceType, owner: NodeResources, on_call: OnCall
    ) -> None:
        super().__init__(name, owner)
        self.type = interface
        # Cached: a bridge reads it before every call.
        self.info = ServiceInfo(name, interface, owner.name)
        self.on_call = on_call
        self.open: set[MemoryCall] = set()
        self._services = services

    def withdraw(self) -> None:
        self._services.withdrawn(self)

    def end_requests(self) -> None:
        while self.open:
            self.open.pop().end_with(self.gone())

    def gone(self) -> ProviderGone:
        return ProviderGone(f"Service {self.name} was unadvertised")


class Services(ProviderTable[MemoryProvider]):
    """Services of one graph.

    Attributes:
        observer: observer of every call of this process's services.
        dds_rules: True if every provider of a name receives each request, and the first response counts.
        reserved: names of services that are not offered to other processes.
    """

    remote: RemoteServices | None = None
    observer: CallObserver | None = None

    def __init__(self, clock: Clock, changes: Changes, *, dds_rules: bool = False) -> None:
        super().__init__(changes)
        self.deadlines = Deadlines(clock)
        self.dds_rules = dds_rules
        self.reserved: set[str] = set()

    def reserve(self, names: Iterable[str]) -> None:
        """Offer services of these names to nodes of this process only."""
        for name in names:
            self.reserved.add(name)
            provider = self.current.get(name)
            if provider is not None and self.remote is not None:
                self.remote.withdrawn(provider)

    def advertise(
        self, name: str, interface: ServiceType, owner: NodeResources, on_call: OnCall
    ) -> MemoryProvider:
        """Offer a service; a provider of the same name is replaced (SVP-07) until this one closes."""
        provider = MemoryProvider(self, name, interface, owner, on_call)
        if not owner.for_clients:
            self.robot_offers(name)
        old = self.put(provider)
        if old is not None:
            if self.remote is not None:
                self.remote.withdrawn(old)
            if not self.dds_rules:
                logger.warning(
                    "service %s of node %s replaces the one of node %s", name, owner.name, old.node
                )
                old.end_requests()
        if self.remote is not None:
            self.remote.offered(provider)
        return provider

    def robot_offers(self, name: str) -> None:
        """End the clients' providers of a service that the robot offers, in this process or another."""
        self.displace(name, f"{name}: the robot offers this service now")

    def others(self, provider: MemoryProvider) -> list[MemoryProvider]:
        """Return the services that one has replaced; by DDS's rules also its node's, but for an action's."""
        same_node = self.dds_rules and "/_action/" not in provider.name
        return [
            each
            for each in self._replaced.get(provider.name, ())
            if same_node or each.owner is not provider.owner
        ]

    def withdrawn(self, provider: MemoryProvider) -> None:
        """Remove a closed provider; the one that it replaced answers again."""
        restored = self.remove(provider)
        if self.remote is not None:
            self.remote.withdrawn(provider)
            if restored is not None:
                self.remote.offered(restored)

    def call(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: NodeResources
    ) -> PendingCall:
        """Call a service; one of this process has priority over others."""
        provider = self.current.get(name)
        if provider is None:
            return self._call_remote(name, request, on_reply, timeout, caller)
        if self.observer is not None:
            try:
                on_reply = self.observer.on_call(provider.info, request, on_reply)
            except Exception:
                logger.exception("a call of %s could not be observed", name)
        call = MemoryCall(name, request, on_reply)
        others = self.others(provider) if self.dds_rules else ()
        for each in (provider, *others):
            try:
                each.on_call(call)
            except Exception:
                logger.exception("service %s failed", name)
                call.fail("internal error")
        if not call.done:
            if provider.closed:
                call.end_with(provider.gone())
            else:
                call.wait(provider.open, caller, self.deadlines, timeout)
        return call

    def _call_remote(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: NodeResources
    ) -> PendingCall:
        if self.remote is not None:
            sent = self.remote.call(name, request, on_reply, timeout, caller)
            if sent is not None:
                return sent
        call = MemoryCall(name, request, on_reply)
        call.end_with(ProviderNotFound(f"Service {name} does not exist"))
        return call

    def info(self, name: str) -> ServiceInfo | None:
        provider = self.current.get(name)
        if provider is not None:
            return provider.info
        return None if self.remote is None else self.remote.info(name)
