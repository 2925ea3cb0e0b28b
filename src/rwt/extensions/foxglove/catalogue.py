"""Announcements to clients, by role: channels for topics, services, and the connection graph."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from rwt.access.graph_view import GraphView
from rwt.extensions.foxglove.wire.payloads import JSON
from rwt.extensions.foxglove.wire.server_messages import encoded, text, texts
from rwt_graph.api import TopicInfo
from rwt_interfaces import field_types
from rwt_interfaces.field_types import FieldType
from rwt_interfaces.structs import MessageType, ServiceType
from rwt_protocol.frames import Frame

SCHEMA_ENCODINGS: Final[Mapping[str, str]] = {"cdr": "ros2msg", "ros1": "ros1msg"}
"""Encoding of type definitions, by the serialisation of the messages."""


@dataclass(frozen=True, slots=True, eq=False)
class TopicChannel:
    """Topic as announced to clients; `in_json` if viewers cannot read the robot's serialisation."""

    id: int
    topic: str
    type: MessageType
    announced: bytes
    in_json: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class OfferedService:
    """Service as announced to clients."""

    id: int
    name: str
    type: ServiceType
    announced: bytes


class Catalogue:
    """Channels and services visible to any role, each under one id for all clients.

    A topic that returns, or changes its type, gets a new id. Subscriptions of `node`, the gateway's own, do
    not make a topic.
    """

    def __init__(self, node: str) -> None:
        self._node = node
        self._channels: dict[str, TopicChannel] = {}
        self._services: dict[str, OfferedService] = {}
        # Channels and services are counted together; no id is used twice.
        self._count = 0

    def channel(self, topic: TopicInfo) -> TopicChannel | None:
        """Return the channel of a topic; None if its type is unknown or only clients of this gateway
        subscribe to it.
        """
        if topic.type is None:
            return None
        # A topic that only clients of this gateway subscribe to is not the robot's.
        if not topic.publishers and all(each.node == self._node for each in topic.subscribers):
            return None
        known = self._channels.get(topic.name)
        # A new id for another type, because clients keep the schema of an id.
        if known is None or known.type.name != topic.type.name:
            self._count += 1
            schema = _schema(topic.type)
            announced = encoded({"id": self._count, "topic": topic.name, **schema})
            known = self._channels[topic.name] = TopicChannel(
                self._count, topic.name, topic.type, announced, schema["encoding"] == JSON
            )
        return known

    def service(self, name: str, type: ServiceType) -> OfferedService:
        """Return the announced service of a name and type."""
        known = self._services.get(name)
        if known is None or known.type.name != type.name:
            self._count += 1
            announced = encoded(
                {
                    "id": self._count,
                    "name": name,
                    "type": type.request.registry.type_name(type),
                    "request": _schema(type.request),
                    "response": _schema(type.response),
                }
            )
            known = self._services[name] = OfferedService(self._count, name, type, announced)
        return known

    def keep(self, listings: Iterable[RoleListing]) -> None:
        """Remove channels and services that no listing contains."""
        shown = {id for listing in listings for id in (*listing.channels, *listing.services)}
        self._channels = {name: each for name, each in self._channels.items() if each.id in shown}
        self._services = {name: each for name, each in self._services.items() if each.id in shown}


def _schema(type: MessageType) -> dict[str, str]:
    """Return a type's schema: its definition with all nested types, as in MCAP, or JSON Schema."""
    registry = type.registry
    json_schema = _schema_where_needed(type)
    if json_schema is not None:
        return {
            "encoding": JSON,
            "schemaName": registry.type_name(type),
            "schemaEncoding": "jsonschema",
            "schema": encoded(json_schema).decode(),
        }
    serialisation = registry.distro.serialisation
    return {
        "encoding": serialisation,
        "schemaName": registry.type_name(type),
        "schemaEncoding": SCHEMA_ENCODINGS[serialisation],
        "schema": registry.full_text(type),
    }


class Connections(NamedTuple):
    """Connection graph: names of nodes by topic and by service."""

    publishers: Mapping[str, tuple[str, ...]] = {}
    subscribers: Mapping[str, tuple[str, ...]] = {}
    providers: Mapping[str, tuple[str, ...]] = {}

    def since(self, before: Connections) -> Frame | None:
        """Return the frame with the changes since `before`; None if nothing has changed."""
        topics = self.publishers.keys() | self.subscribers.keys()
        removed = sorted((before.publishers.keys() | before.subscribers.keys()) - topics)
        published = _changed(self.publishers, before.publishers, topics, "publisherIds")
        subscribed = _changed(self.subscribers, before.subscribers, topics, "subscriberIds")
        provided = _changed(self.providers, before.providers, self.providers.keys(), "providerIds")
        withdrawn = sorted(before.providers.keys() - self.providers.keys())
        if not (published or subscribed or provided or removed or withdrawn):
            return None
        return text(
            "connectionGraphUpdate",
            publishedTopics=published,
            subscribedTopics=subscribed,
            advertisedServices=provided,
            removedTopics=removed,
            removedServices=withdrawn,
        )


def _changed(
    now: Mapping[str, tuple[str, ...]], before: Mapping[str, tuple[str, ...]], kept: Iterable[str], ids: str
) -> list[dict[str, object]]:
    return [
        # A topic may be missing on one side, for example without publishers; it then has an empty list.
        {"name": name, ids: now.get(name, ())}
        for name in sorted(kept)
        if now.get(name, ()) != before.get(name, ())
    ]


