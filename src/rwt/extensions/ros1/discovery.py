"""Discovery: nodes, topics and services of other programs, as the master lists them."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Final, TypeVar

import anyio
import anyio.lowlevel

from rwt.extensions.ros1.probes import Ask, Probes, Question, UnusableType
from rwt.extensions.ros1.wire import rpc
from rwt.extensions.ros1.wire.links import connected, exchange_headers, request_topic
from rwt_graph.backend import RemoteEndpoint, TransientLocalCache
from rwt_graph.errors import Ros1Error, WireError
from rwt_graph.names import is_printable
from rwt_participant.qos import DEFAULT_QOS, Durability, QoS

if TYPE_CHECKING:
    from rwt.extensions.ros1.registrar import Registration
    from rwt.extensions.ros1.services import Ros1Services
    from rwt.extensions.ros1.session import Session
    from rwt.extensions.ros1.topics import Ros1Topics
    from rwt_graph.backend import DistributedGraph
    from rwt_interfaces.structs import MessageType

#: Seconds between two readings of the master's tables.
POLL_SECONDS: Final = 1.0

#: Readings after which a subscriber without a connection, or a publisher without an update, is reported.
_PATIENT_READINGS: Final = 4

#: Maximum endpoints and services of other nodes, those that are handled at once, and nodes of one topic that
#: are checked for their connections.
_MOST_ENDPOINTS: Final = 30_000
_MOST_SERVICES: Final = 10_000
_AT_ONCE: Final = 100
_MOST_CHECKED: Final = 100

#: Maximum nodes of one topic or service.
_MOST_NODES: Final = 2000

_ADVICE: Final = "Set ROS_IP to an address of this host that the robot reaches, and let no firewall block it."

_LATCHED: Final = QoS(depth=1, durability=Durability.TRANSIENT_LOCAL)

#: Endpoint: topic, node, and True for a publisher.
Key = tuple[str, str, bool]

T = TypeVar("T")


async def _in_steps(items: Iterable[T]) -> AsyncIterator[T]:
    """Yield items; the event loop runs after each `_AT_ONCE` of them.

    Pass a copy of a collection that may change meanwhile.
    """
    for number, item in enumerate(items, 1):
        yield item
        if number % _AT_ONCE == 0:
            await anyio.lowlevel.checkpoint()


@dataclass(slots=True)
class State:
    """The master's tables: nodes by topic or service, without names that cannot be listed."""

    publishers: dict[str, list[str]] = field(default_factory=dict)
    subscribers: dict[str, list[str]] = field(default_factory=dict)
    services: dict[str, list[str]] = field(default_factory=dict)

    @classmethod
    async def of(cls, value: object) -> State:
        """Return the tables in a response of `getSystemState`.

        Raises:
            Ros1Error: it has another form.
        """
        match value:
            case [list(publishers), list(subscribers), list(services)]:
                state = cls()
                for table, entries in (
                    (state.publishers, publishers),
                    (state.subscribers, subscribers),
                    (state.services, services),
                ):
                    async for entry in _in_steps(entries):
                        match entry:
                            case [str(name), list(nodes)] if is_printable(name):
                                table[name] = [
                                    node
                                    for node in nodes[:_MOST_NODES]
                                    if isinstance(node, str) and is_printable(node)
                                ]
                return state
        raise Ros1Error("the master's response to getSystemState is malformed")

    def endpoints(self) -> Iterator[Key]:
        """Yield every publisher and subscriber."""
        for publishes, table in ((True, self.publishers), (False, self.subscribers)):
            for topic, nodes in table.items():
                for node in nodes:
                    yield topic, node, publishes


