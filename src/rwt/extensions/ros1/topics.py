"""Topics of this process on ROS 1: publications and subscriptions over TCPROS.

Each node publishes for itself. The subscriptions of a topic share one connection to each publisher, which the
node of the first of them makes.
"""

from __future__ import annotations

import logging
import time
import weakref
from collections import deque
from collections.abc import Iterable
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Final

import anyio

from rwt.extensions.ros1.registrar import Registration
from rwt.extensions.ros1.wire.links import PEER_CLOSED, connected, exchange_headers, request_topic
from rwt.extensions.ros1.wire.tcpros import frame_of
from rwt_graph.api import Sample
from rwt_graph.errors import Ros1Error, WireError
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_protocol.frames import Frame

if TYPE_CHECKING:
    from rwt.extensions.ros1.discovery import Discovery
    from rwt.extensions.ros1.node import Ros1Node
    from rwt.extensions.ros1.session import Session
    from rwt.extensions.ros1.wire.links import Link
    from rwt_graph.backend import MemoryPublisher, RemoteEndpoint, Topic, Topics
    from rwt_interfaces.structs import MessageType
    from rwt_transports.endpoint import DropReason, Flow

logger = logging.getLogger(__name__)

#: Maximum publishers of one topic that are connected.
_MOST_PUBLISHERS: Final = 200

#: Seconds before a publisher is connected again: at first, and at most.
_SHORTEST_DELAY: Final = 0.25
_LONGEST_DELAY: Final = 30.0

#: Seconds in which a new publication keeps messages for subscribers that are about to connect, as rosbridge
#: does (ADV-08), and maximum number and bytes of these messages.
_STARTUP_SECONDS: Final = 1.0
_STARTUP_MESSAGES: Final = 100
_STARTUP_BYTES: Final = 64 * 1024

#: Maximum characters of a definition in a log line.
_SHOWN_CHARS: Final = 1000


class Publication:
    """Topic that a node of this process publishes.

    Attributes:
        links: connections of subscribers, with the queue of each.
        publishers: publishers of the node, whose samples are sent.
    """

    def __init__(self, node: Ros1Node, discovery: Discovery, name: str, type: MessageType) -> None:
        self.name = name
        self.type = type
        self.links: dict[Link, Flow] = {}
        self.publishers: dict[MemoryPublisher, None] = {}
        self.registration = Registration("Publisher", name, type.name, node)
        self._node = node
        self._discovery = discovery
        self._definition = type.registry.full_text(type)
        self._slow: weakref.WeakSet[Link] = weakref.WeakSet()
        self._startup_end = time.monotonic() + _STARTUP_SECONDS
        self._startup: deque[Frame] = deque(maxlen=_STARTUP_MESSAGES)

    def add(self, publisher: MemoryPublisher) -> None:
        """Send the samples of a publisher, and those that it retains."""
        self.publishers[publisher] = None
        publisher.on_publish_remote = self._send
        for flow in self.links.values():
            self._send_retained(publisher, flow)

    def remove(self, publisher: MemoryPublisher) -> None:
        """Send no more samples of a publisher."""
        del self.publishers[publisher]
        publisher.on_publish_remote = None

    def accept(self, link: Link) -> None:
        """Answer a subscriber, and send it the retained samples."""
        header = link.header
        if header["md5sum"] not in ("*", self.type.md5):
            self._discovery.warn_once(
                f"node {link.caller[:200]} cannot subscribe to {self.name}:"
                f" its {header.get('type', 'type')[:200]} has the MD5 sum {header['md5sum'][:32]},"
                f" that of {self._node.name} has {self.type.md5};"
                f" its definition is {header.get('message_definition', 'not known')[:_SHOWN_CHARS]!r},"
                f" that of {self._node.name} is {self._definition[:_SHOWN_CHARS]!r}"
            )
            link.refuse(
                f"topic types do not match: [{header.get('type')}/{header['md5sum']}]"
                f" vs. [{self.type.name}/{self.type.md5}]"
            )
            return
        is_latched = any(publisher.cache is not None for publisher in self.publishers)
        link.send_header(
            {
                "callerid": self._node.name,
                "topic": self.name,
                "type": self.type.name,
                "md5sum": self.type.md5,
                "message_definition": self._definition,
                "latching": "1" if is_latched else "0",
                "tcp_nodelay": "1",
            }
        )
        link.on_close = self._left
        flow = self.links[link] = link.flow(self.name, partial(self._on_drop, link))
        self._discovery.found_subscriber(self.name, link.caller, self.type)
        for publisher in self.publishers:
            self._send_retained(publisher, flow)
        if not is_latched and time.monotonic() < self._startup_end:
            for frame in self._startup:
                flow.send(frame)

    def _on_drop(self, link: Link, _reason: DropReason) -> None:
        if link not in self._slow:
            self._slow.add(link)
            self._discovery.warn_once(
                f"node {link.caller} reads {self.name} too slowly: its oldest messages are dropped"
            )

    def _left(self, link: Link) -> None:
        self.links.pop(link, None)
        self._discovery.lost_subscriber(self.name, link.caller)

    def _send_retained(self, publisher: MemoryPublisher, flow: Flow) -> None:
        retained = () if publisher.cache is None else publisher.cache.samples()
        for sample in retained[-1:]:  # As ROS 1 does: only the last one.
            flow.send(frame_of(sample.payload.serialised_parts()))

    def _send(self, sample: Sample) -> None:
        is_startup = self._startup_end and time.monotonic() < self._startup_end
        if not is_startup and self._startup_end:
            self._startup_end = 0.0
            self._startup.clear()
        if self.links or is_startup:
            frame = frame_of(sample.payload.serialised_parts())
            if is_startup and frame.size <= _STARTUP_BYTES:
                self._startup.append(Frame(frame.data))
            for flow in self.links.values():
                flow.send(frame)

    def close(self) -> None:
        """Close the connections of subscribers."""
        for publisher in tuple(self.publishers):
            self.remove(publisher)
        for link in tuple(self.links):
            link.finish()
        self.links.clear()


