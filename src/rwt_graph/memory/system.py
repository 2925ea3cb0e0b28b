"""What a graph publishes by itself: `/rosout` exists always, `/clock` when time is simulated.

Viewers decide by the type of `/rosout` which ROS they talk to, so it must be there before any node logs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_graph.api import Graph, Participant
from rwt_graph.clock import NANOSECONDS, SimulatedClock
from rwt_interfaces.payload import Payload
from rwt_program.qos import Durability, QoS

if TYPE_CHECKING:
    from rwt_interfaces.distro import Distro


def rosout_qos(distro: Distro) -> QoS:
    """How nodes advertise `/rosout`."""
    return QoS(
        depth=distro.rosout_depth, durability=Durability.TRANSIENT_LOCAL, lifespan=distro.rosout_lifespan
    )


class SystemTopics:
    """The publishers that belong to the graph itself and to no node of the program."""

    def __init__(self, graph: Graph, participant: Participant) -> None:
        self._graph = graph
        self._participant = participant
        registry = graph.registry
        participant.advertise("/rosout", registry.message(graph.distro.rosout_type))
        if isinstance(graph.clock, SimulatedClock):
            self._clock = participant.advertise("/clock", registry.message("rosgraph_msgs/Clock"))
            self._simulated = graph.clock
            graph.clock.listeners.append(self._tick)

    def _tick(self, now_ns: int) -> None:
        whole, fraction = self._graph.distro.time_fields
        seconds, nanoseconds = divmod(now_ns, NANOSECONDS)
        value = {"clock": {whole: seconds, fraction: nanoseconds}}
        self._clock.publish(Payload.from_value(self._clock.type, value))

    def close(self) -> None:
        """Stop following the clock, and leave."""
        if isinstance(self._graph.clock, SimulatedClock) and self._tick in self._graph.clock.listeners:
            self._graph.clock.listeners.remove(self._tick)
        self._participant.close()


__all__ = ["SystemTopics", "rosout_qos"]
