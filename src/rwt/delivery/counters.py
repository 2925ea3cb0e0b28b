"""Counters of a gateway: integers on objects that the hot path uses anyway."""

from __future__ import annotations

from dataclasses import dataclass, field

from rwt_transports.endpoint import DropReason, Traffic

MAX_TOPICS = 1000
"""Maximum number of topics with counters; clients choose the names. Unused ones are removed first."""


UNKNOWN = "unknown"
"""Op counted for messages whose op is unknown."""


@dataclass(slots=True, eq=False)
class EncodingCounts:
    """Counters of a topic in one encoding: encoded samples, and frames and bytes handed to clients."""

    encodes: int = 0
    messages: int = 0
    bytes: int = 0


@dataclass(slots=True, eq=False)
class TopicCounts:
    """Counters of a topic.

    Attributes:
        received: messages that clients published.
        received_bytes: bytes of their payloads as received.
        sent: counters by encoding.
        dropped: samples that were not sent to a client, by reason.
        users: number of shared publishers and fan-outs that use the counters.
    """

    topic: str
    received: int = 0
    received_bytes: int = 0
    sent: dict[str, EncodingCounts] = field(default_factory=dict)
    dropped: dict[DropReason, int] = field(default_factory=dict)
    users: int = 0

    def encoding(self, name: str) -> EncodingCounts:
        """Return the counters of an encoding."""
        return self.sent.setdefault(name, EncodingCounts())

    def drop(self, reason: DropReason) -> None:
        """Count a sample that was not sent to a client."""
        self.dropped[reason] = self.dropped.get(reason, 0) + 1


@dataclass(slots=True, eq=False)
class Counters:
    """Counters of a gateway.

    Attributes:
        topics: counters by absolute name.
        refusals: rejections by op; unknown ops count as `unknown`.
        clients: number of clients since the start.
        present: number of present clients without a connection (HTTP).
        missed_deadlines: deadlines of publishers and of subscriptions.
        received: messages of clients that have left, and requests.
        received_bytes: bytes read from them, and of the bodies of requests.
        sent: messages to clients that have left, and answers to requests.
        sent_bytes: bytes written to them, and of the bodies of answers.
    """

    topics: dict[str, TopicCounts] = field(default_factory=dict)
    refusals: dict[str, int] = field(default_factory=dict)
    clients: int = 0
    present: int = 0
    calls: int = 0
    goals: int = 0
    missed_deadlines: int = 0
    received: int = 0
    received_bytes: int = 0
    sent: int = 0
    sent_bytes: int = 0
    _unused: dict[str, None] = field(default_factory=dict, init=False)

    def use_topic(self, name: str) -> TopicCounts:
        """Return the counters of a topic, which last at least until :meth:`release_topic`."""
        counts = self.topics.get(name)
        if counts is None:
            if len(self.topics) >= MAX_TOPICS:
                self._forget_one()
            counts = self.topics[name] = TopicCounts(name)
        if not counts.users:
            self._unused.pop(name, None)
        counts.users += 1
        return counts

    def release_topic(self, counts: TopicCounts) -> None:
        """Undo :meth:`use_topic`; the counts stay."""
        counts.users -= 1
        if not counts.users:
            self._unused[counts.topic] = None

    def _forget_one(self) -> None:
        # No search among all topics: with 10,000 in use, it would dominate the cost of a new one.
        name = next(iter(self._unused), None)
        if name is not None:
            del self._unused[name], self.topics[name]

    def refuse(self, op: str) -> None:
        """Count a refused op."""
        self.refusals[op] = self.refusals.get(op, 0) + 1

    def left(self, messages: int, traffic: Traffic) -> None:
        """Keep the counts of a client that leaves: the messages it sent, and its connection's traffic."""
        self.received += messages
        self.received_bytes += traffic.received_bytes
        self.sent += traffic.messages
        self.sent_bytes += traffic.bytes

    def requested(self, size: int) -> None:
        """Count a request over HTTP with a body of that size."""
        self.received += 1
        self.received_bytes += size

    def answered(self, size: int) -> None:
        """Count an answer to a request, or one piece of an answer that is a stream."""
        self.sent += 1
        self.sent_bytes += size