class Subscription:
    """Topic to which this process subscribes.

    Attributes:
        connected: addresses of the publishers that are connected.
        updates: number of lists of publishers that were received.
    """

    def __init__(self, session: Session, discovery: Discovery, topic: Topic, node: Ros1Node) -> None:
        self.name = topic.name
        self.type_name = "*" if topic.type is None else topic.type.name
        self.node = node
        self.connected: set[str] = set()
        self.updates = 0
        self.registration = Registration("Subscriber", topic.name, self.type_name, node)
        self._session = session
        self._discovery = discovery
        self._topic = topic
        self._now = session.graph.clock.time_ns
        self._publishers: dict[str, anyio.CancelScope] = {}

    def follow(self, uris: Iterable[str]) -> None:
        """Connect to these publishers, and to no others."""
        self.updates += 1
        wanted = set(islice(uris, _MOST_PUBLISHERS)) - self._session.own_uris()
        for uri in self._publishers.keys() - wanted:
            self._publishers.pop(uri).cancel()
        for uri in sorted(wanted - self._publishers.keys()):
            scope = self._publishers[uri] = anyio.CancelScope()
            self._session.network.spawn(partial(self._keep_connected, uri, scope), f"{self.name} at {uri}")

    def follow_also(self, uris: Iterable[str]) -> bool:
        """Connect to publishers of which no update came; returns False if all are known."""
        missing = set(uris) - self._publishers.keys() - self._session.own_uris()
        missing = set(islice(missing, _MOST_PUBLISHERS - len(self._publishers)))
        if missing:
            self.follow(missing | self._publishers.keys())
        return bool(missing)

    async def _keep_connected(self, uri: str, scope: anyio.CancelScope) -> None:
        delay = _SHORTEST_DELAY
        with scope:
            while True:
                await self._session.wait_to_connect()
                try:
                    await self._connect(uri)
                    delay = _SHORTEST_DELAY
                except Ros1Error as error:
                    self._discovery.warn_once(f"{self.name} is not received from {uri}: {error}")
                await anyio.sleep(delay)
                delay = min(2 * delay, _LONGEST_DELAY)

    async def _connect(self, uri: str) -> None:
        """Receive from a publisher until the connection ends; raises Ros1Error."""
        session = self._session
        host, port = await request_topic(uri, self.node.name, self.name)
        fields = {
            "callerid": self.node.name,
            "topic": self.name,
            "type": self.type_name,
            "md5sum": "*",  # Checked here: a publisher that refuses cannot say what its type is.
            "tcp_nodelay": "1",
        }
        async with connected(session.network, host, port) as link:
            link.on_header = self._on_header
            await exchange_headers(link, fields)
            self.connected.add(uri)
            try:
                await link.ended.wait()
            finally:
                self.connected.discard(uri)
            if link.reason not in ("", PEER_CLOSED):
                raise Ros1Error(link.reason)

    def _on_header(self, link: Link) -> None:
        header = link.header
        if "error" in header:
            return  # Raised by the task that connects.
        name = header.get("type", "")
        type = self._session.types.find(name, header.get("md5sum", ""), header.get("message_definition", ""))
        topic = self._topic
        if topic.type is not None and topic.type.name != type.name:
            # Listed with its type: it may have had another before it was started again.
            self._discovery.found_publisher(self.name, link.caller, type, is_latched=False).cache = None
            raise WireError(
                f"node {link.caller} publishes {type.name}, and the topic has type {topic.type.name}"
            )
        if topic.type is not None and topic.type is not type and topic.type.md5 != type.md5:
            self._discovery.warn_once(
                f"node {link.caller} defines {name}, the type of {self.name}, otherwise than this process:"
                f" {header['message_definition'][:_SHOWN_CHARS]!r} in place of"
                f" {topic.type.registry.full_text(topic.type)[:_SHOWN_CHARS]!r}"
            )
            if not topic.publishers:
                topic.type = type
        is_latched = header.get("latching") == "1"
        endpoint = self._discovery.found_publisher(self.name, link.caller, type, is_latched=is_latched)
        link.on_frame = partial(self._on_message, type, endpoint)

    def _on_message(
        self, type: MessageType, endpoint: RemoteEndpoint, _link: Link, body: bytes | memoryview
    ) -> None:
        sample = Sample(self.name, Payload.relayed_ros1(type, body), self._now(), endpoint.node)
        if endpoint.cache is not None:
            endpoint.cache.add(sample)
        for subscriber in self._topic.subscribers:
            try:
                subscriber.on_sample(sample)
            except InvalidMessage as error:
                raise WireError(f"node {endpoint.node} sent what is no {type.name}: {error}") from error
            except Exception:
                logger.exception("a subscriber of %s failed", self.name)

    def close(self) -> None:
        """Close the connections to publishers."""
        for scope in self._publishers.values():
            scope.cancel()
        self._publishers.clear()
        for endpoint in self._topic.remote_publishers:
            endpoint.cache = None  # Sent again to the next subscription.


