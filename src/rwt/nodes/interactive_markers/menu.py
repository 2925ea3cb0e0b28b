"""The menu of a marker: entries in entries, some with a check mark."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator, Mapping

from rwt.nodes.interactive_markers.feedback import Feedback

OnFeedback = Callable[[Feedback], Awaitable[None] | None]
"""Told of an event; a coroutine function runs in a task of its own for each event."""

#: `visualization_msgs/MenuEntry.FEEDBACK`: the viewer reports the choice and does nothing else.
_REPORT = 0


class MenuEntry:
    """Menu entry. Changes show when the server applies its changes.

    Attributes:
        number: what feedback names it by; from 1 on, unique in its menu.
        checked: with a check mark, without one, or None for an entry that has no place for one.
        visible: True if it is shown, and what is under it.
        on_select: called when it is chosen, in place of the marker's own callback.
    """

    def __init__(
        self,
        number: int,
        parent: MenuEntry | None,
        title: str,
        checked: bool | None,
        on_select: OnFeedback | None,
    ) -> None:
        self.number = number
        self.title = title
        self.checked = checked
        self.visible = True
        self.on_select = on_select
        self._parent = parent

    @property
    def parent_number(self) -> int:
        """Number of the parent entry; 0 at the top."""
        return 0 if self._parent is None else self._parent.number

    @property
    def shown(self) -> bool:
        """True if the entry and all entries above it are visible."""
        return self.visible and (self._parent is None or self._parent.shown)


class Menu:
    """A menu, for one marker or several."""

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
        """Add an entry below the present ones.

        Args:
            on_select: called when it is chosen; None leaves that to the marker's own callback.
            parent: the entry under which it goes; one with entries under it cannot be chosen itself.
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


#: Neither rviz nor ros3djs has check marks in its menus, so they are written as text, as ROS does.
_MARKS = {True: "[x] ", False: "[  ] ", None: ""}
