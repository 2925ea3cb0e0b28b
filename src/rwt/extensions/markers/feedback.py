"""Feedback of viewers about markers, and their menus: nested entries, some with a check mark."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Iterator, Mapping
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


OnFeedback = Callable[[Feedback], Awaitable[None] | None]
"""Called with an event; a coroutine function runs in a task for each event."""

#: `visualization_msgs/MenuEntry.FEEDBACK`: the viewer reports the choice and does nothing else.
_REPORT = 0


@dataclass(eq=False, slots=True)
class MenuEntry:
    """Menu entry. Changes show when the server applies its changes.

    Attributes:
        number: number in feedback, from 1, unique in its menu.
        checked: state of the check mark; None for an entry without one.
        visible: True if it is shown, with the entries below it.
        on_select: called when it is selected, instead of the marker's callback.
    """

    number: int
    parent: MenuEntry | None
    title: str
    checked: bool | None
    on_select: OnFeedback | None
    visible: bool = True

    @property
    def parent_number(self) -> int:
        """Number of the parent entry; 0 at the top."""
        return 0 if self.parent is None else self.parent.number

    @property
    def shown(self) -> bool:
        """True if the entry and all entries above it are visible."""
        return self.visible and (self.parent is None or self.parent.shown)


class Menu:
    """Menu of one or several markers."""

    def __init__(self) -> None:
        self._entries: dict[int, MenuEntry] = {}

    def add(
        self,
        title: str,
        on_select: OnFeedback | None = None,
        *,
        parent: MenuEntry | None = None,
        checked: bool | None = None,
    ) -> MenuEntry:
        """Append an entry.

        Args:
            on_select: called when it is selected; None for the marker's callback.
            parent: parent entry, which then cannot be selected itself.
            checked: None for an entry without a check mark.

        Raises:
            ValueError: `parent` belongs to another menu.
        """
        if parent is not None and self._entries.get(parent.number) is not parent:
            raise ValueError(f"the parent {parent.title!r} of menu entry {title!r} belongs to another menu")
        entry = MenuEntry(len(self._entries) + 1, parent, title, checked, on_select)
        self._entries[entry.number] = entry
        return entry

    def entry(self, number: int) -> MenuEntry | None:
        """Return the entry of a number."""
        return self._entries.get(number)

    def messages(self) -> Iterator[Mapping[str, object]]:
        """Return each visible entry as `visualization_msgs/MenuEntry`, parents first."""
        for entry in self._entries.values():
            if entry.shown:
                yield {
                    "id": entry.number,
                    "parent_id": entry.parent_number,
                    "title": f"{_MARKS[entry.checked]}{entry.title}",
                    "command": "",
                    "command_type": _REPORT,
                }


#: Check marks as text, as in ROS: neither rviz nor ros3djs has them in menus.
_MARKS = {True: "[x] ", False: "[  ] ", None: ""}
