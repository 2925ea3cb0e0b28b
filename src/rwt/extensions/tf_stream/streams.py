"""Streams of transforms to one client: feedback of a goal, or a separate topic."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from time import thread_time
from typing import ClassVar, Final

from rwt.extensions.tf_stream.transform_filters import TargetFrameFilter, TreeFilter
from rwt_graph import Node, Timer, TopicPublisher
from rwt_participant.goals import ReceivedGoal
from rwt_participant.qos import Durability, QoS
from rwt_tf2 import Buffer, StampedTransform, Transform, write_transform

FEEDBACK_TIMEOUT: Final = 10.0
"""Time that a goal continues without a reader of its feedback, in seconds: a page may reconnect."""

DIGITS: Final = 6
"""Number of decimals sent: a micrometre, a microradian. Full precision would double the size in JSON."""


def to_message(transforms: Iterable[StampedTransform]) -> dict[str, object]:
    """Return the fields of the feedback and of `TFArray`."""
    return {"transforms": [write_transform(_rounded(each)) for each in transforms]}


def _rounded(stamped: StampedTransform) -> StampedTransform:
    (x, y, z), (qx, qy, qz, qw) = stamped.transform.translation, stamped.transform.rotation
    return StampedTransform(
        stamped.parent,
        stamped.child,
        stamped.stamp_ns,
        Transform(
            (round(x, DIGITS), round(y, DIGITS), round(z, DIGITS)),
            (round(qx, DIGITS), round(qy, DIGITS), round(qz, DIGITS), round(qw, DIGITS)),
        ),
    )


@dataclass(eq=False)
class GoalStream:
    """Stream of transforms as feedback of one goal.

    Attributes:
        reason: reason why it was stopped; empty while it runs.
    """

    node: Node
    buffer: Buffer
    filter_: TargetFrameFilter | TreeFilter
    budget: CpuBudget
    goal: ReceivedGoal
    end: Callable[[], None]
    reason: str = ""

    def __post_init__(self) -> None:
        self._taken_at = self.node.clock.monotonic()

    def tick(self) -> None:
        """Send the transforms that are due, if any (TFR-06)."""
        now = self.node.clock.monotonic()
        if not self.goal.feedback_wanted:
            self.filter_.forget()
            if now - self._taken_at >= FEEDBACK_TIMEOUT:
                self.stop(f"no client took the feedback for {FEEDBACK_TIMEOUT:g} s")
            return
        self._taken_at = now
        self.budget.turn(self._send)

    def _send(self) -> None:
        due = self.filter_.due(self.buffer, self.node.clock.time_ns())
        if due:
            self.goal.publish_feedback(to_message(due))

    def stop(self, reason: str) -> None:
        """End the goal as aborted."""
        self.reason = reason
        self.end()


@dataclass(eq=False)
class TopicStream:
    """Stream on a topic, for one call of the service (TFR-09).

    It ends after `timeout` seconds without a subscriber. Nothing is sent before the first subscriber, and
    each new one receives all transforms.
    """

    QOS: ClassVar = QoS(depth=10, durability=Durability.TRANSIENT_LOCAL)

    node: Node
    buffer: Buffer
    filter_: TargetFrameFilter | TreeFilter
    budget: CpuBudget
    publisher: TopicPublisher
    timeout: float
    ended: Callable[[], object]

    def __post_init__(self) -> None:
        self._timer: Timer | None = None
        self._subscribers = 0
        self._subscribed_at = self.node.clock.monotonic()

    def start(self, period: float) -> None:
        """Begin to publish every `period` seconds."""
        self._timer = self.node.create_timer(period, self._tick)

    def _tick(self) -> None:
        now = self.node.clock.monotonic()
        subscribers = self.publisher.subscriber_count
        if subscribers > self._subscribers:
            self.filter_.forget()
        self._subscribers = subscribers
        if subscribers:
            self._subscribed_at = now
            self.budget.turn(self._publish)
        elif now - self._subscribed_at >= self.timeout:
            self.stop("")

    def _publish(self) -> None:
        due = self.filter_.due(self.buffer, self.node.clock.time_ns())
        if due:
            self.publisher.publish(to_message(due))

    def stop(self, reason: str) -> None:
        """Withdraw the topic. The reason is ignored: only goals have a client to send it to."""
        if self._timer is None:
            return
        self._timer.cancel()
        self._timer = None
        self.publisher.close()
        self.ended()


CPU_FRACTION: Final = 0.25
"""Fraction of the event loop's time for all streams together: a client may ask for a thousand frames a
hundred times a second, and other clients must be served, too."""

_NEWEST: Final = 0.2
"""Weight of the last turn in the moving average of its duration: one delayed turn must not slow a stream."""


@dataclass(eq=False)
class CpuBudget:
    """CPU budget of one stream: it pauses after each turn to stay within its part of :data:`CPU_FRACTION`.

    Args:
        monotonic: returns the seconds of the robot's clock.
        worked: returns the CPU seconds of this thread.
    """

    monotonic: Callable[[], float]
    streams: Callable[[], int]
    worked: Callable[[], float] = thread_time
    _usual: float = field(default=0.0, init=False)
    _rests_until: float = field(default=float("-inf"), init=False)

    def turn(self, work: Callable[[], None]) -> None:
        """Run `work`, unless the stream pauses."""
        now = self.monotonic()
        if now < self._rests_until:
            return
        began = self.worked()
        work()
        self._usual += _NEWEST * (self.worked() - began - self._usual)
        self._rests_until = now + self._usual * self.streams() / CPU_FRACTION
