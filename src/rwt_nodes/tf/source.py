"""The robot's transforms, listened to while somebody wants them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, TypeAlias

from rwt_graph import Node, TopicSubscription
from rwt_tf2 import Buffer, Feed

LINGER: Final = 5.0
"""Seconds that are listened on when nobody wants them any more: a client that changes its mind asks again."""

Message: TypeAlias = Any
"""`tf2_msgs/TFMessage`."""

_TYPE = "tf2_msgs/TFMessage"


class TransformSource:
    """A buffer that is filled from `/tf` and `/tf_static` as long as it is held.

    Attributes:
        buffer: empty while nobody holds it.
    """

    def __init__(self, node: Node) -> None:
        self.buffer = Buffer()
        self._node = node
        self._subscriptions: tuple[TopicSubscription, ...] = ()
        self._holders = 0
        self._left = 0

    @contextmanager
    def held(self) -> Iterator[Buffer]:
        """Listen for the length of the block."""
        self.hold()
        try:
            yield self.buffer
        finally:
            self.release()

    def hold(self) -> None:
        """Begin to listen, unless that is done."""
        self._holders += 1
        if self._subscriptions:
            return
        feed = Feed(self.buffer)
        self._subscriptions = (
            self._subscribe("/tf_static", lambda message: feed.take(message, static=True)),
            self._subscribe("/tf", feed.take),
        )

    def release(self) -> None:
        """Listen no more, a while after the last has said so."""
        self._holders -= 1
        if self._holders:
            return
        self._left += 1
        left = self._left
        self._node.clock.call_later(LINGER, lambda: self._leave(left))

    def _leave(self, left: int) -> None:
        if self._holders or left != self._left:
            return
        for subscription in self._subscriptions:
            subscription.close()
        self._subscriptions = ()
        self.buffer = Buffer()

    def _subscribe(self, topic: str, take: Callable[[Message], None]) -> TopicSubscription:
        # A topic that is there keeps its type: older programs of ROS 1 have tf/tfMessage, with equal fields.
        known = self._node.graph.topic(topic)
        return self._node.subscribe(topic, take, None if known is not None and known.type else _TYPE)
