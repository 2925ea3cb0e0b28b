"""Liveliness tokens of other processes, as nodes, endpoints and services in the tables of this graph."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import zenoh

from rwt_graph.errors import InvalidGraphName, WireError
from rwt_graph.memory.topics import RemoteEndpoint
from rwt_graph.names import validate
from rwt_graph.zenoh.rmw.keys import type_name
from rwt_graph.zenoh.rmw.tokens import Endpoint, Kind, Token, all_tokens, gid_of, parse
from rwt_interfaces.errors import InterfaceError
from rwt_participant.qos import Durability

if TYPE_CHECKING:
    from rwt_graph.memory.graph import MemoryGraph
    from rwt_graph.zenoh.link import Link
    from rwt_graph.zenoh.services import ZenohServices
    from rwt_graph.zenoh.topics import ZenohTopics
    from rwt_interfaces.structs import MessageType

logger = logging.getLogger(__name__)

#: Transient-local publishers that are remembered after they left.
_MOST_GONE = 10_000

#: Seconds that the first query for tokens may take.
_QUERY_TIMEOUT = 2.0


class Discovery:
    """Keeps the tables of a graph in step with the tokens that are alive."""

    def __init__(self, graph: MemoryGraph, topics: ZenohTopics, services: ZenohServices) -> None:
        self._graph = graph
        self._topics = graph.topic_table
        self._zenoh_topics = topics
        self._services = services
        self._link: Link | None = None
        # What to do when a token dies, by its key.
        self._alive: dict[str, Callable[[], None]] = {}
        self._warned: set[tuple[str, str]] = set()
        # The GIDs of publishers that are gone, perhaps behind a cut of the link; the oldest are forgotten.
        self._gone: dict[bytes, None] = {}

    def query_tokens(self, link: Link) -> list[str]:
        """The keys of the tokens that are alive now; blocks until they are known, for two seconds at most."""
        alive: list[str] = []
        done = threading.Event()

        def note(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                alive.append(str(reply.ok.key_expr))

        # Not Zenoh's own channel, which holds 256 replies: here the calling thread would have to empty it.
        handler = zenoh.handlers.Callback(note, done.set, indirect=False)
        link.session.liveliness().get(all_tokens(link.domain), handler, timeout=_QUERY_TIMEOUT)
        done.wait(_QUERY_TIMEOUT)
        return alive.copy()

    def open(self, link: Link, alive: list[str]) -> None:
        """Add what :meth:`query_tokens` found, and follow the tokens that come and go from now on."""
        self._link = link
        for key in alive:
            self._born(key)
        # Called on Zenoh's receiving thread itself: a token must not be overtaken by its owner's samples.
        handler = zenoh.handlers.Callback(partial(self._heard, link), indirect=False)
        self._subscriber = link.session.liveliness().declare_subscriber(
            all_tokens(link.domain), handler, history=True
        )

    def close(self) -> None:
        """Ignore tokens from now on."""
        self._link = None

    def _heard(self, link: Link, sample: zenoh.Sample) -> None:
        act = self._born if sample.kind == zenoh.SampleKind.PUT else self._died
        link.run_on_graph(partial(act, str(sample.key_expr)))

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

    def _died(self, key: str) -> None:
        forget = self._alive.pop(key, None)
        if forget is not None:
            forget()

    def _add(self, token: Token, key: str) -> Callable[[], None]:
        """Add what a token stands for to its table; returns what removes it."""
        end = token.endpoint
        if end is None:
            self._graph.node_joined(token.node)
            return partial(self._graph.node_left, token.node)
        if token.kind is Kind.SERVICE:
            return self._services.found(token, end, key)
        if token.kind is Kind.CLIENT:
            return partial(self._services.client_left, gid_of(key))
        return self._add_endpoint(token, end, key)

    def _add_endpoint(self, token: Token, end: Endpoint, key: str) -> Callable[[], None]:
        publishes = token.kind is Kind.PUBLISHER
        name, known = self._type_of(end, token)
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
                self._remember_gone(gid)

        return forget

    def _remember_gone(self, gid: bytes) -> None:
        self._gone[gid] = None
        if len(self._gone) > _MOST_GONE:
            del self._gone[next(iter(self._gone))]

    def _type_of(self, end: Endpoint, token: Token) -> tuple[str, MessageType | None]:
        """The type's name, and the type if it is known here by the same definition."""
        registry = self._topics.registry
        try:
            name = type_name(end.dds_type)
            known = registry.message(name)
        except WireError:
            return end.dds_type, None
        except InterfaceError:
            self._warn_once(end, "its definition is not known here: give it with --interfaces", token)
            return name, None
        if known.rihs01 != end.type_hash:
            self._warn_once(end, f"the other process defines it otherwise ({end.type_hash})", token)
            return name, None
        return name, known

    def _warn_once(self, end: Endpoint, why: str, token: Token) -> None:
        what = (end.dds_type, end.type_hash)
        if what not in self._warned:
            self._warned.add(what)
            logger.warning(
                "%s of node %s cannot be exchanged, it has type %s: %s",
                end.name,
                token.node,
                end.dds_type,
                why,
            )
