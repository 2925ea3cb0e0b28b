"""Server of interactive markers: poses, callbacks for events, topics and services by distribution.

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

import logging
import math
import threading
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import Final

import msgspec

from rwt.extensions.markers.feedback import (
    BadFeedback,
    Event,
    Feedback,
    Menu,
    OnFeedback,
    read_feedback,
)
from rwt_graph import Node
from rwt_interfaces.payload import Payload
from rwt_participant.errors import RobotError
from rwt_participant.messages import Message, MessageLike
from rwt_participant.qos import QoS

logger = logging.getLogger(__name__)

#: Time for which a marker belongs to the viewer that last dragged it, in seconds.
_GRIP = 1.0


class NoSuchMarker(RobotError, LookupError):
    """The server has no marker of that name."""


@dataclass(slots=True)
class _Entry:
    marker: Message
    on_feedback: OnFeedback | None
    menu: Menu | None
    client: str = ""
    held_until: float = -math.inf
    is_new: bool = True
    has_moved: bool = False

    def redraw_menu(self) -> None:
        if self.menu is None:
            return
        # `convert` returns the class of the marker's field, so that both can be compared.
        type = next(each.type for each in msgspec.structs.fields(self.marker) if each.name == "menu_entries")
        entries = msgspec.convert(list(self.menu.messages()), type=type)
        if entries != self.marker.menu_entries:
            self.marker = msgspec.structs.replace(self.marker, menu_entries=entries)
            self.is_new = True


class InteractiveMarkerServer:
    """Server of the markers of one namespace; reports events to callbacks.

    Changes take effect together with :meth:`apply_changes`, and those of a callback when it
    returns. Every method may be called from any thread once the graph runs.

    Args:
        node: node of the topics; closing it closes the server, too.
        namespace: namespace of the topics, such as `/goal_marker`; the "topic" in viewers.

    Raises:
        InvalidGraphName: ROS does not allow `namespace`.
    """

    def __init__(self, node: Node, namespace: str) -> None:
        self._node = node
        self._type = node.registry.message("visualization_msgs/InteractiveMarker")
        self._pose = node.registry.message("geometry_msgs/Pose")
        # Callbacks may call back, and other threads may change markers while feedback arrives.
        self._lock = threading.RLock()
        self._entries: dict[str, _Entry] = {}
        self._shown: dict[str, Message] = {}
        self._sequence = 0
        self._topics = MarkerTopics(node, namespace, self._snapshot, self._on_feedback)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the markers, applied or not, in order of insertion."""
        with self._lock:
            return tuple(self._entries)

    def insert(
        self, marker: MessageLike, on_feedback: OnFeedback | None = None, *, menu: Menu | None = None
    ) -> None:
        """Add a marker, or replace the one of that name.

        Args:
            marker: a `visualization_msgs/InteractiveMarker`, such as that of :func:`interactive_marker`. A
                header without a stamp keeps the marker fixed to its frame.
            on_feedback: called with every event, except selections of menu entries with a callback.
            menu: menu instead of the message's `menu_entries`.

        Raises:
            InvalidMessage: `marker` does not fit its type, or has no name.
        """
        made: Message = Payload.from_value(self._type, marker, now=lambda: 0).value()
        if not made.name:
            raise ValueError("an interactive marker needs a name")
        with self._lock:
            self._entries[made.name] = _Entry(made, on_feedback, menu)

    def set_pose(self, name: str, pose: MessageLike, frame: str | None = None) -> None:
        """Move a marker.

        Args:
            pose: `geometry_msgs/Pose`.
            frame: frame of the pose; None for the marker's frame.

        Raises:
            NoSuchMarker: no marker has that name.
            InvalidMessage: `pose` does not fit its type.
        """
        place = Payload.from_value(self._pose, pose, now=lambda: 0).value()
        with self._lock:
            self._move(self._entry(name), place, frame)

    def marker(self, name: str) -> Message:
        """Return the marker, including changes that are not applied yet.

        Raises:
            NoSuchMarker: no marker has that name.
        """
        with self._lock:
            return self._entry(name).marker

    def erase(self, name: str) -> None:
        """Remove a marker.

        Raises:
            NoSuchMarker: no marker has that name.
        """
        with self._lock:
            self._entry(name)
            del self._entries[name]

    def clear(self) -> None:
        """Remove all markers."""
        with self._lock:
            self._entries.clear()

    def apply_changes(self) -> None:
        """Publish all changes since the last call, including menus; no-op without changes."""
        with self._lock:
            for entry in self._entries.values():
                entry.redraw_menu()
            new = [entry for entry in self._entries.values() if entry.is_new]
            moved = [entry for entry in self._entries.values() if entry.has_moved and not entry.is_new]
            erased = [name for name in self._shown if name not in self._entries]
            if not (new or moved or erased):
                return
            self._shown = {name: entry.marker for name, entry in self._entries.items()}
            self._sequence += 1
            for entry in (*new, *moved):
                entry.is_new = entry.has_moved = False
            self._topics.publish(
                self._sequence,
                [entry.marker for entry in new],
                [
                    {"header": entry.marker.header, "pose": entry.marker.pose, "name": entry.marker.name}
                    for entry in moved
                ],
                erased,
            )

    def close(self) -> None:
        """Remove all markers, also from the viewers, and withdraw the topics."""
        self.clear()
        self.apply_changes()
        self._topics.close()

    def __enter__(self) -> InteractiveMarkerServer:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _entry(self, name: str) -> _Entry:
        try:
            return self._entries[name]
        except KeyError:
            known = ", ".join(self._entries) or "none"
            raise NoSuchMarker(f"there is no interactive marker {name!r}; there is {known}") from None

    def _snapshot(self) -> tuple[int, list[Message]]:
        with self._lock:
            return self._sequence, list(self._shown.values())

    # -- feedback ------------------------------------------------------------------------------------------

    def _on_feedback(self, message: Message) -> None:
        try:
            feedback = read_feedback(message)
        except BadFeedback as error:
            logger.warning("feedback for %.100r was ignored: %s", message.marker_name, error)
            return
        with self._lock:
            entry = self._entries.get(feedback.marker)
            if entry is None or not self._take(entry, feedback):
                return
        self._call_back(entry, feedback)
        self.apply_changes()

    def _take(self, entry: _Entry, feedback: Feedback) -> bool:
        """Apply the pose of an event. Returns False if it is invalid."""
        now = self._node.clock.monotonic()
        if feedback.client != entry.client and now < entry.held_until:
            # Only one viewer may drag a marker at a time.
            logger.debug("%s is held by another client than %s", feedback.marker, feedback.client)
            return False
        frame = entry.marker.header.frame_id
        if feedback.event is Event.POSE_UPDATE and feedback.frame not in ("", frame):
            logger.warning(
                "feedback for %.100r was ignored: its pose is in %.100r, the marker in %s",
                feedback.marker,
                feedback.frame,
                frame,
            )
            return False
        entry.client, entry.held_until = feedback.client, now + _GRIP
        if feedback.event is Event.POSE_UPDATE and feedback.pose != entry.marker.pose:
            self._move(entry, feedback.pose, None)
        return True

    @staticmethod
    def _move(entry: _Entry, pose: Message, frame: str | None) -> None:
        header = entry.marker.header
        if frame is not None:
            header = msgspec.structs.replace(header, frame_id=frame)
        entry.marker = msgspec.structs.replace(entry.marker, pose=pose, header=header)
        entry.has_moved = True

    def _call_back(self, entry: _Entry, feedback: Feedback) -> None:
        callback = entry.on_feedback
        if feedback.event is Event.MENU_SELECT and entry.menu is not None:
            chosen = entry.menu.entry(feedback.menu_entry)
            callback = (chosen.on_select if chosen else None) or callback
        if callback is None:
            return
        try:
            returned = callback(feedback)
        except Exception:
            logger.exception("a callback of interactive marker %s failed", feedback.marker)
            return
        if returned is not None:
            self._node.graph.spawn(lambda: self._finish(returned, feedback), f"feedback of {feedback.marker}")

    async def _finish(self, running: Awaitable[None], feedback: Feedback) -> None:
        try:
            await running
        except Exception:
            logger.exception("a callback of interactive marker %s failed", feedback.marker)
        self.apply_changes()


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
        if PUBLISHES_STATE[node.distro.conventions]:
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
