"""Channels of an MCAP file: schema, encoding and metadata of a topic."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal

import msgspec

from rwt_interfaces.field_types import Array, Bool, FieldType, Float, Int, Octets, String, Time
from rwt_interfaces.structs import MessageType
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.qos import LATCHED, MOST_DEPTH, Durability, History, QoS, Reliability

Encoding = Literal["ros", "json"]
"""Encoding of messages: the serialisation of ROS (CDR, or that of ROS 1 on ROS 1), or JSON."""

ENCODINGS: Final[tuple[Encoding, ...]] = ("ros", "json")

DEFINITION: Final = "ros_definition"
"""Metadata key of the type's definition for playback, if the schema is not the definition."""

TYPE: Final = "ros_type"
"""Key of a channel's metadata: the name of its type, where that is not the schema's."""

_HISTORIES: Final = {History.KEEP_LAST: 1, History.KEEP_ALL: 2}
_RELIABILITIES: Final = {Reliability.RELIABLE: 1, Reliability.BEST_EFFORT: 2, Reliability.BEST_AVAILABLE: 4}
_DURABILITIES: Final = {
    Durability.TRANSIENT_LOCAL: 1, Durability.VOLATILE: 2, Durability.BEST_AVAILABLE: 4,
}  # fmt: skip
"""rmw's numbers, which every version of rosbag2 reads."""

_SCHEMAS: Final = {"cdr": "ros2msg", "ros1": "ros1msg"}
"""Schema encoding of each serialisation."""

_INFINITE: Final = (9223372036, 854775807)


@dataclass(frozen=True, slots=True)
class ChannelForm:
    """Description of one topic in an MCAP file.

    Attributes:
        schema_name: the type's name, as its distribution spells it.
        schema_encoding: ``ros2msg``, ``ros1msg`` or ``jsonschema``.
        message_encoding: ``cdr``, ``ros1`` or ``json``.
        metadata: quality of service and more, by key.
    """

    topic: str
    schema_name: str
    schema_encoding: str
    schema: bytes
    message_encoding: str
    metadata: dict[str, str]


def channel_form(
    topic: str, message: MessageType, encoding: Encoding, offered_qos: tuple[QoS, ...] = ()
) -> ChannelForm:
    """Return the channel of one topic.

    Args:
        offered_qos: QoS that its publishers offer, if known.
    """
    registry = message.registry
    distro = registry.distro
    text = registry.full_text(message)
    metadata = {"offered_qos_profiles": qos_text(offered_qos)} if distro.has_qos else _latching(offered_qos)
    if distro.type_hash == "rihs01":
        metadata["topic_type_hash"] = message.rihs01
    else:
        metadata["md5sum"] = message.md5
    name = registry.type_name(message)
    if encoding == "json":
        metadata[DEFINITION] = text
        return ChannelForm(topic, name, "jsonschema", json_schema(message), "json", metadata)
    schema = _SCHEMAS[distro.serialisation]
    shown, shown_text = _readable(name, text)
    if shown_text != text or shown != name:
        del metadata["topic_type_hash"]  # It is that of the other name.
        metadata |= {TYPE: name, DEFINITION: text}
    return ChannelForm(topic, shown, schema, shown_text.encode(), distro.serialisation, metadata)


_MADE_BY_RULE: Final = re.compile(r"(?<![\w/])(\w+)/(?:msg/|srv/|action/)?([A-Za-z0-9]+_\w+)(?!\w)")


def _readable(name: str, text: str) -> tuple[str, str]:
    """Return a schema's name and text with no underscores in names of types.

    ROS 2 makes such names by rule (`pkg/srv/X_Event`). mcap-ros2-support 0.6 and rosbags 0.11 take them for
    mistakes, and read nothing of a file that has one.
    """
    heads = [line.removeprefix("MSG: ") for line in text.splitlines() if line.startswith("MSG: ")]
    made = [found for each in (name, *heads) if (found := _MADE_BY_RULE.fullmatch(each))]
    plain = {(found[1], found[2]): found[2].replace("_", "") for found in made}
    if not plain:
        return name, text

    def replaced(found: re.Match[str]) -> str:
        short = plain.get((found[1], found[2]))
        return f"{found[1]}/{short}" if short else found[0]

    package, _, short = _MADE_BY_RULE.sub(replaced, name).partition("/")
    return f"{package}/msg/{short.rpartition('/')[2]}", _MADE_BY_RULE.sub(replaced, text)


def _latching(offered_qos: tuple[QoS, ...]) -> dict[str, str]:
    latched = any(qos.durability is Durability.TRANSIENT_LOCAL for qos in offered_qos)
    return {"latching": "1"} if latched else {}


def qos_text(offered_qos: tuple[QoS, ...]) -> str:
    """`offered_qos_profiles` as rosbag2 writes it: a YAML list of profiles."""
    return "".join(_profile(qos) for qos in offered_qos)


