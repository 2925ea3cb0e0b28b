"""Feedback of viewers about markers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from rwt_participant.messages import Message


class Event(IntEnum):
    """Kind of event, numbered as in `visualization_msgs/InteractiveMarkerFeedback`."""

    KEEP_ALIVE = 0
    POSE_UPDATE = 1
    MENU_SELECT = 2
    BUTTON_CLICK = 3
    MOUSE_DOWN = 4
    MOUSE_UP = 5


class BadFeedback(ValueError):
    """A viewer sent invalid feedback; the text names the field."""


@dataclass(frozen=True, slots=True)
class Feedback:
    """Event reported by a viewer.

    Attributes:
        control: name of the control that was used; may be empty.
        frame: frame of `pose`.
        pose: `geometry_msgs/Pose` of the marker as its viewer has it. For where the marker is, ask the
            server: when the mouse goes up, ros3djs reports the last pose that came back to it, which is
            older.
        menu_entry: number of the entry that was chosen; 0 for other events.
        mouse_point: `geometry_msgs/Point` where the mouse was on the marker, None where that is not known.
        client: the viewer's own name for itself; empty from ros3djs.
    """

    marker: str
    control: str
    event: Event
    frame: str
    pose: Message
    menu_entry: int
    mouse_point: Message | None
    client: str


def read_feedback(message: Message) -> Feedback:
    """Read a `visualization_msgs/InteractiveMarkerFeedback`.

    Raises:
        BadFeedback: the event is unknown, or the pose is invalid.
    """
    try:
        event = Event(message.event_type)
    except ValueError:
        raise BadFeedback(f"event_type: expected 0 to 5, got {message.event_type}") from None
    place, turn = message.pose.position, message.pose.orientation
    if not all(map(math.isfinite, (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w))):
        raise BadFeedback("pose: expected finite numbers")
    if event is Event.POSE_UPDATE and not any((turn.x, turn.y, turn.z, turn.w)):
        raise BadFeedback("pose.orientation: expected a quaternion, got zeros")
    return Feedback(
        marker=message.marker_name,
        control=message.control_name,
        event=event,
        frame=message.header.frame_id,
        pose=message.pose,
        menu_entry=message.menu_entry_id,
        mouse_point=message.mouse_point if message.mouse_point_valid else None,
        client=message.client_id,
    )
