"""Discovery: liveliness tokens of other processes become nodes, endpoints and services of this graph."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import zenoh

from rwt.extensions.zenoh.rmw.keys import type_name
from rwt.extensions.zenoh.rmw.tokens import EntityKind, Token, TokenEndpoint, all_tokens, gid_of, parse
from rwt_graph.backend import EndpointTypes, RemoteEndpoint
from rwt_graph.errors import InvalidGraphName, WireError
from rwt_graph.names import validate
from rwt_participant.qos import Durability

if TYPE_CHECKING:
    from rwt.extensions.zenoh.link import ZenohLink
    from rwt.extensions.zenoh.services import ZenohServices
    from rwt.extensions.zenoh.topics import ZenohTopics
    from rwt_graph.backend import DistributedGraph
    from rwt_interfaces.structs import MessageType

logger = logging.getLogger(__name__)

#: Maximum number of departed transient-local publishers that are remembered.
_MOST_GONE = 10_000

#: Timeout of the first query for tokens, in seconds.
_QUERY_TIMEOUT = 2.0


class Discovery:
    """Discovery that keeps the tables of a graph in step with the live tokens."""

    def __init__(self, graph: DistributedGraph, topics: ZenohTopics, services: ZenohServices) -> None:
        self._graph = graph
        self._topics = graph.topic_table
        self._zenoh_topics = topics
        self._services = services
        self._link: ZenohLink | None = None
        # Function to call when a token ends, by its key.
        self._alive: dict[str, Callable[[], None]] = {}
        self._types = EndpointTypes(graph.registry)
        # GIDs of departed publishers, which may be behind a broken link; the oldest are removed.
        self._gone: dict[bytes, None] = {}

    def query_tokens(self, link: ZenohLink) -> list[str]:
        """Return the keys of all live tokens; blocks for at most two seconds."""
        alive: list[str] = []
        done = threading.Event()

        def note(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                alive.append(str(reply.ok.key_expr))

        # Zenoh's own channel holds only 256 replies, and this thread would have to empty it.
        handler = zenoh.handlers.Callback(note, done.set, indirect=False)
        link.session.liveliness().get(all_tokens(link.domain), handler, timeout=_QUERY_TIMEOUT)
        done.wait(_QUERY_TIMEOUT)
        return alive.copy()

    def open(self, link: ZenohLink, alive: list[str]) -> None:
        """Add the result of :meth:`query_tokens`, and follow later changes."""
        self._link = link
        for key in alive:
            self._born(key)
        # Called on Zenoh's receiving thread: samples must not overtake the token of their publisher.
        self._subscriber = link.session.liveliness().declare_subscriber(
            all_tokens(link.domain), link.callback(self._heard), history=True
        )

    def close(self) -> None:
        self._link = None

    def _heard(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.PUT:
            self._born(key)
        elif (forget := self._alive.pop(key, None)) is not None:
            forget()

    def _born(self, key: str) -> None:
        link = self._link
        if link is None or key in self._alive:
            return
        try:
            token = parse(key)
            validate(token.node)
            if token.endpoint is not None:
                validate(token.endpoint.name)
        except (WireError, InvalidGraphName) as error:
            logger.info("a token of another process is left out: %s", error)
            return
        if token.session != link.id:
            self._alive[key] = self._add(token, key)

    def _add(self, token: Token, key: str) -> Callable[[], None]:
        end = token.endpoint
        if end is None:
            self._graph.node_joined(token.node)
            return partial(self._graph.node_left, token.node)
        if token.kind is EntityKind.SERVICE:
            return self._services.found(token, end, key)
        if token.kind is EntityKind.CLIENT:
            return partial(self._services.client_left, gid_of(key))
        return self._add_endpoint(token, end, key)

    def _add_endpoint(self, token: Token, end: TokenEndpoint, key: str) -> Callable[[], None]:
        publishes = token.kind is EntityKind.PUBLISHER
        known: MessageType | None = None
        try:
            name = type_name(end.dds_type)
        except WireError:
            name = end.dds_type
        else:
            known = self._types.find(name, end.type_hash, end.name, token.node)
        endpoint = RemoteEndpoint(token.node, name, known, end.qos)
        gid = gid_of(key)
        if publishes:
            self._zenoh_topics.publishers[gid] = endpoint
        self._topics.remote_joined(end.name, endpoint, publishes=publishes)
        if gid in self._gone:
            del self._gone[gid]
            self._zenoh_topics.on_reconnected(end.name)

        def forget() -> None:
            self._zenoh_topics.publishers.pop(gid, None)
            self._topics.remote_left(end.name, endpoint)
            if publishes and end.qos.durability is Durability.TRANSIENT_LOCAL:
                self._gone[gid] = None
                if len(self._gone) > _MOST_GONE:
                    del self._gone[next(iter(self._gone))]

        return forget