class ListingChange(NamedTuple):
    """Frames that announce changes of a listing, and the ids of removed channels."""

    frames: tuple[Frame, ...]
    gone: frozenset[int]


class RoleListing:
    """Listing for clients of one role: topics that they may subscribe to, and services that they may call."""

    def __init__(self, catalogue: Catalogue, view: GraphView) -> None:
        self.view = view
        self.channels: Mapping[int, TopicChannel] = {}
        self.services: Mapping[int, OfferedService] = {}
        self._catalogue = catalogue
        self._welcome: tuple[Frame, ...] | None = None

    def refresh(self) -> ListingChange:
        """Read the graph again."""
        role, catalogue = self.view.role, self._catalogue
        channels = {
            channel.id: channel
            for topic in self.view.topics()
            if role.allows("subscribe", topic.name) and (channel := catalogue.channel(topic)) is not None
        }
        services = {
            service.id: service
            for info in self.view.services()
            if self.view.may_call(info.name)
            for service in (catalogue.service(info.name, info.type),)
        }
        change = self.difference(self.channels, self.services, channels, services)
        if change.frames:
            self._welcome = None
        self.channels, self.services = channels, services
        return change

    @staticmethod
    def difference(
        channels: Mapping[int, TopicChannel],
        services: Mapping[int, OfferedService],
        new_channels: Mapping[int, TopicChannel],
        new_services: Mapping[int, OfferedService],
    ) -> ListingChange:
        """Return the changes for a client that knows these channels and services."""
        # Removals come first: a topic that changed its type is removed and announced again in one change.
        gone = channels.keys() - new_channels.keys()
        withdrawn = services.keys() - new_services.keys()
        frames = [
            *([text("unadvertise", channelIds=sorted(gone))] if gone else []),
            *([text("unadvertiseServices", serviceIds=sorted(withdrawn))] if withdrawn else []),
            *texts(
                "advertise",
                "channels",
                [each.announced for id, each in new_channels.items() if id not in channels],
            ),
            *texts(
                "advertiseServices",
                "services",
                [each.announced for id, each in new_services.items() if id not in services],
            ),
        ]
        return ListingChange(tuple(frames), frozenset(gone))

    @property
    def welcome(self) -> tuple[Frame, ...]:
        """Return the frames for a new client; they are shared until the next change."""
        if self._welcome is None:
            self._welcome = self.difference({}, {}, self.channels, self.services).frames
        return self._welcome

    def connections(self) -> Connections:
        """Return the connection graph, as far as the role may see it."""
        view = self.view
        publishers: dict[str, tuple[str, ...]] = {}
        subscribers: dict[str, tuple[str, ...]] = {}
        for topic in view.topics():
            publishers[topic.name] = self._nodes(each.node for each in topic.publishers)
            subscribers[topic.name] = self._nodes(each.node for each in topic.subscribers)
        providers = {info.name: self._nodes((info.node,)) for info in view.services()}
        # Names without a visible node are left out, so `since` reports them as removed.
        return Connections(
            {name: nodes for name, nodes in publishers.items() if nodes},
            {name: nodes for name, nodes in subscribers.items() if nodes},
            {name: nodes for name, nodes in providers.items() if nodes},
        )

    def _nodes(self, names: Iterable[str]) -> tuple[str, ...]:
        return tuple(sorted({name for name in names if name and self.view.sees_node(name)}))


Schema = dict[str, object]

_MAX_FIELDS: Final = 10_000
"""Maximum number of fields of a schema; nested types count at each use."""


def _schema_where_needed(message: MessageType) -> Schema | None:
    """Return the JSON Schema of a type with a ``wstring``; None for other types and for too large schemas.

    DDS leaves the encoding of ``wstring`` open (OMG DDS-XTypes 1.3, section 7.4.1), so Foxglove and
    Lichtblick reject such types. They only read schemas with inlined types and one type per value.
    """
    if not _has_wide(message, set()):
        return None
    try:
        return _Schemas().of_message(message)
    except _TooLarge:
        return None


def _has_wide(message: MessageType, seen: set[str]) -> bool:
    """Return True if a type outside `seen` has a ``wstring``."""
    if message.name in seen:
        return False
    seen.add(message.name)
    for slot in message.slots:
        type = slot.type.element if isinstance(slot.type, field_types.Array) else slot.type
        if isinstance(type, field_types.String) and type.wide:
            return True
        if isinstance(type, field_types.Message) and _has_wide(type.type, seen):
            return True
    return False


class _TooLarge(Exception):
    """Schema with too many fields."""


class _Schemas:
    """Builder of one schema, which counts its fields."""

    def __init__(self) -> None:
        self._fields = 0

    def of_message(self, message: MessageType) -> Schema:
        self._fields += len(message.slots)
        if self._fields > _MAX_FIELDS:
            raise _TooLarge
        return {"type": "object", "properties": {slot.name: self._of(slot.type) for slot in message.slots}}

    def _of(self, type: FieldType) -> Schema:
        match type:
            case field_types.Bool():
                return {"type": "boolean"}
            case field_types.Int():
                return {"type": "integer", "minimum": type.low, "maximum": type.high}
            case field_types.Float():
                return {"type": "number"}
            case field_types.String():
                return {"type": "string"}
            case field_types.Octets():
                return {"type": "string", "contentEncoding": "base64"}
            case field_types.Time():
                return {"type": "object", "properties": {key: {"type": "integer"} for key in type.keys}}
            case field_types.Message():
                return self.of_message(type.type)
            case field_types.Array():
                return {"type": "array", "items": self._of(type.element)}
