"""Topics and services of interactive markers, by distribution.

==============================  =====================  ========
`<ns>/update`                   what has changed       both
`<ns>/feedback`                 what people did        both
`<ns>/update_full`              everything, latched    noetic
`<ns>/get_interactive_markers`  everything, a service  jazzy
`<ns>/tunneled/update`          what has changed       both
`<ns>/tunneled/get_init`        everything, a service  both
==============================  =====================  ========

The tunneled ones are those of `interactive_marker_proxy`, which ros3djs uses: they hide sequence numbers from
browsers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from typing import Final

from rwt_graph import Node
from rwt_participant.messages import Message
from rwt_participant.qos import QoS

_TYPE = "visualization_msgs/InteractiveMarker"
_DEPTH = QoS(depth=100)
#: `visualization_msgs/InteractiveMarkerUpdate`.
_KEEP_ALIVE, _UPDATE = 0, 1
#: Interval of keep-alive messages in seconds; ROS 1 clients drop a server after two without one.
_KEEP_ALIVE_PERIOD = 0.5
PUBLISHES_STATE: Final = {"jazzy": False, "noetic": True}
"""True if viewers get all markers from a latched topic, otherwise from a service; by distribution."""


class MarkerTopics:
    """Publishers, subscriptions and services of one server.

    Args:
        node: node that publishes; its name identifies the server.
        snapshot: returns the sequence number and all published markers.
    """

    def __init__(
        self,
        node: Node,
        namespace: str,
        snapshot: Callable[[], tuple[int, Sequence[Message]]],
        on_feedback: Callable[[Message], None],
    ) -> None:
        base = node.resolve(namespace).rstrip("/")
        self._server_id = f"{node.name}{base}"
        self._snapshot = snapshot
        self._parts = ExitStack()
        hold = self._parts.enter_context
        self._updates = [
            hold(node.advertise(f"{base}/{topic}", f"{_TYPE}Update", qos=_DEPTH))
            for topic in ("update", "tunneled/update")
        ]
        hold(
            node.advertise_service(
                f"{base}/tunneled/get_init", "demo_interactive_markers/GetInit", self._get_init
            )
        )
        hold(closing(node.subscribe(f"{base}/feedback", on_feedback, f"{_TYPE}Feedback", qos=_DEPTH)))
        self._full = None
        if PUBLISHES_STATE[node.distro.name]:
            self._full = hold(node.advertise(f"{base}/update_full", f"{_TYPE}Init", latch=True))
            self._full.publish(self._init())
            self._parts.callback(node.create_timer(_KEEP_ALIVE_PERIOD, self._keep_alive).cancel)
        else:
            service = f"{base}/get_interactive_markers"
            hold(node.advertise_service(service, "visualization_msgs/GetInteractiveMarkers", self._get_all))

    def publish(
        self, sequence: int, markers: Sequence[Message], poses: Sequence[Message], erases: Sequence[str]
    ) -> None:
        """Publish changes: new markers, poses of others, and names of removed ones."""
        update = {
            "server_id": self._server_id,
            "seq_num": sequence,
            "type": _UPDATE,
            "markers": markers,
            "poses": poses,
            "erases": erases,
        }
        for topic in self._updates:
            topic.publish(update)
        if self._full is not None:
            self._full.publish(self._init())

    def close(self) -> None:
        """Withdraw the topics and services."""
        self._parts.close()

    def _init(self) -> Mapping[str, object]:
        sequence, markers = self._snapshot()
        return {"server_id": self._server_id, "seq_num": sequence, "markers": markers}

    def _get_init(self, request: object) -> Mapping[str, object]:
        return {"msg": self._init()}

    def _get_all(self, request: object) -> Mapping[str, object]:
        sequence, markers = self._snapshot()
        return {"sequence_number": sequence, "markers": markers}

    def _keep_alive(self) -> None:
        update = self._updates[0]
        if update.subscriber_count:
            sequence, _ = self._snapshot()
            update.publish({"server_id": self._server_id, "seq_num": sequence, "type": _KEEP_ALIVE})
