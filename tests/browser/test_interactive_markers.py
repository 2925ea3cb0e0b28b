"""Interactive markers in ros3d, with a real mouse."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import pytest

from rwt.extensions.markers import (
    Colour,
    Event,
    Feedback,
    InteractiveMarkerServer,
    Menu,
    box,
    button,
    interactive_marker,
    move_plane,
    six_dof,
)
from tests.browser.driver import Browser, near
from tests.browser.stand import Stand, stand
from tests.browser.test_scene import BACKGROUND, BODY, scene
from tests.waiting import until

pytestmark = pytest.mark.anyio

ORANGE, CYAN = (255, 140, 0), (0, 255, 255)
CYAN_BOX = box((1.0, 1.0, 0.1), Colour(0.0, 1.0, 1.0, 0.9))


def _has(things: list[Feedback], number: int) -> bool:
    return len(things) == number


def view(robot: Stand, show: str = "handles") -> str:
    return scene(robot, show, "camera=0,-0.1,12", "handles=/marks")


async def test_a_marker_that_is_dragged_moves_in_every_viewer_and_tells_its_program(browser: Browser) -> None:
    events: list[Feedback] = []
    async with stand("noetic", browser.built, robot=False) as robot:
        markers = InteractiveMarkerServer(robot.node, "/marks")
        markers.insert(interactive_marker("slab", controls=[move_plane("z", CYAN_BOX)]), events.append)
        markers.apply_changes()
        async with browser.page(view(robot)) as page, browser.page(view(robot)) as other:
            start, end, there = [await page.pixel(*point) for point in ((0, 0), (2, 1), (2.3, 1.3))]
            for each in (page, other):
                await each.picture_when("marker", lambda seen: near(seen.at(*start), CYAN))
            await page.drag(start, end)
            for each, name in ((page, "marker dragged"), (other, "marker dragged elsewhere")):
                picture = await each.picture_when(name, lambda seen: near(seen.at(*there), CYAN))
                assert near(picture.at(*start), BACKGROUND)
            await until(lambda: bool(events) and events[-1].event is Event.MOUSE_UP)
    assert [events[0].event, events[1].event] == [Event.MOUSE_DOWN, Event.POSE_UPDATE]
    assert {(event.marker, event.control, event.frame) for event in events} == {("slab", "move_plane", "map")}
    place = markers.marker("slab").pose.position
    assert (place.x, place.y, place.z) == pytest.approx((2.0, 1.0, 0.0), abs=0.06)


async def test_six_dof_handles_move_and_turn_about_their_own_axis(browser: Browser) -> None:
    async with stand("noetic", browser.built, robot=False) as robot:
        markers = InteractiveMarkerServer(robot.node, "/marks")
        markers.insert(interactive_marker("arm", scale=2.0, controls=six_dof(2.0)))
        markers.apply_changes()

        def pose() -> Any:
            return markers.marker("arm").pose

        async with browser.page(view(robot)) as page:
            on_arrow, beside = await page.pixel(1.7, 0), await page.pixel(2.7, 1)
            await page.picture_when("six dof", lambda seen: near(seen.at(*on_arrow, 0), (230, 38, 38)))
            await page.drag(on_arrow, beside)
            await until(lambda: pose().position.x > 0.9)
            assert (pose().position.x, pose().position.y) == pytest.approx((1.0, 0.0), abs=0.06)
            assert pose().orientation.w == 1.0
            diagonal = 0.9 * math.sqrt(0.5)
            on_ring = await page.pixel(1.0 + diagonal, diagonal)
            quarter = await page.pixel(1.0 - diagonal, diagonal)
            await page.picture_when("six dof moved", lambda seen: near(seen.at(*on_ring, 0), (51, 89, 255)))
            await page.drag(on_ring, quarter)
            await until(lambda: pose().orientation.z > 0.6)
            turn = pose().orientation
            assert (turn.z, turn.w) == pytest.approx((math.sqrt(0.5),) * 2, abs=0.06)
            assert (pose().position.x, pose().position.y) == pytest.approx((1.0, 0.0), abs=0.06)


async def test_a_click_opens_the_menu_and_an_entry_is_chosen(browser: Browser) -> None:
    chosen: list[Feedback] = []
    clicked: list[Feedback] = []
    menu = Menu()
    lights = menu.add("Lights")

    def switch_on(feedback: Feedback) -> None:
        chosen.append(feedback)
        entry.checked = True

    entry = menu.add("Front", switch_on, parent=lights, checked=False)
    async with stand("noetic", browser.built, robot=False) as robot:
        markers = InteractiveMarkerServer(robot.node, "/marks")
        markers.insert(interactive_marker("lamp", controls=[button(CYAN_BOX)]), clicked.append, menu=menu)
        markers.apply_changes()
        async with browser.page(view(robot)) as page:
            there = await page.pixel(0, 0)
            for title, number in (("[  ] Front", 1), ("[x] Front", 2)):
                await page.picture_when("button", lambda seen: near(seen.at(*there), CYAN))
                await page.mouse("move", *there)
                await page.mouse("down")
                await page.mouse("up")
                await page.click(f"text='{title}'")
                await until(partial(_has, chosen, number))
                await page.wait("document.querySelector('.default-interactive-marker-menu') === null")
    assert {(event.marker, event.menu_entry) for event in chosen} == {("lamp", entry.number)}
    assert Event.BUTTON_CLICK in [event.event for event in clicked]


async def test_a_program_moves_and_erases_its_markers(browser: Browser) -> None:
    async with stand("noetic", browser.built, robot=False) as robot:
        markers = InteractiveMarkerServer(robot.node, "/marks")
        async with browser.page(view(robot)) as page:
            markers.insert(interactive_marker("slab", controls=[move_plane("z", CYAN_BOX)]))
            markers.apply_changes()
            first, second = await page.pixel(0, 0), await page.pixel(-2, 1)
            await page.picture_when("inserted", lambda seen: near(seen.at(*first), CYAN))
            markers.set_pose("slab", {"position": {"x": -2.0, "y": 1.0}, "orientation": {"w": 1.0}})
            markers.apply_changes()
            picture = await page.picture_when("set pose", lambda seen: near(seen.at(*second), CYAN))
            assert near(picture.at(*first), BACKGROUND)
            markers.erase("slab")
            markers.apply_changes()
            await page.picture_when("erased", lambda seen: seen.count(CYAN) == 0)


async def test_the_demo_robot_drives_to_where_its_marker_is_dropped(browser: Browser) -> None:
    address = ("camera=-2.9,-2.6,5", "center=-2.9,-2.5,0")
    async with stand("noetic", browser.built) as robot:
        places: list[float] = []
        robot.node.subscribe("/odom", lambda odom: places.append(odom.pose.pose.position.x))
        async with browser.page(scene(robot, "map,robot,handles", *address)) as page:
            # The disc reaches out from under the robot.
            disc, dropped = await page.pixel(-3.4, -2.74, 0.03), await page.pixel(-2.2, -2.74, 0.03)
            await page.picture_when("goal marker", lambda seen: near(seen.at(*disc, 0), ORANGE))
            await page.drag(disc, dropped)
            picture = await page.picture_when(
                "goal marker dragged", lambda seen: near(seen.at(*dropped, 0), ORANGE)
            )
            assert not near(picture.at(*disc, 0), ORANGE)
            await until(lambda: places[-1] > 1.1)
            body = await page.pixel(-2.2, -2.4, 0.15)
            await page.picture_when("goal reached", lambda seen: near(seen.at(*body), BODY, 15))
