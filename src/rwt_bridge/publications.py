"""The publishers that rosbridge clients share: one per topic, however many clients advertise it (ADV-03)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_graph.errors import TypeConflict

if TYPE_CHECKING:
    from collections.abc import Hashable

    from rwt_graph.api import Participant, Publisher
    from rwt_graph.clock import Clock, Timer
    from rwt_graph.qos import QoS
    from rwt_interfaces.structs import MessageType


class _Publication:
    """One shared publisher, who uses it, and the timer that ends it."""

    __slots__ = ("linger", "publisher", "users")

    def __init__(self, publisher: Publisher) -> None:
        self.publisher = publisher
        self.users: set[Hashable] = set()
        self.linger: Timer | None = None


class Publications:
    """All shared publishers of one bridge.

    A publisher stays `linger` seconds after its last user has left, so that a client which reconnects finds
    its topic, and latched samples outlive a page reload (UNA-04, DIS-02).
    """

    def __init__(self, participant: Participant, clock: Clock, linger: float) -> None:
        self._participant = participant
        self._clock = clock
        self._linger = linger
        self._by_topic: dict[str, _Publication] = {}

    def __contains__(self, topic: str) -> bool:
        return topic in self._by_topic

    def acquire(self, topic: str, type: MessageType, qos: QoS | None, user: Hashable) -> Publisher:
        """Use the topic's publisher, made with `qos` if there is none yet: the first use decides (ADV-07).

        Raises:
            TypeConflict: the topic has another type.
        """
        publication = self._by_topic.get(topic)
        if publication is None:
            publisher = (
                self._participant.advertise(topic, type)
                if qos is None
                else self._participant.advertise(topic, type, qos)
            )
            publication = self._by_topic[topic] = _Publication(publisher)
        elif publication.publisher.type.name != type.name:
            raise TypeConflict(
                f"tried to register topic {topic} with type {type.name} "
                f"but it is already established with type {publication.publisher.type.name}"
            )
        if publication.linger is not None:
            publication.linger.cancel()
            publication.linger = None
        publication.users.add(user)
        return publication.publisher

    def release(self, topic: str, user: Hashable) -> None:
        """Stop using the topic's publisher; unknown topics and users are ignored."""
        publication = self._by_topic.get(topic)
        if publication is None or user not in publication.users:
            return
        publication.users.discard(user)
        if not publication.users:
            publication.linger = self._clock.call_later(self._linger, lambda: self._end(topic, publication))

    def close(self) -> None:
        """End every publisher at once."""
        for topic, publication in list(self._by_topic.items()):
            if publication.linger is not None:
                publication.linger.cancel()
            self._end(topic, publication)

    def _end(self, topic: str, publication: _Publication) -> None:
        if self._by_topic.get(topic) is publication:
            del self._by_topic[topic]
        publication.publisher.close()
