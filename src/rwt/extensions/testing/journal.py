"""Journal of received messages, calls and goals, in order, and a graph that records them."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum

from rwt_graph.api import Publisher
from rwt_graph.clock import Clock
from rwt_graph.memory.graph import MemoryGraph, MemoryParticipant
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from rwt_participant.messages import Message
from rwt_participant.qos import DEFAULT_QOS, QoS

#: Maximum number of entries per kind and name; beyond it, the oldest are dropped.
KEPT = 1000

#: Maximum size of all entries together. Beyond it, the oldest entries of the largest name are dropped, so
#: that camera images do not displace the one command that a test waits for.
KEPT_BYTES = 64 * 1024 * 1024

#: Overhead charged per entry.
_ENTRY_BYTES = 512

#: Topics that the server publishes under its clients' name, or every node publishes by itself.
OF_THE_SERVER = frozenset(("/client_count", "/connected_clients", "/rosout", "/parameter_events", "/clock"))


class Kind(StrEnum):
    """Kind of an entry."""

    MESSAGE = "message"
    CALL = "call"
    GOAL = "goal"


@dataclass(frozen=True, slots=True)
class Received:
    """Received message, request or goal.

    Attributes:
        name: absolute name of the topic, service or action.
        node: absolute name of the publishing node; empty for calls and goals.
        stamp_ns: time of the graph's clock, nanoseconds since the epoch.
    """

    kind: Kind
    name: str
    payload: Payload
    node: str
    stamp_ns: int

    @property
    def message(self) -> Message:
        """Typed message. Shared: treat it as read-only."""
        return self.payload.value()

    @property
    def json(self) -> str:
        """Message as JSON, as clients of this distribution receive it."""
        return bytes(self.payload.json()).decode()


class Journal:
    """Bounded journal. Written on the graph's thread, read from any thread.

    Args:
        kept: maximum number of entries per kind and name.
        kept_bytes: maximum size of all entries, each message counted in the form in which it was received.

    Attributes:
        bytes: size of all entries.
        version: number that grows with every entry.
    """

    def __init__(self, kept: int = KEPT, kept_bytes: int = KEPT_BYTES) -> None:
        self._kept = kept
        self._kept_bytes = kept_bytes
        self._changed = threading.Condition()
        self._entries: dict[tuple[Kind, str], deque[tuple[Received, int]]] = {}
        self.version = 0
        self.bytes = 0

    def add(self, entry: Received) -> None:
        """Add an entry, and wake the threads that wait for one."""
        with self._changed:
            entries = self._entries.setdefault((entry.kind, entry.name), deque())
            size = _ENTRY_BYTES + entry.payload.kept_size
            entries.append((entry, size))
            self.bytes += size
            if len(entries) > self._kept:
                self.bytes -= entries.popleft()[1]
            while self.bytes > self._kept_bytes:
                self.bytes -= max(self._entries.values(), key=_bytes_of).popleft()[1]
            self.version += 1
            self._changed.notify_all()

    def of(self, kind: Kind, name: str) -> tuple[Received, ...]:
        """Return the entries of one kind and name, oldest first."""
        with self._changed:
            entries = self._entries.get((kind, name))
            return () if entries is None else tuple(entry for entry, _ in entries)

    def everything(self, kind: Kind) -> Mapping[str, tuple[Received, ...]]:
        """Return the entries of one kind by name, sorted by name."""
        with self._changed:
            found = {
                name: tuple(entry for entry, _ in entries)
                for (each, name), entries in self._entries.items()
                if each is kind
            }
        return dict(sorted(found.items()))

    def wait(self, seen: int, seconds: float) -> None:
        """Block until the version exceeds `seen`, for at most `seconds`."""
        with self._changed:
            self._changed.wait_for(lambda: self.version != seen, seconds)

    def clear(self, only: Callable[[Received], bool] | None = None) -> None:
        """Drop all entries, or those for which `only` returns True."""
        with self._changed:
            for key, entries in self._entries.items():
                left = () if only is None else (each for each in entries if not only(each[0]))
                self._entries[key] = deque(left)
            self.bytes = sum(map(_bytes_of, self._entries.values()))
            self.version += 1


def _bytes_of(entries: deque[tuple[Received, int]]) -> int:
    return sum(size for _, size in entries)


class ObservedGraph(MemoryGraph):
    """A :class:`~rwt_graph.memory.graph.MemoryGraph` with a journal.

    Args:
        registry: interfaces; default: the standard ones of jazzy.
        clock: clock of the graph; default: the wall clock.
        only: absolute names of the nodes whose messages are recorded; None for all but `unobserved`.

    Attributes:
        journal: messages that nodes and clients published, and entries that scripted robots add.
        unobserved: absolute names of nodes whose messages are not recorded: those of the scripted robots.
    """

    def __init__(
        self,
        registry: Registry | None = None,
        clock: Clock | None = None,
        *,
        only: Collection[str] | None = None,
    ) -> None:
        super().__init__(registry, clock)
        self.journal = Journal()
        self.unobserved: set[str] = set()
        self._only = only

    def make_participant(self, name: str) -> MemoryParticipant:
        """Return a participant for a node, observed unless the node is in `unobserved`."""
        is_noted = name not in self.unobserved if self._only is None else name in self._only
        return _ObservedParticipant(self, name) if is_noted else super().make_participant(name)


class _ObservedParticipant(MemoryParticipant):
    def __init__(self, graph: ObservedGraph, name: str) -> None:
        super().__init__(graph, name)
        self._journal = graph.journal
        self._now_ns = graph.clock.time_ns

    def advertise(self, topic: str, type: MessageType, qos: QoS = DEFAULT_QOS) -> Publisher:
        return _ObservedPublisher(super().advertise(topic, type, qos), self.name, self._journal, self._now_ns)


class _ObservedPublisher(Publisher):
    """Publisher that records a message before delivering it, so that callbacks find it in the journal."""

    def __init__(self, inner: Publisher, node: str, journal: Journal, now_ns: Callable[[], int]) -> None:
        self.topic = inner.topic
        self.type = inner.type
        self.qos = inner.qos
        self._inner = inner
        inner.on_displaced = self._on_inner_displaced
        self._node = node
        self._journal = journal
        self._now_ns = now_ns

    def publish(self, payload: Payload) -> None:
        kept = payload.detach()
        self._journal.add(Received(Kind.MESSAGE, self.topic, kept, self._node, self._now_ns()))
        self._inner.publish(payload)

    def _on_inner_displaced(self, reason: str) -> None:
        if self.on_displaced is not None:
            self.on_displaced(reason)

    @property
    def is_closed(self) -> bool:
        return self._inner.is_closed

    @property
    def subscriber_count(self) -> int:
        return self._inner.subscriber_count

    def close(self) -> None:
        self._inner.close()
