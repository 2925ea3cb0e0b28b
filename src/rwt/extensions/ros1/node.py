"""Nodes of this process as other ROS 1 programs see them: slave API, connections to topics and services."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Final

from rwt.extensions.ros1.wire.links import Link
from rwt.extensions.ros1.wire.rpc import RpcServer
from rwt_graph.errors import WireError

if TYPE_CHECKING:
    from rwt.extensions.ros1.services import ServiceOffer
    from rwt.extensions.ros1.session import Session
    from rwt.extensions.ros1.topics import Publication, Subscription
    from rwt.extensions.ros1.wire.xmlrpc import Value

logger = logging.getLogger(__name__)

#: Maximum connections of other programs to one node.
_MOST_LINKS: Final = 1000


class Ros1Node:
    """Node of this process.

    Attributes:
        name: name on the ROS 1 graph; changes once if another node has it, or takes it.
        uri: address of the slave API.
        service_uri: address of its services.
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
        self.spawn = session.sockets.spawn
        self._session = session
        self._links: set[Link] = set()
        address = session.address
        self._rpc = RpcServer(session.sockets, address.bind, self._dispatch)
        self._listener = session.sockets.listen(address.bind, self._accept)
        self.uri = f"http://{address.host}:{self._rpc.port}/"
        self.service_uri = f"rosrpc://{address.host}:{self._listener.port}"

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
            return [1, "ready", ["TCPROS", self._session.address.host, self._listener.port]]
        return [0, "only TCPROS is supported", []]

    def _bus_info(self) -> Iterator[list[Value]]:
        for publication in self.publications.values():
            for link in publication.links:
                where = f"TCPROS connection on port {self._listener.port} to [{link.peer}:0 on socket 0]"
                yield [link.caller, "o", "TCPROS", publication.name, True, where]
        for subscription in self.subscriptions.values():
            for uri in subscription.connected:
                yield [uri, "i", "TCPROS", subscription.name, True, f"TCPROS connection to [{uri}]"]

    # Connections

    def _accept(self, accepted: socket.socket, peer: str) -> None:
        if len(self._links) >= _MOST_LINKS:
            logger.warning("node %s has %d connections; another one is refused", self.name, _MOST_LINKS)
            accepted.close()
            return
        link = Link(self._session.sockets, accepted, peer)
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
        self._rpc.sweep()
        for link in tuple(self._links):
            if link.is_overdue():
                link.close()
            if link.closed.is_set():
                self._links.discard(link)

    def close(self) -> None:
        """Close all connections."""
        self._rpc.close()
        self._listener.close()
        for link in self._links:
            link.close()
        self._links.clear()
