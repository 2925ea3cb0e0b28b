"""Node `/tf2_web_republisher`: action, service, and the streams that they start."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias

import anyio

from rwt.nodes.tf.request import Request, RequestMessage, RequestRefused
from rwt.nodes.tf.streams import CpuBudget, GoalStream, TopicStream
from rwt.nodes.tf.transform_filters import MissingFrames, make_filter
from rwt_graph import Node
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.errors import GoalAborted, GoalCanceled, ServiceFailed
from rwt_participant.goals import ReceivedGoal
from rwt_tf2 import Buffer, Feed, stamp_ns

if TYPE_CHECKING:
    from rwt_graph import Graph


NAME: Final = "/tf2_web_republisher"
SERVICE: Final = "/republish_tfs"

TOPIC_TIMEOUT: Final = 10.0
"""Seconds that a topic waits for a subscriber where the request says 0."""

MOST_STREAMS: Final = 100
"""Goals and topics at once. Pages that are closed leave theirs behind, so the oldest gives way."""

_PACKAGE = "tf2_web_republisher"
#: What the action is called on ROS 2, by the newest clients; the bridge takes every spelling.
_PACKAGE_OF_ROS_2 = "tf2_web_republisher_interfaces"


class _Stream(Protocol):
    def stop(self, reason: str) -> None: ...


class _RepublishRequest(RequestMessage, Protocol):
    timeout: Any


class Tf2WebRepublisher:
    """Node that serves tf2_web_republisher for one graph until `close` (TFR-01 to TFR-10).

    It serves the action `/tf2_web_republisher`, also over actionlib's topics, and the service
    `/republish_tfs`, which returns a topic's name. It always subscribes to `/tf` and `/tf_static`.
    """

    def __init__(self, graph: Graph) -> None:
        self._node = node = Node(graph, NAME)
        self._buffer = listen(node)
        self._streams: dict[int, _Stream] = {}
        self._numbers = count()
        over_topics = f"{_PACKAGE}/TFSubscription"
        if node.distro.action_transport == "topics":
            node.advertise_action(NAME, over_topics, self._run_goal, accept=self._accept)
        else:
            own = f"{_PACKAGE_OF_ROS_2}/TFSubscription"
            node.advertise_action(NAME, own, self._run_goal, accept=self._accept)
            node.serve_over_topics(NAME, over_topics)
        node.advertise_service(SERVICE, f"{_PACKAGE}/RepublishTFs", self._republish)

    def close(self) -> None:
        """Leave the graph; goals end as aborted."""
        self._node.close()

    def __enter__(self) -> Tf2WebRepublisher:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _accept(self, message: RequestMessage) -> bool | str:
        try:
            Request.read(message)
        except RequestRefused as error:
            return str(error)
        return True

    async def _run_goal(self, goal: ReceivedGoal) -> None:
        """Send feedback until the goal is canceled (TFR-08), or no client has received any for a while."""
        request = Request.read(goal.request)
        number = self._make_room()
        with anyio.CancelScope() as scope:
            filter_ = make_filter(request, self._missing())
            stream = GoalStream(self._node, self._buffer, filter_, self._budget(), goal, scope.cancel)
            self._streams[number] = stream
            timer = self._node.create_timer(request.period, stream.tick)
            try:
                await goal.cancel_event.wait()
            finally:
                timer.cancel()
                self._streams.pop(number, None)
        if stream.reason:
            raise GoalAborted({}, stream.reason)
        raise GoalCanceled({})

    def _republish(self, message: _RepublishRequest) -> dict[str, str]:
        """Publish on a separate topic for each call (TFR-09)."""
        try:
            request = Request.read(message)
        except RequestRefused as error:
            raise ServiceFailed(str(error)) from error
        timeout = stamp_ns(message.timeout) / NANOSECONDS or TOPIC_TIMEOUT
        if timeout < 0:
            raise ServiceFailed(f"timeout must not be negative, got {timeout:g} s")
        number = self._make_room()
        publisher = self._node.advertise(
            f"{NAME}/tf_repub_{number}", f"{_PACKAGE}/TFArray", qos=TopicStream.QOS
        )
        filter_ = make_filter(request, self._missing())
        ended = partial(self._streams.pop, number, None)
        stream = TopicStream(self._node, self._buffer, filter_, self._budget(), publisher, timeout, ended)
        self._streams[number] = stream
        stream.start(request.period)
        return {"topic_name": publisher.name}

    def _make_room(self) -> int:
        """Return the number of a new stream; end the oldest if there are too many."""
        if len(self._streams) >= MOST_STREAMS:
            oldest = next(iter(self._streams))
            self._streams.pop(oldest).stop(
                f"there are more than {MOST_STREAMS} subscriptions; the oldest ended"
            )
        return next(self._numbers)

    def _budget(self) -> CpuBudget:
        return CpuBudget(self._node.clock.monotonic, lambda: len(self._streams))

    def _missing(self) -> MissingFrames:
        return MissingFrames(self._node.log.error, self._node.clock.monotonic)


Message: TypeAlias = Any
"""`tf2_msgs/TFMessage`."""

_TYPE: Final = "tf2_msgs/TFMessage"


def listen(node: Node) -> Buffer:
    """Return a buffer that is filled from `/tf` and `/tf_static` until the node is closed."""
    buffer = Buffer()
    feed = Feed(buffer)
    _subscribe(node, "/tf_static", partial(feed.take, static=True))
    _subscribe(node, "/tf", feed.take)
    return buffer


def _subscribe(node: Node, topic: str, take: Callable[[Message], None]) -> None:
    # A topic that is there keeps its type: older programs of ROS 1 have tf/tfMessage, with equal fields.
    known = node.graph.topic(topic)
    node.subscribe(topic, take, None if known is not None and known.type else _TYPE)