class Ros1Topics:
    """Topics of this process, offered to ROS 1, and received samples."""

    def __init__(self, topics: Topics) -> None:
        self._topics = topics
        self._session: Session | None = None
        self._discovery: Discovery | None = None
        self.subscriptions: dict[str, Subscription] = {}

    def open(self, session: Session, discovery: Discovery) -> None:
        """Offer every topic of this process."""
        self._session, self._discovery = session, discovery
        for topic in self._topics.all():
            self.changed(topic)

    def close(self) -> None:
        """Close every connection."""
        if self._session is not None:
            for node in self._session.nodes.values():
                for publication in node.publications.values():
                    publication.close()
            for subscription in self.subscriptions.values():
                subscription.close()
        self._session = None

    def changed(self, topic: Topic) -> None:
        if self._session is not None and self._discovery is not None:
            self._follow_publishers(self._session, self._discovery, topic)
            self._follow_subscribers(self._session, self._discovery, topic)

    def _follow_publishers(self, session: Session, discovery: Discovery, topic: Topic) -> None:
        publishers = [each for each in topic.publishers if not each.owner.private]
        for node in session.nodes.values():
            publication = node.publications.get(topic.name)
            if publication is not None:
                for publisher in publication.publishers.keys() - set(publishers):
                    publication.remove(publisher)
        for publisher in publishers:
            node = session.node_of(publisher.owner)
            publication = node.publications.get(topic.name)
            if publication is None:
                publication = node.publications[topic.name] = Publication(
                    node, discovery, topic.name, publisher.type
                )
                session.registrar.add(publication.registration)
            if publisher not in publication.publishers:
                publication.add(publisher)
        for node in session.nodes.values():
            publication = node.publications.get(topic.name)
            if publication is not None and not publication.publishers:
                del node.publications[topic.name]
                session.registrar.remove(publication.registration)
                publication.close()

    def _follow_subscribers(self, session: Session, discovery: Discovery, topic: Topic) -> None:
        owners = {each.owner.name: each.owner for each in topic.announced_subscribers}
        subscription = self.subscriptions.get(topic.name)
        if subscription is not None:
            if any(session.nodes.get(name) is subscription.node for name in owners):
                return
            del self.subscriptions[topic.name]
            del subscription.node.subscriptions[topic.name]
            session.registrar.remove(subscription.registration)
            subscription.close()
        if owners:
            node = session.node_of(next(iter(owners.values())))
            subscription = Subscription(session, discovery, topic, node)
            self.subscriptions[topic.name] = node.subscriptions[topic.name] = subscription
            session.registrar.add(subscription.registration)
