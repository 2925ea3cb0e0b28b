"""The publishers that clients share: one per topic, however many clients advertise it (ADV-03)."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Final, Protocol

from rwt.delivery.deadline import DeadlineWatch
from rwt.delivery.drop_notices import LOG_SECONDS
from rwt_graph.api import Sample
from rwt_graph.errors import GraphError, TypeConflict
from rwt_participant.qos import Durability, History, QoS

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from rwt.delivery.counters import Counters
    from rwt_graph.api import Participant, Publisher
    from rwt_graph.clock import Clock
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import MessageType
    from rwt_participant.timers import Timer

    Lacks = Callable[[QoS], str]
    """Which of the policies that a client asks for a publisher does not offer, in words; empty if none."""
    from rwt_graph.api import Sample


class Ends(Protocol):
    """What counts something until it is ended."""

    def end(self) -> None:
        """Count it no more."""


class IncompatiblePolicies(GraphError):
    """Other clients publish on the topic with other policies than those that are asked for."""


#: After it `header.seq` starts at zero.
_LAST_SEQUENCE = (1 << 32) - 1


class SharedPublisher:
    """The publisher of one topic, with the clients that use it and the timer that ends it.

    Attributes:
        publish: hands on a message, which its caller counts.
        counts: of the topic.
        deadline: watches that clients publish as often as they promised.
        users: what the publisher was acquired for.
        linger: ends a publisher that has no users.
        lingers_for: what is ended when a publisher without users ends, or has users again.
    """

    __slots__ = (
        "_clock", "_counters", "_kept", "_log", "_logged", "_publish", "_publish_next",
        "_sequence", "_startup", "_startup_timer",
        "counts", "deadline", "linger", "lingers_for", "publish", "publisher", "topic", "type", "users",
    )  # fmt: skip

    def __init__(
        self, publisher: Publisher, node: str, clock: Clock, counters: Counters, log: Callable[[str], None]
    ) -> None:
        self.publisher = publisher
        self.topic = publisher.topic
        self.type = publisher.type
        self.users: set[Hashable] = set()
        self.linger: Timer | None = None
        self.lingers_for: list[Ends] = []
        self._clock = clock
        self._counters = counters
        self._log = log
        self._logged = float("-inf")
        self.counts = counters.use_topic(publisher.topic)
        seconds = publisher.qos.deadline
        self.deadline = DeadlineWatch(clock, seconds, self._missed) if seconds else None
        self._publish = publisher.publish if self.deadline is None else self._publish_in_time
        self._sequence = 0
        self._publish_next: Callable[[Payload], None] = self._publish
        self._kept: deque[Ends] = deque()
        self._startup: StartupBuffer | None = None
        self._startup_timer: Timer | None = None
        if publisher.qos.durability is not Durability.TRANSIENT_LOCAL:
            self._startup = StartupBuffer(publisher.topic, node)
            self._publish_next = self._publish_at_startup
            self._startup_timer = clock.call_later(STARTUP_SECONDS, self.end_startup)
        self.publish = self._publish_numbered if self.type.has_sequence else self._publish_next

    @property
    def keeps_samples(self) -> bool:
        """Whether the graph keeps the publisher's samples for late readers."""
        return self.publisher.qos.durability is Durability.TRANSIENT_LOCAL

    @property
    def kept_next_to_go(self) -> Ends | None:
        """What was given with the sample that gives way to the next one; None while there is room."""
        qos = self.publisher.qos
        full = qos.history is History.KEEP_LAST and len(self._kept) >= qos.depth
        return self._kept[0] if full else None

    def publish_kept(self, payload: Payload, kept: Ends) -> None:
        """Hand on a message of a latched topic.

        Args:
            payload: the message.
            kept: ended when the message is not kept any more.
        """
        if self.kept_next_to_go is not None:
            self._kept.popleft().end()
        self._kept.append(kept)
        self.publish(payload)

    @property
    def startup_samples(self) -> tuple[Sample, ...]:
        """The samples of the first second, oldest first (ADV-08); none of latched topics."""
        return () if self._startup is None else self._startup.samples()

    def _publish_at_startup(self, payload: Payload) -> None:
        self._publish(payload)
        if self._startup is not None:
            self._startup.add(payload, self._clock.time_ns())

    def end_startup(self) -> None:
        """Keep nothing for late readers: the first second is over, or all users have left."""
        self._startup = None
        self._publish_next = self._publish
        if not self.type.has_sequence:
            self.publish = self._publish

    def _publish_numbered(self, payload: Payload) -> None:
        """Count in `header.seq` as ROS 1's publishers do, from 1 on, whatever the client wrote."""
        self._sequence = (self._sequence + 1) & _LAST_SEQUENCE
        self._publish_next(payload.numbered(self._sequence))

    def _publish_in_time(self, payload: Payload) -> None:
        if self.deadline is not None:
            self.deadline.met()
        self.publisher.publish(payload)

    def _missed(self) -> None:
        if not self.users:
            return
        self._counters.missed_deadlines += 1
        now = self._clock.monotonic()
        if now - self._logged >= LOG_SECONDS:
            self._logged = now
            seconds = self.publisher.qos.deadline
            self._log(f"nothing came for {self.topic} within its deadline of {seconds:g} s")

    def settle(self) -> None:
        """Tell those who have left that the publisher is at nobody's cost but its users'."""
        settled, self.lingers_for = self.lingers_for, []
        for each in settled:
            each.end()

    def close(self) -> None:
        """Leave the topic."""
        self.settle()
        if self.linger is not None:
            self.linger.cancel()
        if self.deadline is not None:
            self.deadline.close()
        if self._startup_timer is not None:
            self._startup_timer.cancel()
        self.end_startup()
        while self._kept:
            self._kept.popleft().end()
        self._counters.release_topic(self.counts)
        self.publisher.close()


