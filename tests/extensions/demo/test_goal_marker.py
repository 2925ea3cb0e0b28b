"""Dragging the goal marker sends the robot."""

from __future__ import annotations

from typing import Any

import pytest

from rwt.extensions.markers import Event
from tests.extensions.demo.conftest import Lab

pytestmark = pytest.mark.anyio

#: A metre ahead of where the robot begins.
AHEAD = {"position": {"x": -2.4, "y": -2.5}, "orientation": {"z": 0.0, "w": 1.0}}


class Hand:
    """A viewer's mouse."""

    def __init__(self, lab: Lab) -> None:
        self._lab = lab
        self._feedback = lab.user.advertise(
            "/goal_marker/feedback", "visualization_msgs/InteractiveMarkerFeedback"
        )

    async def send(self, event: Event, **fields: object) -> None:
        self._feedback.publish(
            {"marker_name": "goal", "event_type": int(event), "header": {"frame_id": "map"}, **fields}
        )
        await self._lab.settle()

    async def choose(self, title: str) -> None:
        """An entry of the menu, by what it says."""
        [marker] = (await self._lab.user.call("/goal_marker/tunneled/get_init")).msg.markers
        [number] = [entry.id for entry in marker.menu_entries if entry.title == title]
        await self.send(Event.MENU_SELECT, menu_entry_id=number)

    async def drag(self) -> None:
        await self.send(Event.MOUSE_DOWN)
        await self.send(Event.POSE_UPDATE, pose=AHEAD)
        await self.send(Event.MOUSE_UP)


def place(lab: Lab) -> tuple[float, float]:
    """Where the robot is in the map; odometry begins at the start."""
    position = lab.latest("/odom").pose.pose.position
    return round(position.x - 3.4, 1), round(position.y - 2.5, 1)


async def test_it_begins_where_the_robot_does(lab: Lab) -> None:
    [marker] = (await lab.user.call("/goal_marker/tunneled/get_init")).msg.markers
    assert (marker.header.frame_id, marker.pose.position.x, marker.pose.position.y) == ("map", -3.4, -2.5)


async def test_the_robot_drives_to_where_the_marker_is_dropped(lab: Lab) -> None:
    await Hand(lab).drag()
    await lab.pass_time(6.0)
    assert place(lab) == (-2.4, -2.5)


async def test_a_click_is_no_order(lab: Lab) -> None:
    plans: list[Any] = lab.watch("/plan")
    hand = Hand(lab)
    await hand.send(Event.MOUSE_DOWN)
    await hand.send(Event.MOUSE_UP)
    assert plans == []


async def test_the_menu_stops_the_robot_and_sends_it_again(lab: Lab) -> None:
    hand = Hand(lab)
    await hand.choose("Stop")  # there is nothing to stop yet
    await hand.drag()
    await lab.pass_time(1.0)
    await hand.choose("Stop")
    await lab.pass_time(6.0)
    stopped_at, _ = place(lab)
    assert -3.4 < stopped_at < -2.5
    await hand.choose("Drive here")
    await lab.pass_time(6.0)
    assert place(lab) == (-2.4, -2.5)


async def test_the_marker_can_be_fetched(lab: Lab) -> None:
    hand = Hand(lab)
    await hand.drag()
    updates = lab.watch("/goal_marker/update")
    await hand.choose("Fetch the marker")
    assert [pose.pose.position.x for pose in updates[-1].poses] == [-3.4]


async def test_a_place_that_cannot_be_reached_is_told_in_the_log(lab: Lab) -> None:
    logs = lab.watch("/rosout")
    hand = Hand(lab)
    await hand.send(Event.MOUSE_DOWN)
    outside = {"position": {"x": 50.0}, "orientation": {"w": 1.0}}
    await hand.send(Event.POSE_UPDATE, pose=outside)
    await hand.send(Event.MOUSE_UP)
    await lab.pass_time(0.5)
    assert any("/goal_marker" in entry.msg for entry in logs)
