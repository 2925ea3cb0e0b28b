"""ROS time from the topic `/clock`, as nodes with `use_sim_time` have it."""

from __future__ import annotations

import time
from typing import Any

from rwt_graph.api import Participant, Sample, Subscription
from rwt_graph.clock import WallClock
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.qos import QoS, Reliability

#: QoS of rclpy's and rclcpp's own subscription to `/clock`.
_QOS = QoS(depth=1, reliability=Reliability.BEST_EFFORT)


class RosTime(WallClock):
    """Clock whose ROS time is real, or simulated: that of `/clock`, and 0 before its first message.

    Timers and timeouts always go by real time.
    """

    def __init__(self, *, is_real: bool) -> None:
        super().__init__()
        self.is_real = is_real
        self._now_ns = 0
        self._subscription: Subscription | None = None

    def follow(self, participant: Participant) -> None:
        """Take ROS time from `/clock` from now on."""
        self.is_real = False
        self._now_ns = 0
        self._subscription = participant.subscribe("/clock", self._on_clock, qos=_QOS)

    def unfollow(self) -> None:
        """Take real time as ROS time from now on."""
        self.is_real = True
        if self._subscription is not None:
            self._subscription.close()

    def _on_clock(self, sample: Sample) -> None:
        message: Any = sample.payload.value()
        now = message.clock
        seconds, rest = (now.sec, now.nanosec) if hasattr(now, "sec") else (now.secs, now.nsecs)
        self._now_ns = seconds * NANOSECONDS + rest

    def time_ns(self) -> int:
        """Return ROS time, in nanoseconds."""
        return time.time_ns() if self.is_real else self._now_ns
