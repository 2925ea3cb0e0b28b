"""Services across processes: local ones as queryables, remote ones through queries."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import zenoh

from rwt.extensions.zenoh.calls import FAILED, GONE, Client, RemoteCall, abandoned_key, read_abandoned
from rwt.extensions.zenoh.rmw import attachment
from rwt.extensions.zenoh.rmw.attachment import Attachment
from rwt.extensions.zenoh.rmw.keys import type_name
from rwt.extensions.zenoh.rmw.tokens import EntityKind, Token, TokenEndpoint
from rwt_graph.api import OnReply, PendingCall, ServiceInfo
from rwt_graph.backend import (
    MemoryCall,
    MemoryProvider,
    NodeResources,
    OfferedServices,
    PerNode,
    RemoteServiceTable,
    Services,
)
from rwt_graph.errors import WireError
from rwt_interfaces.errors import InterfaceError, InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, ProviderGone

if TYPE_CHECKING:
    from rwt.extensions.zenoh.link import ZenohLink
    from rwt_interfaces.registry import Registry

logger = logging.getLogger(__name__)


class ZenohServices(OfferedServices["ZenohLink"]):
    """Declares the services of this process, and calls those of others."""

    def __init__(self, services: Services, registry: Registry, time_ns: Callable[[], int]) -> None:
        super().__init__(services)
        self._registry = registry
        self._time_ns = time_ns
        self._remote: RemoteServiceTable[tuple[Token, TokenEndpoint]] = RemoteServiceTable(services)
        self.info, self.names, self.by_node = self._remote.info, self._remote.names, self._remote.by_node
        # Unanswered requests of other processes, by client and number.
        self._asked: dict[bytes, dict[int, MemoryCall]] = {}
        self._clients: PerNode[Client] = PerNode(Client.close)
        self._callers = NodeResources("/_remote", private=True)

    def open(self, connection: ZenohLink) -> None:
        self._abandonments = connection.session.declare_subscriber(
            abandoned_key(connection.domain, connection.id),
            connection.callback(self._on_abandoned),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        super().open(connection)

    def close(self) -> None:
        super().close()
        self._remote.close()

    # Services of this process

    def _offer(self, connection: ZenohLink, provider: MemoryProvider) -> Callable[[], object]:
        end = connection.endpoint(provider.name, provider.type)
        key = end.data_key(connection.domain)
        handler = connection.callback(partial(self._serve, provider, key))
        queryable = connection.session.declare_queryable(
            key, handler, complete=True, allowed_origin=zenoh.Locality.REMOTE
        )
        presence = connection.declare(EntityKind.SERVICE, provider.owner, end)

        def undeclare() -> None:
            presence.end()
            queryable.undeclare()

        # Deferred until its open calls have ended, which the caller does next.
        return partial(connection.run_on_graph, undeclare)

    def _serve(self, provider: MemoryProvider, key: str, query: zenoh.Query) -> None:
        raw, body = query.attachment, query.payload
        try:
            sent = attachment.decode(b"" if raw is None else raw.to_bytes())
            request = Payload.from_cdr(provider.type.request, b"" if body is None else body.to_bytes())
        except (WireError, InvalidMessage) as error:
            logger.info("a request to %s from another process is refused: %s", provider.name, error)
            name = self._registry.type_name(provider.type.request)
            _refuse(query, f"the request to {provider.name} is not a {name}", FAILED)
            return
        answer = partial(self._answer, key, query, sent)
        if provider not in self._offers:
            answer(provider.gone())
            return
        # Answer only with the current provider of the name in this process.
        call = self._services.call(provider.name, request, answer, None, self._callers)
        if isinstance(call, MemoryCall) and not call.done:
            self._asked.setdefault(sent.gid, {})[sent.sequence] = call

    def _answer(self, key: str, query: zenoh.Query, sent: Attachment, answer: Payload | CallFailed) -> None:
        calls = self._asked.get(sent.gid)
        if calls is not None:
            calls.pop(sent.sequence, None)
            if not calls:
                del self._asked[sent.gid]
        if isinstance(answer, CallFailed):
            _refuse(query, str(answer), GONE if isinstance(answer, ProviderGone) else FAILED)
            return
        echo = Attachment(sent.sequence, self._time_ns(), sent.gid)
        query.reply(key, answer.cdr(), attachment=echo.encode())
        query.drop()

    def _on_abandoned(self, sample: zenoh.Sample) -> None:
        gid, number = read_abandoned(sample.payload.to_bytes())
        call = self._asked.get(gid, {}).pop(number, None)
        if call is not None:
            call.cancel()

    def client_left(self, gid: bytes) -> None:
        """Cancel the open calls of a client of another process that left."""
        for call in self._asked.pop(gid, {}).values():
            call.cancel()

    # Services of other processes

    def found(self, token: Token, end: TokenEndpoint, key: str) -> Callable[[], None]:
        """Add a provider of another process; return a function that removes it."""
        try:
            type = self._registry.service(type_name(end.dds_type))
        except (WireError, InterfaceError):
            logger.info(
                "service %s of node %s is left out: %s is not known", end.name, token.node, end.dds_type
            )
            return lambda: None
        self._remote.found(key, ServiceInfo(end.name, type, token.node), (token, end))
        return partial(self._remote.lost, key, end.name)

    def call(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: NodeResources
    ) -> PendingCall | None:
        service, link = self._remote.get(name), self._connection
        if service is None or link is None:
            return None
        info, (_, end) = service.first
        if end.type_hash != info.type.announced_hash:
            text = f"Service {name} defines {type_name(end.dds_type)} otherwise than this process"
            refused = RemoteCall(name, request, on_reply, info.type.response)
            refused.end_with(CallFailed(text))
            return refused
        key = f"{name} {end.dds_type}"
        client = self._clients.get(caller, key, partial(self._make_client, link, caller, end))
        sessions = {token.session for _, (token, _) in service.offers.values()}
        call = client.ask(name, request, on_reply, info.type.response, sessions)
        call.wait(service.open, caller, self._services.deadlines, timeout)
        return call

    def _make_client(self, link: ZenohLink, caller: NodeResources, end: TokenEndpoint) -> Client:
        own = TokenEndpoint(end.name, end.dds_type, end.type_hash)
        return Client(link, end, link.declare(EntityKind.CLIENT, caller, own), self._time_ns)


def _refuse(query: zenoh.Query, text: str, kind: str) -> None:
    query.reply_err(text.encode(), encoding=zenoh.Encoding.TEXT_PLAIN.with_schema(kind))
    query.drop()
