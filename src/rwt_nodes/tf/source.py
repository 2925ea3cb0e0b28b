"""The robot's transforms, listened to from the start: a goal may be about a frame that was told of once."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final, TypeAlias

from rwt_graph import Node
from rwt_tf2 import Buffer, Feed

Message: TypeAlias = Any
"""`tf2_msgs/TFMessage`."""

_TYPE: Final = "tf2_msgs/TFMessage"


def listen(node: Node) -> Buffer:
    """A buffer that is filled from `/tf` and `/tf_static` until the node is closed."""
    buffer = Buffer()
    feed = Feed(buffer)
    _subscribe(node, "/tf_static", partial(feed.take, static=True))
    _subscribe(node, "/tf", feed.take)
    return buffer


def _subscribe(node: Node, topic: str, take: Callable[[Message], None]) -> None:
    # A topic that is there keeps its type: older programs of ROS 1 have tf/tfMessage, with equal fields.
    known = node.graph.topic(topic)
    node.subscribe(topic, take, None if known is not None and known.type else _TYPE)