class Discovery:
    """Task that keeps the tables of a graph in step with the master."""

    def __init__(
        self, graph: DistributedGraph, session: Session, topics: Ros1Topics, services: Ros1Services
    ) -> None:
        self._graph = graph
        self._session = session
        self.warn_once = session.warn_once
        self._ros_topics = topics
        self._services = services
        self._endpoints: dict[Key, tuple[RemoteEndpoint, float]] = {}
        self._nodes: set[str] = set()
        self._raw = b""
        self._state = State()
        self._probes = Probes(session.network, session.warn_once, session.withdraw_warning)
        self._missing: dict[Key, int] = {}
        self._unlisted: set[Registration] = set()

    async def run(self) -> None:
        """Read the master's tables until the task is cancelled."""
        while True:
            try:
                await self.poll()
            except Ros1Error as error:
                self._session.on_master_error(error)
            await anyio.sleep(POLL_SECONDS)

    async def poll(self) -> None:
        """Read the master's tables once; raises Ros1Error."""
        session, began = self._session, time.monotonic()
        raw = await rpc.fetch(session.master, "getSystemState", "/rwt")
        if raw != self._raw:
            self._state = await State.of(await rpc.value_of(session.master, "getSystemState", raw))
            types = await self._topic_types()
            self._raw = raw
            try:
                await self._apply(types, began)
            except BaseException:
                self._raw = b""  # Applied again when the tables are read next.
                raise
        self._probes.ask()
        session.on_master_answer()
        self._check_own()
        await self._check_connections()

    async def _topic_types(self) -> dict[str, str]:
        """Return the types of topics, as far as the master knows them; raises Ros1Error."""
        answer = await self._session.call_master("getTopicTypes", "/rwt")
        if not isinstance(answer, list):
            raise Ros1Error("the master's response to getTopicTypes is malformed")
        types: dict[str, str] = {}
        async for entry in _in_steps(answer):
            match entry:
                case [str(topic), str(type_name)] if is_printable(f"/{type_name}"):
                    types[topic] = type_name
        return types

    async def _apply(self, types: dict[str, str], began: float) -> None:
        own, state = self._session.own_names(), self._state
        found: set[Key] = set()
        nodes: set[str] = set()
        questions: dict[Question, Ask] = {}
        async for key in _in_steps(islice(state.endpoints(), _MOST_ENDPOINTS)):
            if key[1] not in own:
                found.add(key)
                nodes.add(key[1])
                self._add(key, types.get(key[0], "*"), questions)
        async for key in _in_steps(self._endpoints.keys() - found):
            # A publisher that connected meanwhile may not be in the tables that were read.
            if key in self._endpoints and self._endpoints[key][1] < began:
                self._leave(key)
        services: dict[str, str] = {}
        async for name, providers in _in_steps(islice(state.services.items(), _MOST_SERVICES)):
            if providers and providers[-1] not in own:
                services[name] = providers[-1]
                nodes.add(providers[-1])
                ask = self._services.found(name, providers[-1])
                if ask is not None:
                    questions["service", name, providers[-1]] = ask
        async for name in _in_steps(self._services.names() - services.keys()):
            self._services.lost(name)
        self._probes.replace(questions)
        await self._apply_nodes(nodes)

    def _leave(self, key: Key) -> None:
        known = self._endpoints.pop(key, None)
        if known is not None:
            self._graph.topic_table.remote_left(key[0], known[0])

    async def _apply_nodes(self, nodes: set[str]) -> None:
        async for node in _in_steps(nodes - self._nodes):
            self._graph.node_joined(node)
            self._nodes.add(node)
        async for node in _in_steps(self._nodes - nodes):
            self._graph.node_left(node)
            self._nodes.discard(node)

    def _add(self, key: Key, type_name: str, questions: dict[Question, Ask]) -> None:
        type_name = "" if type_name == "*" else type_name
        known, _ = self._endpoints.get(key, (None, 0.0))
        is_new = known is None or (not key[2] and not known.type_name)
        type = self._session.types.known(type_name) if is_new and type_name else None
        # The topic of an unknown type is listed after the probe: clients that see it can use it.
        if type is not None or (known is None and not key[2]):
            known = RemoteEndpoint(key[1], type_name, type, DEFAULT_QOS)
            self._join(key, known)
        # The master has one type of a topic: that of the last publisher, which may be another one.
        if key[2] and (known is None or known.type is None or type_name not in ("", known.type_name)):
            questions["topic", *key[:2]] = partial(self._probe_topic, key, type_name)

    def _join(self, key: Key, endpoint: RemoteEndpoint) -> None:
        earlier = self._endpoints.get(key)
        self._endpoints[key] = (endpoint, time.monotonic())
        if not self._is_listed(key):
            self._raw = b""  # If the tables still do not list it when they are read next, it has left.
        self._graph.topic_table.remote_joined(key[0], endpoint, publishes=key[2])
        if earlier is not None:
            self._graph.topic_table.remote_left(key[0], earlier[0])

    def found_publisher(
        self, topic: str, node: str, type: MessageType, *, is_latched: bool
    ) -> RemoteEndpoint:
        """Return the endpoint of a publisher whose header has arrived."""
        key = (topic, node, True)
        known = self._endpoints.get(key)
        qos = _LATCHED if is_latched else DEFAULT_QOS
        if known is None or known[0].type is not type or known[0].qos != qos:
            self._join(key, RemoteEndpoint(node, type.name, type, qos))
        endpoint = self._endpoints[key][0]
        endpoint.cache = TransientLocalCache(qos, self._graph.clock) if is_latched else None
        return endpoint

    def found_subscriber(self, topic: str, node: str, type: MessageType) -> None:
        """Add a subscriber that has connected, before the tables list it."""
        key = (topic, node, False)
        if key not in self._endpoints and node not in self._session.own_names():
            self._join(key, RemoteEndpoint(node, type.name, type, DEFAULT_QOS))

    def lost_subscriber(self, topic: str, node: str) -> None:
        """Remove a subscriber that has disconnected, unless the tables list it."""
        if node not in self._state.subscribers.get(topic, ()):
            self._leave((topic, node, False))

    # Types that no registration tells

    async def _probe_topic(self, key: Key, type_name: str) -> None:
        if not self._is_listed(key):
            return
        try:
            type, is_latched = await self._topic_type(*key[:2])
        except (Ros1Error, WireError):
            if key not in self._endpoints and self._is_listed(key):
                self._join(key, RemoteEndpoint(key[1], type_name, None, DEFAULT_QOS))
            raise
        if self._is_listed(key):
            self.found_publisher(key[0], key[1], type, is_latched=is_latched).cache = None

    def _is_listed(self, key: Key) -> bool:
        table = self._state.publishers if key[2] else self._state.subscribers
        return key[1] in table.get(key[0], ())

    async def _topic_type(self, topic: str, node: str) -> tuple[MessageType, bool]:
        """Ask a publisher for its type, and if it is latched."""
        session = self._session
        uri = await session.call_master("lookupNode", "/rwt", node)
        host, port = await request_topic(str(uri), "/rwt", topic)
        async with connected(session.network, host, port) as link:
            fields = {"callerid": "/rwt", "topic": topic, "type": "*", "md5sum": "*"}
            header = await exchange_headers(link, fields)
        name, md5 = header.get("type", ""), header.get("md5sum", "")
        try:
            type = session.types.find(name, md5, header.get("message_definition", ""))
        except WireError as error:
            raise UnusableType(f"{topic} of node {node} is not received: {error}") from error
        return type, header.get("latching") == "1"

    # What should be, and is not

    def _check_own(self) -> None:
        """Register everything again if the master has forgotten a registration, as after its restart."""
        tables = {
            "Publisher": self._state.publishers,
            "Subscriber": self._state.subscribers,
            "Service": self._state.services,
        }
        confirmed = self._session.registrar.confirmed
        self._session.registrar.reconsider(self._state.services)
        lost = {each for each in confirmed if each.node.name not in tables[each.kind].get(each.name, ())}
        if lost & self._unlisted:  # For two readings: a registration may be newer than the tables.
            self.warn_once("the ROS 1 master has no registrations of this process: all are repeated")
            lost.clear()
            self._session.on_forgotten()
        self._unlisted = lost

    async def _check_connections(self) -> None:
        """Report nodes that cannot connect back, and find publishers without the master's updates."""
        own = self._session.own_names()
        missing: dict[Key, int] = {}
        for node in self._session.nodes.values():
            for publication in node.publications.values():
                connected = {link.caller for link in publication.links}
                for name in self._state.subscribers.get(publication.name, ())[:_MOST_CHECKED]:
                    if name not in connected and name not in own:
                        key = (publication.name, name, False)
                        missing[key] = self._missing.get(key, 0) + 1
        async for name, subscription in _in_steps(tuple(self._ros_topics.subscriptions.items())):
            others = [node for node in self._state.publishers.get(name, ()) if node not in own]
            if len(others) > len(subscription.connected):
                key = (name, "", True)
                missing[key] = self._missing.get(key, 0) + 1
                if missing[key] % _PATIENT_READINGS == 0:
                    await self._find_publishers(name, others[:_MOST_CHECKED])
        for key, count in missing.items():
            if count == _PATIENT_READINGS and not key[2]:
                self._report_unconnected(*key[:2])
        self._missing = missing

    async def _find_publishers(self, topic: str, nodes: list[str]) -> None:
        uris = [await self._session.try_master("lookupNode", node) for node in nodes]
        subscription = self._ros_topics.subscriptions.get(topic)
        if subscription is not None and subscription.follow_also(uri for uri in uris if isinstance(uri, str)):
            self.warn_once(
                f"the ROS 1 master does not report the publishers of {topic}: it was told to do so at"
                f" {subscription.node.uri}; they are found by asking it. {_ADVICE}"
            )

    def _report_unconnected(self, topic: str, node: str) -> None:
        address = self._session.address
        self.warn_once(
            f"node {node} subscribes to {topic}, but has not connected to this process at {address.host},"
            f" the address it was given ({address.source}). {_ADVICE}"
        )
