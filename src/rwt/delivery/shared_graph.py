"""Resources that all clients of a gateway share: a node, publishers, fan-outs and counters."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from rwt.delivery.compact import CompactForms, CompactSource
from rwt.delivery.counters import Counters
from rwt.delivery.fanout import Fanout
from rwt.delivery.shared_publishers import SharedPublishers
from rwt_graph.api import Graph
from rwt_graph.clock import Clock
from rwt_graph.errors import TypeConflict
from rwt_interfaces.structs import MessageType
from rwt_transports.scheduler import SAMPLES, Budget, Scheduler


class SharedGraph:
    """Part of a gateway in the graph, without access rules: what all of its clients share.

    Attributes:
        fanouts: fan-outs of the subscribed topics, by absolute name.
        compact: compact forms of these topics.

    Args:
        linger: seconds that a publisher outlives its last user.
    """

    def __init__(self, graph: Graph, node: str, linger: float, log: Callable[[str], None]) -> None:
        self.graph = graph
        self.participant = graph.participant(node, for_clients=True)
        self.counters = Counters()
        self.publishers = SharedPublishers(self.participant, graph.clock, linger, self.counters, log)
        self._scheduler = scheduler_of(graph.clock, SAMPLES)
        self.fanouts: dict[str, Fanout] = {}
        self.compact = CompactForms(graph, self._derived)

    def fanout(self, topic: str, type: MessageType) -> Fanout:
        """Return the fan-out of a topic, which is created if needed. Raises TypeConflict."""
        fanout = self.fanouts.get(topic)
        if fanout is None:
            fanout = self.fanouts[topic] = Fanout(
                self.participant,
                topic,
                type,
                self.counters.use_topic(topic),
                self.graph.clock,
                self._scheduler,
            )
        else:
            if type.name != fanout.type.name:
                raise TypeConflict(topic, type.name, fanout.type.name)  # SUB-03
            known = self.graph.topic(topic)
            if known is not None and not known.publishers:
                # A remote publisher that returns sends retained samples once per subscription.
                fanout.renew()
        return fanout

    def _derived(self, fanout: Fanout, source: CompactSource) -> Fanout:
        return Fanout(source, fanout.topic, source.type, fanout.counts, self.graph.clock, self._scheduler)

    def release(self, fanout: Fanout) -> None:
        """End a fan-out that has no listeners."""
        if fanout.is_empty and self.fanouts.get(fanout.topic) is fanout:
            del self.fanouts[fanout.topic]
            self.counters.release_topic(fanout.counts)
            fanout.close()

    def close(self) -> None:
        """Leave the graph."""
        self.publishers.close()
        self.participant.close()


def scheduler_of(clock: Clock, budget: Budget, *, one_at_a_time: bool = False) -> Scheduler:
    """Return a scheduler that uses the timers of a graph's clock, which may be simulated."""
    return Scheduler(
        budget,
        partial(clock.call_later, 0.0),
        clock.call_later,
        clock.monotonic,
        one_at_a_time=one_at_a_time,
    )
