"""advertise, unadvertise, publish, subscribe, unsubscribe: the topics of one client."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final, Never

from rwt.access.client_graph import ClientGraph, ClientPublisher, UnknownTopicType
from rwt.delivery.fanout import Fanout
from rwt.delivery.shared_publishers import Lacks
from rwt.delivery.throttle import Room
from rwt.rosbridge.ops.payloads import IN_STEPS, payload_in_steps, payload_of, refusal
from rwt.rosbridge.ops.qos import incompatible_policies, publisher_qos
from rwt.rosbridge.ops.subscriptions import ClientSubscription
from rwt.rosbridge.reply import Replies
from rwt_graph.names import resolve
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import MessageType
from rwt_interfaces.validation.missing_fields import missing_fields
from rwt_protocol.codecs import Encoding
from rwt_protocol.dispatcher import Steps
from rwt_protocol.errors import Refused
from rwt_protocol.ops import Advertise, Op, Publish, Status, Subscribe, Unadvertise, Unsubscribe
from rwt_protocol.ops.light import LightPublish
from rwt_protocol.payloads import Encodable, RawJson

#: Maximum number of spellings under which one client subscribes to one topic, such as `/a`, `a` and `//a`.
_MAX_SPELLINGS: Final = 4

#: Maximum number of names, in any spelling, in a client's cache of publishers.
_MAX_NAMES: Final = 4096


class PeerTopics:
    """Topics that one client publishes and subscribes to; `queued` bytes may wait in its throttles."""

    __slots__ = (
        "_encoding_of", "_graph", "_now", "_publishers", "_replies", "_room", "_subscriptions",
    )  # fmt: skip

    def __init__(
        self, graph: ClientGraph, replies: Replies, encoding_of: Callable[[str], Encoding], queued: int
    ) -> None:
        self._graph = graph
        self._replies = replies
        self._encoding_of = encoding_of
        self._now = graph.clock.time_ns
        self._room = Room(queued)
        self._publishers: dict[str, ClientPublisher] = {}
        self._subscriptions: dict[str, ClientSubscription] = {}

    def advertise(self, op: Advertise) -> None:
        """Make the client a publisher (ADV-01 … ADV-07)."""
        is_new = not self._graph.advertises(resolve(op.topic))
        name = self._graph.advertise(op.topic, op.type, op.id, publisher_qos(op), _lacks(op))
        self.forget_publisher(name)
        if is_new:
            self._report_problems(op)

    def unadvertise(self, op: Unadvertise) -> None:
        """Withdraw one advertisement, or all of this client's for the topic (UNA-01 … UNA-03)."""
        name = resolve(op.topic)
        if not self._graph.unadvertise(name, op.id):
            raise Refused(f"unadvertise: this client does not advertise {name}", level="warning")
        self.forget_publisher(name)

    def publish(self, op: Publish | LightPublish, checked: Payload | None = None) -> Steps | None:
        """Check the message once and publish it (PUB-01 … PUB-09); a large one in steps.

        Args:
            checked: the message, if it has been checked in steps.
        """
        publisher = self._publishers.get(op.topic)
        if publisher is None or (op.qos is not None and checked is None):
            if isinstance(op, LightPublish):
                op.msg.json()  # Raises Misread before anything is created.
            publisher = self._new_publisher(op)
        raw, type_ = op.msg, publisher.type
        if isinstance(op, LightPublish):
            # Nearly all messages: as `payload_of` does, without its call.
            data = op.msg.data
            size = len(data)
            try:
                payload = Payload.from_json(type_, data, self._now)
            except InvalidMessage as error:
                op.msg.json()  # Raises Misread if the type rejected something else than a message.
                raise refusal("publish.msg", error) from None
        elif (size := raw.size) >= IN_STEPS and checked is None:
            return self._publish_in_steps(op, raw, type_)
        elif checked is not None and checked.type is type_:
            payload = checked
        else:
            payload = payload_of(type_, raw, "publish.msg", self._now)
        counts = publisher.counts
        counts.received += 1
        counts.received_bytes += size
        publisher.publish(payload)
        if self._replies.session.wants_warnings:
            self._warn_of_defaults(op, type_)
        return None

    def _publish_in_steps(self, op: Publish, raw: Encodable, type: MessageType) -> Steps:
        payload = yield from payload_in_steps(type, raw, "publish.msg", self._now)
        # The client's role or the topic may have changed meanwhile.
        self.publish(op, payload)
        yield from self._graph.late_sends(resolve(op.topic))

    def _new_publisher(self, op: Publish | LightPublish) -> ClientPublisher:
        """Return the shared publisher for a new spelling of a topic, or for new policies."""
        try:
            publisher = self._graph.publisher(op.topic, op.type, op.id, publisher_qos(op), _lacks(op))
        except UnknownTopicType as unknown:
            advice = "" if unknown.is_advertised else ": send `advertise` first, or `type` with the message"
            raise Refused(f"publish: {unknown}{advice}") from None
        if op.qos is not None:
            self.forget_publisher(publisher.topic)  # It may have replaced another publisher.
        if len(self._publishers) >= _MAX_NAMES:
            self.forget_publishers()
        self._publishers[op.topic] = publisher
        return publisher

    def _warn_of_defaults(self, op: Publish | LightPublish, type: MessageType) -> None:
        """Warn a client of fields left to their defaults, if it wants warnings (PUB-04)."""
        if isinstance(op.msg, RawJson) and op.msg.dense:
            return  # A message with missing fields that matter would have been rejected.
        missing = missing_fields(type, op.msg.plain())
        if missing:
            text = f"publish.msg: defaults were taken for what is missing: {', '.join(missing)}"
            self._replies.send(Status(level="warning", msg=text, id=op.id))

    def forget_publisher(self, topic: str) -> None:
        """Request the publisher of a topic again with the next message."""
        self._publishers = {name: held for name, held in self._publishers.items() if held.topic != topic}

    def forget_publishers(self) -> None:
        """Check the right to publish again after a change of role."""
        self._publishers.clear()

    def end_refused(self) -> None:
        """End the subscriptions that the client's role does not allow, and tell it why."""
        for name in tuple(self._subscriptions):
            if reason := self._graph.why_not_subscribe(name):
                self._ended(name, reason)

    def subscribe(self, op: Subscribe) -> Steps | None:
        """Subscribe the client to a topic (SUB-01 … SUB-14); large latched samples are encoded in steps."""
        encoding = self._encoding_of(op.compression)
        subscription = self._subscriptions.get(op.topic)
        is_new = subscription is None or not subscription.has(op.id)
        try:
            fanout = self._graph.subscribe(op.topic, op.type, is_new=is_new)
        except UnknownTopicType as unknown:
            advice = "" if unknown.is_advertised else ": send `type` to wait for it"
            raise Refused(f"subscribe: {unknown}{advice}") from None
        if subscription is None:
            self._check_spellings(fanout, op.topic)
            subscription = self._subscriptions[op.topic] = ClientSubscription(
                self._graph, self._replies, op.topic, fanout, self._room, partial(self._ended, op.topic)
            )
        subscription.put(op, encoding)
        if is_new:
            self._report_problems(op)
        return fanout.late.steps() if fanout.late.waiting else None

    def _ended(self, name: str, reason: str) -> None:
        """End the subscriptions under one spelling: the robot gives the topic another type."""
        self._subscriptions.pop(name).close()
        self._replies.refuse(Status(level="error", msg=f"subscribe: {reason}"))

    def _report_problems(self, op: Advertise | Subscribe) -> None:
        for text in self._graph.problems(op.topic):
            self._replies.send(Status(level="warning", msg=text, id=op.id))

    def report_problem(self, topic: str, text: str) -> None:
        """Send a new problem of a topic that the client subscribes to or advertises; no-op for others."""
        names = (*self._subscriptions, *self._publishers)
        if self._graph.advertises(topic) or topic in map(resolve, names):
            self._replies.send(Status(level="warning", msg=text))

    def _check_spellings(self, fanout: Fanout, name: str) -> None:
        """Reject excessive spellings of a topic: each is a stream of its own (PUB-09)."""
        spellings = [held for held, known in self._subscriptions.items() if known.fanout is fanout]
        if len(spellings) >= _MAX_SPELLINGS:
            self._graph.unsubscribe(fanout)
            raise Refused(
                f"subscribe: {name}: this client hears of the topic under {len(spellings)} names already: "
                f"{', '.join(sorted(spellings))}; use one of them"
            )

    def unsubscribe(self, op: Unsubscribe) -> None:
        """End one subscription, or all of this client's for the topic (UNS-01 … UNS-04)."""
        subscription = self._subscriptions.get(op.topic)
        if subscription is None or not subscription.drop(op.id):
            raise Refused(f"unsubscribe: this client has no such subscription of {op.topic}", level="warning")
        if subscription.is_empty:
            del self._subscriptions[op.topic]

    def close(self) -> Steps:
        """End the subscriptions; publishers end with the client's graph (DIS-01)."""
        while self._subscriptions:
            self._subscriptions.popitem()[1].close()
            yield


def _lacks(op: Advertise | Publish | LightPublish) -> Lacks | None:
    """Return a function that lists a publisher's missing policies; None if the client requests none."""
    return partial(incompatible_policies, op.qos) if op.qos else None


HANDLERS: Final[Mapping[type[Op], Callable[[PeerTopics, Never], Steps | None]]] = {
    Advertise: PeerTopics.advertise,
    Unadvertise: PeerTopics.unadvertise,
    Publish: PeerTopics.publish,
    Subscribe: PeerTopics.subscribe,
    Unsubscribe: PeerTopics.unsubscribe,
}
