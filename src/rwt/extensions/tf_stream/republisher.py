"""Node `/tf2_web_republisher`: action, service, and the streams that they start."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import count
from typing import Final

import anyio

from rwt.extensions.tf_stream.streams import FEEDBACK_TIMEOUT, CpuBudget, Stream, to_message
from rwt.extensions.tf_stream.transform_filters import InvalidRequest, MissingFrames, Request, make_filter
from rwt_graph import Graph, Node
from rwt_graph.accounts import ASKER
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.errors import GoalAborted, GoalCanceled, ServiceFailed
from rwt_participant.goals import ReceivedGoal
from rwt_participant.messages import Message
from rwt_participant.qos import Durability, QoS
from rwt_tf2 import Buffer, Feed, stamp_ns
from rwt_transports.shared_pool import PoolRow, SharedPool

NAME: Final = "/tf2_web_republisher"
SERVICE: Final = "/republish_tfs"

TOPIC_TIMEOUT: Final = 10.0
"""Default time that a topic waits for a subscriber, in seconds, for a request of 0."""

MOST_STREAMS: Final = 100
"""Maximum number of goals and topics. Closed pages leave theirs behind, so the oldest of the client with most
is ended."""

STREAMS: Final = PoolRow("transform streams", "", "subscriptions of transforms")

#: QoS of a topic: late subscribers receive the last messages.
_TOPIC_QOS = QoS(depth=10, durability=Durability.TRANSIENT_LOCAL)

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
        self._streams = SharedPool(STREAMS, MOST_STREAMS)
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
        with anyio.CancelScope() as scope:
            stream = self._start(
                request, lambda: goal.feedback_wanted, goal.publish_feedback, FEEDBACK_TIMEOUT, scope.cancel
            )
            try:
                await goal.cancel_event.wait()
            finally:
                stream.stop()
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
        name = f"{NAME}/tf_repub_{next(self._numbers)}"
        publisher = self.advertise(name, f"{_PACKAGE}/TFArray", qos=_TOPIC_QOS)
        self._start(request, lambda: publisher.subscriber_count, publisher.publish, timeout, publisher.close)
        return {"topic_name": publisher.name}

    def _start(
        self,
        request: Request,
        readers: Callable[[], int],
        send: Callable[[dict[str, object]], object],
        timeout: float,
        end: Callable[[], object],
    ) -> Stream:
        filter_ = make_filter(request, MissingFrames(self.log.error, self.clock.monotonic))
        budget = CpuBudget(self.clock.monotonic, lambda: len(self._streams))

        def send_due() -> None:
            due = filter_.due(self._buffer, self.clock.time_ns())
            if due:
                send(to_message(due))

        def on_end() -> None:
            self._streams.release(share)
            end()

        send_in_turn = partial(budget.turn, send_due)
        stream = Stream(self, request.period, readers, filter_.forget, send_in_turn, timeout, on_end)
        share = self._streams.take(ASKER.get(), stream.stop, 0)
        self._streams.resize(share, 1)
        return stream


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
