"""advertise, unadvertise, publish, subscribe, unsubscribe."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_access.quotas import require_advertisement, require_subscription
from rwt_bridge.ops.payloads import payload_of
from rwt_bridge.ops.qos import publisher_qos
from rwt_bridge.ops.subscriptions import ClientSubscription
from rwt_graph.names import resolve
from rwt_interfaces.validation.missing_fields import missing_fields
from rwt_program.qos import LATCHED
from rwt_protocol.errors import Refused

if TYPE_CHECKING:
    from rwt_bridge.peer import Peer
    from rwt_delivery.shared_publishers import Publication
    from rwt_interfaces.structs import MessageType
    from rwt_protocol import ops

#: The user token of a client that published without having advertised (UNA-05).
_IMPLICIT = object()


def on_advertise(peer: Peer, op: ops.Advertise) -> None:
    """Make the client a publisher (ADV-01 … ADV-07)."""
    topic = resolve(op.topic)
    peer.role.require("publish", topic)
    message_type = peer.bridge.graph.registry.message(op.type)
    if op.id not in peer.advertised.get(topic, ()):
        require_advertisement(peer, op.op)
    peer.bridge.publications.acquire(topic, message_type, publisher_qos(op), (peer, op.id), op.qos)
    peer.forget_publisher(topic)
    peer.advertised.setdefault(topic, set()).add(op.id)


def on_unadvertise(peer: Peer, op: ops.Unadvertise) -> None:
    """Take back one advertisement, or all of this client's for the topic (UNA-01 … UNA-03)."""
    topic = resolve(op.topic)
    ids = peer.advertised.get(topic)
    if ids is None:
        raise Refused(f"unadvertise: this client does not advertise {topic}", level="warning")
    dropped = list(ids) if op.id is None else [op.id]
    for id_ in dropped:
        ids.discard(id_)
        peer.bridge.publications.release(topic, (peer, id_))
    if not ids:
        del peer.advertised[topic]
        peer.forget_publisher(topic)


def on_publish(peer: Peer, op: ops.Publish) -> None:
    """Check the message once and hand it to the graph (PUB-01 … PUB-09)."""
    publication = peer.publishers.get(op.topic)
    if publication is None:
        publication = peer.publishers[op.topic] = _publication(peer, op)
    raw = op.msg
    payload = payload_of(publication.type, raw, "publish.msg", peer.bridge.now)
    counts = publication.counts
    counts.received += 1
    counts.received_bytes += raw.size
    publication.publish(payload)
    if peer.session.wants_status("warning"):
        _warn_of_defaults(peer, op, publication.type)


def _warn_of_defaults(peer: Peer, op: ops.Publish, type: MessageType) -> None:
    """Tell a client that wants to hear it which fields it has left to their defaults (PUB-04)."""
    missing = missing_fields(type, op.msg.plain())
    if missing:
        text = f"publish.msg: defaults were taken for what is missing: {', '.join(missing)}"
        peer.warn(text, op.id)


def _publication(peer: Peer, op: ops.Publish) -> Publication:
    """The shared publisher for a topic that this client has not published on yet."""
    topic = resolve(op.topic)
    peer.role.require("publish", topic)
    publications = peer.bridge.publications
    ids = peer.advertised.get(topic)
    user = (peer, next(iter(ids))) if ids else (peer, _IMPLICIT)
    message_type = _known_type(peer, topic, op.type)
    if message_type is None:
        raise Refused(
            f"publish: cannot infer the type of {topic}, which nobody has advertised: "
            "send `advertise` first, or `type` with the message"
        )
    if not ids and topic not in peer.implicit:
        require_advertisement(peer, op.op)
    publication = publications.acquire(topic, message_type, LATCHED if op.latch else None, user)
    if not ids:
        peer.implicit.add(topic)
    return publication


def release_publishers(peer: Peer) -> None:
    """Give back everything this client published on (DIS-02)."""
    for topic, ids in peer.advertised.items():
        for id_ in ids:
            peer.bridge.publications.release(topic, (peer, id_))
    for topic in peer.implicit:
        peer.bridge.publications.release(topic, (peer, _IMPLICIT))


def on_subscribe(peer: Peer, op: ops.Subscribe) -> None:
    """Let samples of a topic flow to the client (SUB-01 … SUB-14)."""
    topic = resolve(op.topic)
    peer.role.require("subscribe", topic)
    encoding = peer.bridge.encoding_of(op.compression)
    subscription = peer.subscriptions.get(op.topic)
    if subscription is None or not subscription.has(op.id):
        require_subscription(peer)
    if subscription is None:
        message_type = _known_type(peer, topic, op.type)
        if message_type is None:
            raise Refused(
                f"subscribe: cannot infer the type of {topic}, which nobody has advertised: "
                "send `type` to wait for it"
            )
        fanout = peer.bridge.fanout(topic, message_type)
        subscription = peer.subscriptions[op.topic] = ClientSubscription(peer, op.topic, fanout)
    elif op.type:
        subscription.check_type(peer.bridge.graph.registry.message(op.type))
    subscription.put(op, encoding)


def on_unsubscribe(peer: Peer, op: ops.Unsubscribe) -> None:
    """End one subscription, or all of this client's for the topic (UNS-01 … UNS-04)."""
    subscription = peer.subscriptions.get(op.topic)
    if subscription is None or not subscription.drop(op.id):
        raise Refused(f"unsubscribe: this client has no such subscription of {op.topic}", level="warning")
    if subscription.is_empty:
        del peer.subscriptions[op.topic]


def _known_type(peer: Peer, topic: str, name: str | None) -> MessageType | None:
    """The type that the client names, or the one the graph knows."""
    if name:
        return peer.bridge.graph.registry.message(name)
    info = peer.bridge.graph.topic(topic)
    return None if info is None else info.type
