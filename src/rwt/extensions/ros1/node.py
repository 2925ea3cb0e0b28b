"""Nodes of this process as other ROS 1 programs see them: slave API, connections to topics and services."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Final

import anyio

from rwt.extensions.ros1.wire import links, rpc
from rwt_graph.errors import WireError
from rwt_transports.errors import ListenError

if TYPE_CHECKING:
    from rwt.extensions.ros1.services import ServiceOffer
    from rwt.extensions.ros1.session import Session
    from rwt.extensions.ros1.topics import Publication, Subscription
    from rwt.extensions.ros1.wire.links import Link
    from rwt.extensions.ros1.wire.xmlrpc import Value

#: Seconds before a node that cannot accept connections tries it again.
_RETRY_SECONDS: Final = 1.0


class Ros1Node:
    """Node of this process.

    Attributes:
        name: name on the ROS 1 graph; changes once if another node has it, or takes it.
        uri: address of the slave API; empty before `opened` is set.
        opened: set once the node accepts connections.
        spawn: starts a task on the graph's event loop.
        is_named: True once it was checked that no other node has the name.
        is_renamed: True once the name was changed.
        is_evicted: True if the node was told to shut down, or another node has taken its second name.
    """

    def __init__(self, session: Session, name: str) -> None:
        self.name = name
        self.is_named = False
        self.is_renamed = False
        self.is_evicted = False
        self.publications: dict[str, Publication] = {}
        self.subscriptions: dict[str, Subscription] = {}
        self.services: dict[str, ServiceOffer] = {}
        self.uri = ""
        self.opened = anyio.Event()
        self.spawn = session.network.spawn
        self._session = session
        self._port = 0
        self._links: set[Link] = set()
        self._closers: list[Callable[[], None]] = []

    @property
    def service_uri(self) -> str:
        """Address of its services, once `opened` is set."""
        return f"rosrpc://{self._session.address.host}:{self._port}"

    async def open(self) -> None:
        """Accept connections.

        Raises:
            ListenError: no port is available.
        """
        network, address = self._session.network, self._session.address
        calls = rpc.serve(network, address.bind, self._dispatch)
        port, close = await network.open(calls, f"calls of {self.name} on ROS 1")
        self._closers.append(close)
        accepting = links.serve(network, address.bind, self._accept)
        self._port, close = await network.open(accepting, f"connections of {self.name} on ROS 1")
        self._closers.append(close)
        self.uri = f"http://{address.host}:{port}/"
        self.opened.set()

    async def keep_opening(self) -> None:
        """Accept connections as soon as that is possible."""
        while not self.opened.is_set():
            try:
                await self.open()
            except (ListenError, OSError) as error:
                self.close()
                self._session.warn_once(f"node {self.name} cannot accept connections of ROS 1: {error}")
                await anyio.sleep(_RETRY_SECONDS)

    def rename(self) -> None:
        """Change the name, which another node has, to one of this process."""
        self.name = f"{self.name}_{os.getpid()}"
        self.is_renamed = True

    # Slave API

    def _dispatch(self, method: str, params: tuple[Value, ...]) -> Value:
        session = self._session
        match method, params:
            case "requestTopic", (str(), str(topic), list(protocols)):
                return self._request_topic(topic, protocols)
            case "publisherUpdate", (str(), str(topic), list(uris)):
                subscription = self.subscriptions.get(topic)
                if subscription is not None:
                    subscription.follow([uri for uri in uris if isinstance(uri, str)])
                return [1, "", 0]
            case "paramUpdate", (str(), str(key), value):
                session.on_parameter(key, value)
                return [1, "", 0]
            case "getPid", (str(),):
                return [1, "", os.getpid()]
            case "getName", (str(),):
                return [1, "", self.name]
            case "getUri", (str(),):
                return [1, "", self.uri]
            case "getMasterUri", (str(),):
                return [1, "", session.master]
            case "getBusStats", (str(),):
                return [1, "", [[], [], []]]
            case "getBusInfo", (str(),):
                return [1, "", [[number, *info] for number, info in enumerate(self._bus_info(), 1)]]
            case "getSubscriptions", (str(),):
                return [1, "", [[each.name, each.type_name] for each in self.subscriptions.values()]]
            case "getPublications", (str(),):
                return [1, "", [[each.name, each.type.name] for each in self.publications.values()]]
            case "shutdown", (str(caller), *rest):
                reason = str(rest[0])[:500] if rest else ""
                session.run_on_graph(partial(session.on_shutdown, self, caller, reason))
                return [1, "", 0]
        raise WireError(f"{method[:80]} with {len(params)} parameters is not supported")

    def _request_topic(self, topic: str, protocols: list[Value]) -> Value:
        if topic not in self.publications:
            return [0, f"{self.name} is not a publisher of {topic}", []]
        if any(each[:1] == ["TCPROS"] for each in protocols if isinstance(each, list)):
            return [1, "ready", ["TCPROS", self._session.address.host, self._port]]
        return [0, "only TCPROS is supported", []]

    def _bus_info(self) -> Iterator[list[Value]]:
        for publication in self.publications.values():
            for link in publication.links:
                where = f"TCPROS connection on port {self._port} to [{link.peer}:0 on socket 0]"
                yield [link.caller, "o", "TCPROS", publication.name, True, where]
        for subscription in self.subscriptions.values():
            for uri in subscription.connected:
                yield [uri, "i", "TCPROS", subscription.name, True, f"TCPROS connection to [{uri}]"]

    # Connections

    def _accept(self, link: Link) -> None:
        link.on_header = self._on_header
        self._links.add(link)

    def _on_header(self, link: Link) -> None:
        header = link.header
        if "md5sum" not in header:
            link.refuse("the header has no md5sum")
        elif "topic" in header:
            self._pass_on(link, "topic", self.publications.get(header["topic"]))
        elif "service" in header:
            self._pass_on(link, "service", self.services.get(header["service"]))
        else:
            link.refuse("the header names no topic and no service")

    def _pass_on(self, link: Link, kind: str, offer: Publication | ServiceOffer | None) -> None:
        if offer is None:
            link.refuse(f"{self.name} does not offer the {kind} {link.header[kind][:200]}")
        else:
            offer.accept(link)

    def sweep(self) -> None:
        """Close connections without a header, and forget closed ones."""
        for link in tuple(self._links):
            if link.is_overdue():
                link.close()
            if link.ended.is_set():
                self._links.discard(link)

    def close(self) -> None:
        """Close all connections."""
        while self._closers:
            self._closers.pop()()
        for link in self._links:
            link.close()
        self._links.clear()