class SharedPublishers:
    """All shared publishers of one gateway.

    A publisher outlives its last user by `linger` seconds, so that a client which reconnects finds its topic,
    and latched samples outlive a page reload (UNA-04, DIS-02).
    """

    def __init__(
        self,
        participant: Participant,
        clock: Clock,
        linger: float,
        counters: Counters,
        log: Callable[[str], None],
    ) -> None:
        self._participant = participant
        self._clock = clock
        self._linger = linger
        self._counters = counters
        self._log = log
        self._by_topic: dict[str, SharedPublisher] = {}

    def __contains__(self, topic: str) -> bool:
        return topic in self._by_topic

    def startup_samples(self, topic: str) -> tuple[Sample, ...]:
        """The samples of the first second of the publisher of `topic`, while that lasts."""
        shared = self._by_topic.get(topic)
        return () if shared is None else shared.startup_samples

    def acquire(
        self,
        topic: str,
        type: MessageType,
        qos: QoS | None,
        user: Hashable,
        lacks: Lacks | None = None,
    ) -> SharedPublisher:
        """Use the topic's publisher, made with `qos` if there is none yet: the first use decides (ADV-07).

        Args:
            lacks: tells the policies that the publisher has to have and has not (ADV-11). A publisher that
                nobody else uses is replaced.

        Raises:
            TypeConflict: the topic has another type.
            IncompatiblePolicies: others use the publisher, and it has other policies.
        """
        shared = self._by_topic.get(topic)
        if shared is not None and lacks is not None and (lacking := lacks(shared.publisher.qos)):
            if shared.users - {user}:
                raise IncompatiblePolicies(
                    f"{topic} is published here with other policies: {lacking}; "
                    "leave `qos` out to publish with these"
                )
            self._end(topic, shared)
            shared = None
        if shared is None:
            publisher = (
                self._participant.advertise(topic, type)
                if qos is None
                else self._participant.advertise(topic, type, qos)
            )
            shared = self._by_topic[topic] = SharedPublisher(
                publisher, self._participant.name, self._clock, self._counters, self._log
            )
        elif shared.type.name != type.name:
            raise TypeConflict(topic, type.name, shared.type.name)
        if shared.linger is not None:
            shared.linger.cancel()
            shared.linger = None
            shared.settle()
        shared.users.add(user)
        return shared

    def lingering(self, topic: str) -> Ends | None:
        """What a publisher without users lingers for; None where there is none."""
        shared = self._by_topic.get(topic)
        return shared.lingers_for[0] if shared is not None and shared.lingers_for else None

    def linger_for(self, topic: str, charge: Ends) -> None:
        """Let a publisher linger for `charge`, which is ended at once where none lingers."""
        shared = self._by_topic.get(topic)
        if shared is None or shared.users:
            charge.end()
        else:
            shared.lingers_for.append(charge)

    def release(self, topic: str, user: Hashable, charge: Ends) -> None:
        """Stop using the topic's publisher; unknown topics and users are ignored.

        Args:
            charge: ended when the publisher is not kept for this user: at once if it has others, else when
                it ends or is used again.
        """
        shared = self._by_topic.get(topic)
        if shared is None or user not in shared.users:
            charge.end()
            return
        shared.users.discard(user)
        if shared.users:
            charge.end()
        else:
            shared.lingers_for.append(charge)
            shared.end_startup()
            shared.linger = self._clock.call_later(self._linger, lambda: self._end(topic, shared))

    def close(self) -> None:
        """End every publisher at once."""
        for topic, shared in list(self._by_topic.items()):
            self._end(topic, shared)

    def _end(self, topic: str, shared: SharedPublisher) -> None:
        if self._by_topic.get(topic) is shared:
            del self._by_topic[topic]
        shared.close()


STARTUP_SECONDS: Final = 1.0
"""How long after its creation a publisher's samples are kept for readers that come late."""

_MOST_SAMPLES: Final = 100
_MOST_BYTES: Final = 64 * 1024


class StartupBuffer:
    """The samples of one publisher's first second (ADV-08), the newest of them where they are many or large.

    A program that advertises and publishes at once cannot know whether its readers have subscribed yet.
    """

    __slots__ = ("_kept", "_node", "_size", "_topic")

    def __init__(self, topic: str, node: str) -> None:
        self._topic = topic
        self._node = node
        self._kept: deque[tuple[Payload, int, int]] = deque()
        self._size = 0

    def add(self, payload: Payload, stamp_ns: int) -> None:
        """Keep a message that was published at that time, and forget older ones for it; all of them for one
        that is too large.

        To keep one is to copy it out of its receive buffer, which large streams must not pay for.
        """
        size = payload.kept_size
        if size > _MOST_BYTES:
            self._kept.clear()
            self._size = 0
            return
        kept = self._kept
        kept.append((payload.detach(), stamp_ns, size))
        self._size += size
        while len(kept) > _MOST_SAMPLES or self._size > _MOST_BYTES:
            self._size -= kept.popleft()[2]

    def samples(self) -> tuple[Sample, ...]:
        """What is kept, oldest first."""
        return tuple(
            Sample(self._topic, payload, stamp_ns, self._node) for payload, stamp_ns, _ in self._kept
        )
