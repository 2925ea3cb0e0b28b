"""Menus: what viewers show, and who is told of a choice."""

from __future__ import annotations

import pytest

from rwt.extensions.markers import Event, Feedback, Menu, interactive_marker
from tests.extensions.markers.conftest import Lab

pytestmark = pytest.mark.anyio


def shown(menu: Menu) -> list[tuple[object, object, object]]:
    return [(entry["id"], entry["parent_id"], entry["title"]) for entry in menu.messages()]


def test_entries_are_numbered_from_one_and_know_their_parent() -> None:
    menu = Menu()
    menu.add("Go")
    speed = menu.add("Speed")
    menu.add("Slow", parent=speed, checked=True)
    menu.add("Fast", parent=speed, checked=False)
    assert shown(menu) == [(1, 0, "Go"), (2, 0, "Speed"), (3, 2, "[x] Slow"), (4, 2, "[  ] Fast")]


def test_a_hidden_entry_hides_what_is_under_it() -> None:
    menu = Menu()
    speed = menu.add("Speed")
    menu.add("Slow", parent=speed)
    menu.add("Stop")
    speed.visible = False
    assert shown(menu) == [(3, 0, "Stop")]


def test_a_parent_must_be_of_the_same_menu() -> None:
    stranger = Menu().add("Speed")
    with pytest.raises(ValueError, match=r"the parent 'Speed' of menu entry 'Slow' belongs to another menu"):
        Menu().add("Slow", parent=stranger)


async def test_the_chosen_entry_is_told_and_the_marker_hears_the_others(lab: Lab) -> None:
    menu = Menu()
    by_entry: list[Feedback] = []
    by_marker: list[Feedback] = []
    menu.add("Go", by_entry.append)
    menu.add("Stop")
    lab.server.insert(interactive_marker("goal"), by_marker.append, menu=menu)
    for number in (1, 2, 99):
        lab.send(Event.MENU_SELECT, menu_entry_id=number)
    assert [feedback.menu_entry for feedback in by_entry] == [1]
    assert [feedback.menu_entry for feedback in by_marker] == [2, 99]


async def test_a_check_mark_that_changes_shows_with_the_next_changes(lab: Lab) -> None:
    menu = Menu()

    def toggle(feedback: Feedback) -> None:
        lights.checked = not lights.checked

    lights = menu.add("Lights", toggle, checked=False)
    lab.server.insert(interactive_marker("goal"), menu=menu)
    lab.server.apply_changes()
    updates = lab.watch()
    lab.send(Event.MENU_SELECT, menu_entry_id=lights.number)
    [marker] = updates[-1].markers
    assert [entry.title for entry in marker.menu_entries] == ["[x] Lights"]
    lab.send(Event.MOUSE_UP)
    assert len(updates) == 1
