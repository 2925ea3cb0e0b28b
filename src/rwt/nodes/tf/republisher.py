"""Node `/tf2_web_republisher`: action, service, and the streams that they start."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from time import thread_time
from typing import ClassVar, Final

import anyio

from rwt.nodes.tf.transform_filters import (
    InvalidRequest,
    MissingFrames,
    Request,
    TargetFrameFilter,
    TreeFilter,
    make_filter,
)
from rwt_graph import Graph, Node, Timer, TopicPublisher
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.errors import GoalAborted, GoalCanceled, ServiceFailed
from rwt_participant.goals import ReceivedGoal
from rwt_participant.messages import Message
from rwt_participant.qos import Durability, QoS
from rwt_tf2 import Buffer, Feed, StampedTransform, Transform, stamp_ns, write_transform

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


NAME: Final = "/tf2_web_republisher"
SERVICE: Final = "/republish_tfs"

TOPIC_TIMEOUT: Final = 10.0
"""Default time that a topic waits for a subscriber, in seconds, for a request of 0."""

MOST_STREAMS: Final = 100
"""Maximum number of goals and topics. Closed pages leave theirs behind, so the oldest is ended."""

_PACKAGE = "tf2_web_republisher"
#: Type of the action on ROS 2 in the newest clients; the bridge accepts every spelling.
_PACKAGE_OF_ROS_2 = "tf2_web_republisher_interfaces"


class Tf2WebRepublisher(Node):
    """Node that serves tf2_web_republisher for one graph until `close` (TFR-01 to TFR-10).

    It serves the action `/tf2_web_republisher`, also over actionlib's topics, and the service
    `/republish_tfs`, which returns a topic's name. It always subscribes to `/tf` and `/tf_static`.
    """

    def __init__(self, graph: Graph) -> None:
        super().__init__(graph, NAME)
        self._buffer = listen(self)
        self._streams: dict[int, GoalStream | TopicStream] = {}
        self._numbers = count()
        over_topics = f"{_PACKAGE}/TFSubscription"
        if self.distro.action_transport == "topics":
            self.advertise_action(NAME, over_topics, self._run_goal, accept=self._accept)
        else:
            own = f"{_PACKAGE_OF_ROS_2}/TFSubscription"
            self.advertise_action(NAME, own, self._run_goal, accept=self._accept)
            self.serve_over_topics(NAME, over_topics)
        self.advertise_service(SERVICE, f"{_PACKAGE}/RepublishTFs", self._republish)

    def _accept(self, message: Message) -> bool | str:
        try:
            Request.read(message)
        except InvalidRequest as error:
            return str(error)
        return True

    async def _run_goal(self, goal: ReceivedGoal) -> None:
        """Send feedback until the goal is canceled (TFR-08), or no client has received any for a while."""
        request = Request.read(goal.request)
        number = self._make_room()
        with anyio.CancelScope() as scope:
            filter_ = make_filter(request, self._missing())
            stream = GoalStream(self, self._buffer, filter_, self._budget(), goal, scope.cancel)
            self._streams[number] = stream
            timer = self.create_timer(request.period, stream.tick)
            try:
                await goal.cancel_event.wait()
            finally:
                timer.cancel()
                self._streams.pop(number, None)
        if stream.reason:
            raise GoalAborted({}, stream.reason)
        raise GoalCanceled({})

    def _republish(self, message: Message) -> dict[str, str]:
        """Publish on a separate topic for each call (TFR-09)."""
        try:
            request = Request.read(message)
        except InvalidRequest as error:
            raise ServiceFailed(str(error)) from error
        timeout = stamp_ns(message.timeout) / NANOSECONDS or TOPIC_TIMEOUT
        if timeout < 0:
            raise ServiceFailed(f"timeout must not be negative, got {timeout:g} s")
        number = self._make_room()
        publisher = self.advertise(f"{NAME}/tf_repub_{number}", f"{_PACKAGE}/TFArray", qos=TopicStream.QOS)
        filter_ = make_filter(request, self._missing())
        ended = partial(self._streams.pop, number, None)
        stream = TopicStream(self, self._buffer, filter_, self._budget(), publisher, timeout, ended)
        self._streams[number] = stream
        stream.start(request.period)
        return {"topic_name": publisher.name}

    def _make_room(self) -> int:
        if len(self._streams) >= MOST_STREAMS:
            oldest = next(iter(self._streams))
            self._streams.pop(oldest).stop(
                f"there are more than {MOST_STREAMS} subscriptions; the oldest ended"
            )
        return next(self._numbers)

    def _budget(self) -> CpuBudget:
        return CpuBudget(self.clock.monotonic, lambda: len(self._streams))

    def _missing(self) -> MissingFrames:
        return MissingFrames(self.log.error, self.clock.monotonic)


_TYPE: Final = "tf2_msgs/TFMessage"


def listen(node: Node) -> Buffer:
    """Return a buffer that is filled from `/tf` and `/tf_static` until the node is closed."""
    buffer = Buffer()
    feed = Feed(buffer)
    _subscribe(node, "/tf_static", partial(feed.take, static=True))
    _subscribe(node, "/tf", feed.take)
    return buffer


def _subscribe(node: Node, topic: str, take: Callable[[Message], None]) -> None:
    # An existing topic keeps its type: older ROS 1 programs use tf/tfMessage, with equal fields.
    known = node.graph.topic(topic)
    node.subscribe(topic, take, None if known is not None and known.type else _TYPE)
