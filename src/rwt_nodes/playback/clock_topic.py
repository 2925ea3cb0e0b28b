"""Publishes the graph's time on `/clock`, for programs that follow simulated time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_graph.clock import NANOSECONDS, SimulatedClock
from rwt_interfaces import Payload

if TYPE_CHECKING:
    from rwt_graph.api import Graph, Participant
    from rwt_graph.clock import Timer

CLOCK = "/clock"


class ClockTopic:
    """Publishes `rosgraph_msgs/Clock` at a rate in real time; a graph with simulated time does it itself."""

    def __init__(self, graph: Graph, participant: Participant, hertz: float) -> None:
        self._clock = graph.clock
        self._period = 1.0 / hertz
        self._fields = graph.distro.time_fields
        self._timer: Timer | None = None
        if not isinstance(graph.clock, SimulatedClock):
            self._publisher = participant.advertise(CLOCK, graph.registry.message("rosgraph_msgs/Clock"))
            self._timer = self._clock.call_later(0.0, self._tick)

    def _tick(self) -> None:
        seconds, nanoseconds = divmod(self._clock.time_ns(), NANOSECONDS)
        whole, fraction = self._fields
        value = {"clock": {whole: seconds, fraction: nanoseconds}}
        self._publisher.publish(Payload.from_value(self._publisher.type, value))
        self._timer = self._clock.call_later(self._period, self._tick)

    def close(self) -> None:
        """Publish no more."""
        if self._timer is not None:
            self._timer.cancel()


__all__ = ["CLOCK", "ClockTopic"]
