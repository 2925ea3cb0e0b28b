"""In-memory graph with a journal of every published message."""

from __future__ import annotations

from collections.abc import Callable, Collection

from rwt.testing.journal import Journal, Kind, Received
from rwt_graph.api import Publisher
from rwt_graph.clock import Clock
from rwt_graph.memory.graph import MemoryGraph, MemoryParticipant
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from rwt_participant.qos import DEFAULT_QOS, QoS


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
        self._node = node
        self._journal = journal
        self._now_ns = now_ns

    def publish(self, payload: Payload) -> None:
        kept = payload.detach()
        self._journal.add(Received(Kind.MESSAGE, self.topic, kept, self._node, self._now_ns()))
        self._inner.publish(payload)

    @property
    def is_closed(self) -> bool:
        return self._inner.is_closed

    @property
    def subscriber_count(self) -> int:
        return self._inner.subscriber_count

    def close(self) -> None:
        self._inner.close()
