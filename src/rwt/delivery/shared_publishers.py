"""Publishers that clients share: one per topic, however many clients advertise it (ADV-03)."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Final

from rwt.delivery.drop_notices import LOG_SECONDS, DeadlineWatch
from rwt_graph.api import Participant, Publisher, Sample
from rwt_graph.errors import GraphError, TypeConflict
from rwt_participant.qos import Durability, History, QoS
from rwt_protocol.states import StateEnum

if TYPE_CHECKING:
    from rwt.delivery.counters import Counters
    from rwt_graph.accounts import OpenCharge
    from rwt_graph.clock import Clock
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import MessageType
    from rwt_participant.timers import Timer

logger = logging.getLogger(__name__)

OnEnd = Callable[[str], None]
"""Function that is told why a publisher has ended."""

Lacks = Callable[[QoS], str]
"""Function that names the requested policies that a publisher does not offer; empty if there are none."""


class IncompatiblePolicies(GraphError):
    """Other clients publish on the topic with incompatible policies."""


_LAST_SEQUENCE: Final = (1 << 32) - 1
"""Maximum of `header.seq`, which then restarts at zero."""


class _PublisherState(StateEnum):
    USED = "LINGERING", "CLOSED"
    LINGERING = "USED", "CLOSED"
    CLOSED = ()


class SharedPublisher:
    """Publisher of one topic, with the clients that use it.

    Life cycle::

        USED ── last user leaves ──> LINGERING ── timer ──> CLOSED
         │^──── used again ──────────────┘                    ^
         └────── other policies, may no longer be latched ────┘

    * **USED**: it has ``users``, or is about to get its first.
    * **LINGERING**: ``_linger`` closes it, unless it is used again. ``lingers_for`` are the charges of its
      last users.
    * **CLOSED**: users that remain must request the publisher again. If the robot uses the topic with another
      type, all users are told why, and none remains.

    During its first `STARTUP_SECONDS`, unless the topic is latched, ``_startup`` keeps messages for late
    subscribers.

    Private attributes: ``_sequence`` (last `header.seq`), ``_logged`` (monotonic time of the last log line
    about the deadline), ``_kept`` (charges of retained messages of a latched topic, oldest first).

    Attributes:
        users: clients that use it, each with a function that is told why the publisher has ended.
        publish: publishes a message, which the caller counts. Not a method, since it runs for every message:
            the publisher's own function, or :meth:`_publish` while a message needs more.
        deadline: checks that clients publish as often as they promised; None without a deadline.
    """

    __slots__ = (
        "_clock", "_counters", "_kept", "_linger", "_log", "_logged", "_sequence", "_startup",
        "_startup_timer", "_state", "counts", "deadline", "lingers_for", "publish", "publisher", "topic",
        "type", "users",
    )  # fmt: skip

    def __init__(
        self, publisher: Publisher, node: str, clock: Clock, counters: Counters, log: Callable[[str], None]
    ) -> None:
        self.publisher = publisher
        self.topic = publisher.topic
        self.type = publisher.type
        self.users: dict[Hashable, OnEnd] = {}
        self._state = _PublisherState.USED
        self._linger: Timer | None = None
        self.lingers_for: list[OpenCharge] = []
        self._clock = clock
        self._counters = counters
        self._log = log
        self._logged = float("-inf")
        self.counts = counters.use_topic(publisher.topic)
        seconds = publisher.qos.deadline
        self.deadline = DeadlineWatch(clock, seconds, self._missed) if seconds else None
        self._sequence = 0
        self._kept: deque[OpenCharge] = deque()
        self._startup: _StartupBuffer | None = None
        self._startup_timer: Timer | None = None
        if publisher.qos.durability is not Durability.TRANSIENT_LOCAL:
            self._startup = _StartupBuffer(publisher.topic, node)
            self._startup_timer = clock.call_later(STARTUP_SECONDS, self.end_startup)
        # Replaced by the graph's own function as soon as a message needs no more: see _choose_publish().
        self.publish: Callable[[Payload], None] = self._publish
        self._choose_publish()

    def use(self, user: Hashable, on_end: OnEnd) -> None:
        """Add a user; the charges of former users end."""
        if self._state is _PublisherState.LINGERING:
            self._state = self._state.become(_PublisherState.USED)
            self._stop_lingering()
        self.users[user] = on_end

    def linger(self, seconds: float, charge: OpenCharge, close: Callable[[], None]) -> None:
        """Call `close` in a while, unless it is used again: the last user has left its charge."""
        self._state = self._state.become(_PublisherState.LINGERING)
        self.lingers_for.append(charge)
        self.end_startup()
        self._linger = self._clock.call_later(seconds, close)

    def _stop_lingering(self) -> None:
        if self._linger is not None:
            self._linger.cancel()
            self._linger = None
        settled, self.lingers_for = self.lingers_for, []
        for each in settled:
            each.end()

    def _choose_publish(self) -> None:
        if self._startup is None and self.deadline is None and not self.type.has_sequence:
            self.publish = self.publisher.publish

    def _publish(self, payload: Payload) -> None:
        if self.type.has_sequence:
            # As ROS 1's publishers do: from 1 on, whatever the client sends.
            self._sequence = (self._sequence + 1) & _LAST_SEQUENCE
            payload = payload.numbered(self._sequence)
        if self.deadline is not None:
            self.deadline.met()
        self.publisher.publish(payload)
        # After publishing, so that the copy does not delay subscribers.
        if self._startup is not None:
            self._startup.add(payload, self._clock.time_ns())

    @property
    def keeps_samples(self) -> bool:
        """True if the graph retains the publisher's samples for late subscribers."""
        return self.publisher.qos.durability is Durability.TRANSIENT_LOCAL

    @property
    def kept_next_to_go(self) -> OpenCharge | None:
        """Charge of the sample that the next one replaces; None while there is room."""
        qos = self.publisher.qos
        full = qos.history is History.KEEP_LAST and len(self._kept) >= qos.depth
        return self._kept[0] if full else None

    def publish_kept(self, payload: Payload, kept: OpenCharge) -> None:
        """Publish a message of a latched topic; the charge `kept` ends when it is no longer retained."""
        if self.kept_next_to_go is not None:
            self._kept.popleft().end()
        self._kept.append(kept)
        self.publish(payload)

    @property
    def startup_samples(self) -> tuple[Sample, ...]:
        """Samples of the first second, oldest first (ADV-08); none of latched topics."""
        return () if self._startup is None else self._startup.samples()

    def end_startup(self) -> None:
        """Drop the samples for late subscribers: the first second is over, or all users have left."""
        self._startup = None
        self._choose_publish()

    def _missed(self) -> None:
        if not self.users:
            return
        self._counters.missed_deadlines += 1
        now = self._clock.monotonic()
        if now - self._logged >= LOG_SECONDS:
            self._logged = now
            seconds = self.publisher.qos.deadline
            self._log(f"{self.topic}: no message within the deadline of {seconds:g} s")

    def close(self) -> None:
        """Stop publishing on the topic."""
        self._state = self._state.become(_PublisherState.CLOSED)
        self._stop_lingering()
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
    """Shared publishers of one gateway.

    A publisher outlives its last user by `linger` seconds: a client that reconnects finds its topic, and
    latched samples survive a page reload (UNA-04, DIS-02).
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
        """Return the samples of the publisher of `topic` during its first second."""
        shared = self._by_topic.get(topic)
        return () if shared is None else shared.startup_samples

    def acquire(
        self,
        topic: str,
        type: MessageType,
        qos: QoS | None,
        user: Hashable,
        on_end: OnEnd,
        lacks: Lacks | None = None,
    ) -> SharedPublisher:
        """Use the topic's publisher, which is created with `qos` if needed: the first use decides (ADV-07).

        Args:
            qos: policies for a new publisher; None for the graph's default.
            on_end: called with the reason if the robot uses the topic with another type: the user has no
                publisher then, and must end its charge.
            lacks: names the requested policies that the publisher does not offer (ADV-11). A publisher
                without other users is then replaced.

        Raises:
            TypeConflict: the topic has another type.
            IncompatiblePolicies: the publisher has other users and incompatible policies.
        """
        shared = self._by_topic.get(topic)
        if shared is not None and lacks is not None and (lacking := lacks(shared.publisher.qos)):
            if shared.users.keys() - {user}:  # A sole user may change its policies: no other relies on them.
                raise IncompatiblePolicies(
                    f"{topic} is published here with other policies: {lacking}; "
                    "leave `qos` out to publish with these"
                )
            self._end(topic, shared)
            shared = None
        if shared is None:
            policies = () if qos is None else (qos,)
            publisher = self._participant.advertise(topic, type, *policies)
            shared = self._by_topic[topic] = SharedPublisher(
                publisher, self._participant.name, self._clock, self._counters, self._log
            )
            publisher.on_displaced = partial(self._on_displaced, topic, shared)
        elif shared.type.name != type.name:
            raise TypeConflict(topic, type.name, shared.type.name)
        shared.use(user, on_end)
        return shared

    def _on_displaced(self, topic: str, shared: SharedPublisher, reason: str) -> None:
        users, shared.users = shared.users, {}
        self._end(topic, shared)
        for on_end in users.values():
            try:
                on_end(reason)
            except Exception:
                logger.exception("a publisher's user failed on the end of %s", topic)

    def lingering(self, topic: str) -> OpenCharge | None:
        """Return the first charge of a publisher without users; None if there is none."""
        shared = self._by_topic.get(topic)
        return shared.lingers_for[0] if shared is not None and shared.lingers_for else None

    def linger_for(self, topic: str, charge: OpenCharge) -> None:
        """Add a charge to a publisher without users; end the charge if there is no such publisher."""
        shared = self._by_topic.get(topic)
        if shared is None or shared.users:
            charge.end()
        else:
            shared.lingers_for.append(charge)

    def release(self, topic: str, user: Hashable, charge: OpenCharge) -> None:
        """Stop using the topic's publisher. Unknown topics and users are ignored.

        The charge ends now if the publisher has other users, else when it closes or is used again.
        """
        shared = self._by_topic.get(topic)
        if shared is None or user not in shared.users:
            # The user was released already, or end_latched() has closed the publisher.
            charge.end()
            return
        del shared.users[user]
        if shared.users:
            charge.end()
        else:
            shared.linger(self._linger, charge, lambda: self._end(topic, shared))

    def end_latched(self, may_latch: Callable[[str], bool]) -> None:
        """Close the latched publishers of topics that may no longer be latched, with what they retain.

        Their users stay, and must request the publisher again: then it is not latched.
        """
        # A copy, since closing a publisher removes it.
        for topic, shared in list(self._by_topic.items()):
            if shared.keeps_samples and not may_latch(topic):
                self._end(topic, shared)

    def close(self) -> None:
        """Close every publisher."""
        for topic, shared in list(self._by_topic.items()):
            self._end(topic, shared)

    def _end(self, topic: str, shared: SharedPublisher) -> None:
        del self._by_topic[topic]
        shared.close()


STARTUP_SECONDS: Final = 1.0
"""Time for which a new publisher's samples are kept for late subscribers."""

_MAX_SAMPLES: Final = 100
_MAX_BYTES: Final = 64 * 1024


@dataclass(slots=True, eq=False)
class _StartupBuffer:
    """Samples of a publisher's first second (ADV-08); only the newest if they are many or large.

    A program that publishes right after advertising cannot know whether its subscribers are connected yet.
    """

    topic: str
    node: str
    _kept: deque[tuple[Payload, int, int]] = field(default_factory=deque)
    _size: int = 0

    def add(self, payload: Payload, stamp_ns: int) -> None:
        """Keep a message, and drop older ones to make room; a message that is too large drops all.

        Keeping a message copies it out of its receive buffer, which would be too slow for large streams.
        """
        size = payload.kept_size
        if size > _MAX_BYTES:
            self._kept.clear()
            self._size = 0
            return
        kept = self._kept
        kept.append((payload.detach(), stamp_ns, size))
        self._size += size
        while len(kept) > _MAX_SAMPLES or self._size > _MAX_BYTES:
            self._size -= kept.popleft()[2]

    def samples(self) -> tuple[Sample, ...]:
        """Return the kept samples, oldest first."""
        return tuple(Sample(self.topic, payload, stamp_ns, self.node) for payload, stamp_ns, _ in self._kept)
