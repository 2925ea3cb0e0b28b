"""ROS time from the topic `/clock`, as nodes with `use_sim_time` have it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rwt_graph.clock import SteadyClock
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.qos import QoS, Reliability

if TYPE_CHECKING:
    from rwt_graph.api import Participant, Sample

#: QoS of rclpy's and rclcpp's own subscription to `/clock`.
_QOS = QoS(depth=1, reliability=Reliability.BEST_EFFORT)


class RosTime(SteadyClock):
    """Clock whose ROS time is that of `/clock`, and 0 before; timers and timeouts go by real time."""

    is_real = False

    def __init__(self) -> None:
        super().__init__()
        self._now_ns = 0

    def follow(self, participant: Participant) -> None:
        """Take ROS time from `/clock` from now on."""
        participant.subscribe("/clock", self._on_clock, qos=_QOS)

    def _on_clock(self, sample: Sample) -> None:
        message: Any = sample.payload.value()
        self._now_ns = message.clock.sec * NANOSECONDS + message.clock.nanosec

    def time_ns(self) -> int:
        """Return the time of `/clock`, in nanoseconds."""
        return self._now_ns