def _profile(qos: QoS) -> str:
    entries = {
        "history": _HISTORIES[qos.history],
        "depth": qos.depth,
        "reliability": _RELIABILITIES[qos.reliability],
        "durability": _DURABILITIES[qos.durability],
        "deadline": _duration(qos.deadline),
        "lifespan": _duration(qos.lifespan),
        "liveliness": 1,  # automatic
        "liveliness_lease_duration": _duration(None),
        "avoid_ros_namespace_conventions": "false",
    }
    lines = [f"{key}: {value}" for key, value in entries.items()]
    return "- " + "\n  ".join(lines) + "\n"


def _duration(seconds: float | None) -> str:
    whole, rest = divmod(round(seconds * NANOSECONDS), NANOSECONDS) if seconds else _INFINITE
    return f"\n    sec: {whole}\n    nsec: {rest}"


#: QoS noted for a latched topic, if its publishers' QoS is unknown.
KEPT: Final = QoS(depth=1, durability=Durability.TRANSIENT_LOCAL)

#: The same for `/tf_static`, on which the last message of every publisher is retained.
KEPT_TRANSFORMS: Final = QoS(depth=100, durability=Durability.TRANSIENT_LOCAL)


Schema = dict[str, object]


def json_schema(message: MessageType) -> bytes:
    """Return the JSON Schema of a message type in rosbridge's JSON, as text.

    The root is an object with nested messages inlined instead of ``$ref``, as Foxglove and Lichtblick
    require.
    """
    return msgspec.json.encode(_message(message))


def _message(message: MessageType) -> Schema:
    if message.time is not None:
        return _time(message.time)
    return {
        "title": message.name,
        "type": "object",
        "properties": {slot.name: _schema(slot.type) for slot in message.slots},
    }


def _schema(field_type: FieldType) -> Schema:
    if isinstance(field_type, Octets):
        return {"type": "string", "contentEncoding": "base64"}
    if isinstance(field_type, Array):
        found: Schema = {"type": "array", "items": _schema(field_type.element)}
        if field_type.length is not None:
            found |= {"minItems": field_type.length, "maxItems": field_type.length}
        elif field_type.bound is not None:
            found["maxItems"] = field_type.bound
        return found
    if isinstance(field_type, Bool):
        return {"type": "boolean"}
    if isinstance(field_type, Int):
        return {"type": "integer", "minimum": field_type.low, "maximum": field_type.high}
    if isinstance(field_type, Float):
        return {"type": "number"}
    if isinstance(field_type, String):
        return {"type": "string"}
    return _time(field_type) if isinstance(field_type, Time) else _message(field_type.type)


def _time(field_type: Time) -> Schema:
    seconds, nanoseconds = field_type.keys
    return {
        "title": str(field_type),
        "type": "object",
        "properties": {seconds: {"type": "integer"}, nanoseconds: {"type": "integer"}},
    }


_HISTORY_WORDS: Final = {"2": History.KEEP_ALL, "keep_all": History.KEEP_ALL}
_RELIABILITY_WORDS: Final = {"2": Reliability.BEST_EFFORT, "best_effort": Reliability.BEST_EFFORT}
_DURABILITY_WORDS: Final = {"1": Durability.TRANSIENT_LOCAL, "transient_local": Durability.TRANSIENT_LOCAL}
_ENTRY: Final = re.compile(r"^[- ] +(history|depth|reliability|durability): *\"?(\w+)", re.MULTILINE)


def read_offered_qos(metadata: dict[str, str]) -> tuple[QoS, ...]:
    """Return the profiles in a channel's metadata: rosbag2's, or ROS 1's latching. Invalid ones become the
    default.
    """
    if metadata.get("latching") == "1":
        return (LATCHED,)
    text = metadata.get("offered_qos_profiles", "")
    profiles = re.split(r"^(?=- )", text, flags=re.MULTILINE)
    return tuple(
        _read_profile(dict(_ENTRY.findall(profile))) for profile in profiles if _ENTRY.search(profile)
    )


def _read_profile(entries: dict[str, str]) -> QoS:
    depth = entries.get("depth", "10")
    return QoS(
        history=_HISTORY_WORDS.get(entries.get("history", ""), History.KEEP_LAST),
        depth=min(int(depth), MOST_DEPTH) if depth.isdecimal() else 10,
        reliability=_RELIABILITY_WORDS.get(entries.get("reliability", ""), Reliability.RELIABLE),
        durability=_DURABILITY_WORDS.get(entries.get("durability", ""), Durability.VOLATILE),
    )


def combined(offered_qos: tuple[QoS, ...]) -> QoS:
    """Merge the profiles of several publishers into one that retains whatever any of them did.

    Transient-local if any is, with the sum of their depths.
    """
    kept = [qos for qos in offered_qos if qos.durability is Durability.TRANSIENT_LOCAL]
    if not kept:
        return offered_qos[0] if offered_qos else QoS()
    history = History.KEEP_ALL if any(qos.history is History.KEEP_ALL for qos in kept) else History.KEEP_LAST
    depth = min(sum(max(1, qos.depth) for qos in kept), MOST_DEPTH)
    return QoS(history, depth, kept[0].reliability, Durability.TRANSIENT_LOCAL)
