"""Services in memory: a call is a function call, in both directions.

A provider that answers at once costs no bookkeeping at all; only a call that is still open when its
provider's callback returns is put on the provider's list and given a deadline.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from rwt_graph.api import CallObserver, OnReply, PendingCall, Registration, ServiceCall, ServiceInfo
from rwt_graph.memory.deadlines import Deadlines, Expiring
from rwt_graph.memory.node_resources import Owner
from rwt_graph.memory.remote import ServicesElsewhere
from rwt_program.errors import CallFailed, CallTimeout, ProviderGone, ProviderNotFound, ServiceFailed

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import ServiceType

logger = logging.getLogger(__name__)

OnCall = Callable[[ServiceCall], None]


class Answering(Protocol):
    """Whoever has calls open; here or in another process."""

    open: set[MemoryCall]


class MemoryCall(ServiceCall, PendingCall, Expiring):
    """One request, as both sides see it."""

    __slots__ = ("_caller", "_due", "_on_reply", "_provider", "request", "service")

    def __init__(self, service: str, request: Payload, on_reply: OnReply) -> None:
        self.service = service
        self.request = request
        self._on_reply: OnReply | None = on_reply
        self._provider: Answering | None = None
        self._due: set[Expiring] | None = None

    @property
    def done(self) -> bool:
        """Whether the call was answered, timed out or was abandoned by its caller."""
        return self._on_reply is None

    def wait(self, provider: Answering, caller: Owner, due: set[Expiring] | None) -> None:
        """Note where the call is kept while it is open."""
        self._provider = provider
        self._caller = caller
        self._due = due
        provider.open.add(self)
        caller.add(self, self.caller_closed)

    def _end(self) -> OnReply | None:
        on_reply, self._on_reply = self._on_reply, None
        if on_reply is not None and self._provider is not None:
            self._provider.open.discard(self)
            self._caller.drop(self)
            if self._due is not None:
                self._due.discard(self)
        return on_reply

    def reply(self, response: Payload) -> None:
        """Answer with success."""
        on_reply = self._end()
        if on_reply is not None:
            self._tell(on_reply, response)

    def fail(self, reason: str) -> None:
        """Answer with failure."""
        self.end_with(ServiceFailed(reason))

    def end_with(self, failure: CallFailed) -> None:
        """End the call with a failure that is not the provider's answer."""
        on_reply = self._end()
        if on_reply is not None:
            self._tell(on_reply, failure)

    def expire(self) -> None:
        """The timeout has passed."""
        self.end_with(CallTimeout("Timeout exceeded while waiting for service response"))

    def caller_closed(self) -> None:
        """The caller's node leaves: whoever waits for the answer must not wait for ever."""
        self.end_with(CallFailed(f"node {self._caller.name} was closed"))

    def cancel(self) -> None:
        """Forget the call: no reply callback comes after this."""
        self._end()

    def _tell(self, on_reply: OnReply, answer: Payload | CallFailed) -> None:
        try:
            on_reply(answer)
        except Exception:
            logger.exception("the caller of %s failed on its answer", self.service)


class MemoryProvider(Registration):
    """One service that a node offers; `open` are its calls in flight."""

    def __init__(
        self, services: Services, name: str, interface: ServiceType, owner: Owner, on_call: OnCall
    ) -> None:
        self.name = name
        self.type = interface
        self.node = owner.name
        # Made once: a bridge asks for it before every call.
        self.info = ServiceInfo(name, interface, owner.name)
        self.owner = owner
        self.on_call = on_call
        self.open: set[MemoryCall] = set()
        self.closed = False
        self._services = services

    def close(self) -> None:
        """Withdraw the service; calls in flight fail (SVP-09)."""
        if self.closed:
            return
        self.closed = True
        self.owner.drop(self)
        self._services.withdrawn(self)
        while self.open:
            self.open.pop().end_with(self.gone())

    def gone(self) -> ProviderGone:
        """Why calls in flight end."""
        return ProviderGone(f"Service {self.name} was unadvertised")


class Services:
    """Every service of one graph."""

    def __init__(self, deadlines: Deadlines) -> None:
        self.deadlines = deadlines
        self.elsewhere: ServicesElsewhere | None = None
        self._providers: dict[str, MemoryProvider] = {}
        self.observer: CallObserver | None = None

    def advertise(self, name: str, interface: ServiceType, owner: Owner, on_call: OnCall) -> MemoryProvider:
        """Offer a service; a provider of the same name is replaced (SVP-07)."""
        old = self._providers.get(name)
        provider = self._providers[name] = MemoryProvider(self, name, interface, owner, on_call)
        owner.add(provider, provider.close)
        if old is not None:
            logger.warning("service %s of node %s replaces the one of node %s", name, owner.name, old.node)
            old.close()
        if self.elsewhere is not None:
            self.elsewhere.offered(provider)
        return provider

    def withdrawn(self, provider: MemoryProvider) -> None:
        """Forget a provider that closed, unless it was replaced already."""
        if self._providers.get(provider.name) is provider:
            del self._providers[provider.name]
        if self.elsewhere is not None:
            self.elsewhere.withdrawn(provider)

    def call(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: Owner
    ) -> PendingCall:
        """Call a service; one of this process comes before those of others."""
        provider = self._providers.get(name)
        if provider is None:
            return self._call_elsewhere(name, request, on_reply, timeout, caller)
        if self.observer is not None:
            on_reply = self._observed(self.observer, provider.info, request, on_reply)
        call = MemoryCall(name, request, on_reply)
        try:
            provider.on_call(call)
        except Exception:
            logger.exception("service %s failed", name)
            call.fail("internal error")
        if not call.done:
            if provider.closed:
                call.end_with(provider.gone())
            else:
                call.wait(provider, caller, None if timeout is None else self.deadlines.add(call, timeout))
        return call

    def _call_elsewhere(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: Owner
    ) -> PendingCall:
        if self.elsewhere is not None:
            sent = self.elsewhere.call(name, request, on_reply, timeout, caller)
            if sent is not None:
                return sent
        call = MemoryCall(name, request, on_reply)
        call.end_with(ProviderNotFound(f"Service {name} does not exist"))
        return call

    @staticmethod
    def _observed(
        observer: CallObserver, service: ServiceInfo, request: Payload, on_reply: OnReply
    ) -> OnReply:
        try:
            return observer.on_call(service, request, on_reply)
        except Exception:
            logger.exception("a call of %s could not be observed", service.name)
            return on_reply

    def info(self, name: str) -> ServiceInfo | None:
        """A snapshot of one service."""
        provider = self._providers.get(name)
        if provider is not None:
            return provider.info
        return None if self.elsewhere is None else self.elsewhere.info(name)

    def here(self) -> tuple[MemoryProvider, ...]:
        """Every service of this process."""
        return tuple(self._providers.values())

    def names(self) -> list[str]:
        """Every service's name, sorted."""
        if self.elsewhere is None:
            return sorted(self._providers)
        return sorted(self._providers.keys() | self.elsewhere.names())

    def of_node(self, node: str) -> tuple[str, ...]:
        """The names of what a node offers, sorted."""
        names = {p.name for p in self._providers.values() if p.node == node}
        if self.elsewhere is not None:
            names |= self.elsewhere.of_node(node)
        return tuple(sorted(names))


__all__ = ["MemoryCall", "MemoryProvider", "Services"]
