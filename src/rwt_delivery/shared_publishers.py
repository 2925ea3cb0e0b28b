"""The publishers that rosbridge clients share: one per topic, however many clients advertise it (ADV-03)."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from rwt_access.audit import write
from rwt_bridge.ops.qos import disagreement
from rwt_delivery.deadline import DeadlineWatch
from rwt_delivery.drop_notices import LOG_SECONDS
from rwt_delivery.startup_buffer import SECONDS as EARLY_SECONDS
from rwt_delivery.startup_buffer import EarlySamples
from rwt_graph.api import Sample
from rwt_graph.errors import TypeConflict
from rwt_program.qos import Durability
from rwt_protocol.errors import Refused

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from rwt_delivery.counters import Ledger
    from rwt_graph.api import Participant, Publisher
    from rwt_graph.clock import Clock, Timer
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import MessageType
    from rwt_program.qos import QoS
    from rwt_protocol.ops.topics import Qos


class Publication:
    """One shared publisher, who uses it, and the timer that ends it.

    Attributes:
        publish: hands on a message, which its caller counts.
        counts: what is counted of the topic.
        deadline: watches that clients publish as often as they said they would.
    """

    __slots__ = (
        "_clock",
        "_early",
        "_early_timer",
        "_ledger",
        "_logged",
        "_node",
        "_publish",
        "counts",
        "deadline",
        "linger",
        "publish",
        "publisher",
        "topic",
        "type",
        "users",
    )

    def __init__(self, publisher: Publisher, node: str, clock: Clock, ledger: Ledger) -> None:
        self.publisher = publisher
        self.topic = publisher.topic
        self.type = publisher.type
        self.users: set[Hashable] = set()
        self.linger: Timer | None = None
        self._clock = clock
        self._ledger = ledger
        self._logged = float("-inf")
        self.counts = ledger.use_topic(publisher.topic)
        seconds = publisher.qos.deadline
        self.deadline = DeadlineWatch(clock, seconds, self._late) if seconds else None
        self._publish = publisher.publish if self.deadline is None else self._publish_in_time
        self.publish: Callable[[Payload], None] = self._publish
        self._node = node
        self._early: EarlySamples | None = None
        self._early_timer: Timer | None = None
        if publisher.qos.durability is not Durability.TRANSIENT_LOCAL:
            self._early = EarlySamples()
            self.publish = self._publish_early
            self._early_timer = clock.call_later(EARLY_SECONDS, self.forget_early)

    @property
    def early(self) -> tuple[Sample, ...]:
        """What late readers still get of the first second, oldest first (ADV-08); nothing of latched topics,
        whose samples the graph keeps."""
        return () if self._early is None else self._early.samples()

    def _publish_early(self, payload: Payload) -> None:
        self._publish(payload)
        if self._early is not None:
            sample = Sample(self.topic, payload, self._clock.time_ns(), self._node)
            self._early.add(sample, len(payload.json()))

    def forget_early(self) -> None:
        """Keep nothing for late readers: the first second is over, or everybody who published has left."""
        self._early = None
        self.publish = self._publish

    def _publish_in_time(self, payload: Payload) -> None:
        if self.deadline is not None:
            self.deadline.met()
        self.publisher.publish(payload)

    def _late(self) -> None:
        if not self.users:
            return
        self._ledger.missed_deadlines += 1
        now = self._clock.monotonic()
        if now - self._logged >= LOG_SECONDS:
            self._logged = now
            seconds = self.publisher.qos.deadline
            write(logging.INFO, "nothing came for %s within its deadline of %g s", self.topic, seconds)

    def close(self) -> None:
        """Leave the topic."""
        if self.linger is not None:
            self.linger.cancel()
        if self.deadline is not None:
            self.deadline.close()
        if self._early_timer is not None:
            self._early_timer.cancel()
        self.forget_early()
        self._ledger.release_topic(self.counts)
        self.publisher.close()


class Publications:
    """All shared publishers of one bridge.

    A publisher stays `linger` seconds after its last user has left, so that a client which reconnects finds
    its topic, and latched samples outlive a page reload (UNA-04, DIS-02).
    """

    def __init__(self, participant: Participant, clock: Clock, linger: float, ledger: Ledger) -> None:
        self._ledger = ledger
        self._participant = participant
        self._clock = clock
        self._linger = linger
        self._by_topic: dict[str, Publication] = {}

    def __contains__(self, topic: str) -> bool:
        return topic in self._by_topic

    def early(self, topic: str) -> tuple[Sample, ...]:
        """What clients published on `topic` in the first second of their publisher, while that lasts."""
        publication = self._by_topic.get(topic)
        return () if publication is None else publication.early

    def acquire(
        self,
        topic: str,
        type: MessageType,
        qos: QoS | None,
        user: Hashable,
        wish: Qos | None = None,
    ) -> Publication:
        """Use the topic's publisher, made with `qos` if there is none yet: the first use decides (ADV-07).

        Args:
            wish: policies that the publisher has to have (ADV-11). One that nobody else uses is replaced.

        Raises:
            TypeConflict: the topic has another type.
            Refused: others use the publisher, and it has other policies.
        """
        publication = self._by_topic.get(topic)
        if publication is not None and wish is not None and not self._offers(publication, wish, user):
            self._end(topic, publication)
            publication = None
        if publication is None:
            publisher = (
                self._participant.advertise(topic, type)
                if qos is None
                else self._participant.advertise(topic, type, qos)
            )
            publication = self._by_topic[topic] = Publication(
                publisher, self._participant.name, self._clock, self._ledger
            )
        elif publication.type.name != type.name:
            raise TypeConflict(
                f"tried to register topic {topic} with type {type.name} "
                f"but it is already established with type {publication.type.name}"
            )
        if publication.linger is not None:
            publication.linger.cancel()
            publication.linger = None
        publication.users.add(user)
        return publication

    def _offers(self, publication: Publication, wish: Qos, user: Hashable) -> bool:
        """Whether a publisher has the policies of `wish`; False if it has not, and may be replaced."""
        problem = disagreement(wish, publication.publisher.qos)
        if problem and publication.users - {user}:
            raise Refused(
                f"advertise.qos: {publication.topic} is published here with other policies: {problem}; "
                "leave `qos` out to publish with these"
            )
        return not problem

    def release(self, topic: str, user: Hashable) -> None:
        """Stop using the topic's publisher; unknown topics and users are ignored."""
        publication = self._by_topic.get(topic)
        if publication is None or user not in publication.users:
            return
        publication.users.discard(user)
        if not publication.users:
            publication.forget_early()
            publication.linger = self._clock.call_later(self._linger, lambda: self._end(topic, publication))

    def close(self) -> None:
        """End every publisher at once."""
        for topic, publication in list(self._by_topic.items()):
            self._end(topic, publication)

    def _end(self, topic: str, publication: Publication) -> None:
        if self._by_topic.get(topic) is publication:
            del self._by_topic[topic]
        publication.close()
