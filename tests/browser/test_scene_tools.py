"""Tools of the 3D panel: settings of layers, selection, points, waypoints and views."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import anyio
import numpy as np
import pytest

from rwt import Server
from rwt_graph import Node
from rwt_interfaces.point_clouds import compressed
from rwt_participant.qos import LATCHED
from tests.browser.driver import LEFT_MESH, LEFT_STREAM, Browser, Page
from tests.browser.test_panels import open_panels, release, text, violations
from tests.waiting import until, until_answered

pytestmark = pytest.mark.anyio

SCENE = "document.querySelector('.scene-view').robotScene"
LAYOUT = "JSON.parse(localStorage.getItem(Object.keys(localStorage).find(k => k.startsWith('rwt-last'))))"


@asynccontextmanager
async def scene(
    browser: Browser, *, demo: bool = False, size: tuple[int, int] = (1000, 700), **config: object
) -> AsyncIterator[tuple[Node, Page]]:
    """The 3D panel alone, of the demo robot or of a node that publishes what the test draws."""
    async with Server("ws://127.0.0.1:0", demo=demo) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        node = server.node("drawn")
        async with browser.page(f"{url}healthz", *size) as page:
            page.forgive(LEFT_MESH, LEFT_STREAM)
            await page.evaluate("localStorage.setItem('rwt-side', 'false')")
            await open_panels(page, url, [("scene", config)])
            await page.wait("!!document.querySelector('.scene-view')?.robotScene")
            yield node, page


def layer(topic: str) -> str:
    return f"{SCENE}.rows.value.find((row) => row.topic === {topic!r})?.layer"


async def unfold(page: Page, topic: str) -> None:
    """Show the settings of a layer."""
    await page.click('.scene-tools summary:has-text("Layers")')
    await page.click(f'[aria-label="Settings of {topic}"]')


async def choose(page: Page, label: str, value: str) -> None:
    """Choose a value of a setting."""
    await page.evaluate(
        f"""(() => {{
          const labels = [...document.querySelectorAll('.layer-options label')];
          const label = labels.find((it) => it.textContent.startsWith({label!r}));
          const input = label.querySelector('select, input');
          input.value = {value!r};
          input.dispatchEvent(new Event(input.matches('select') ? 'change' : 'input', {{ bubbles: true }}));
        }})()"""
    )


async def at(page: Page, x: float, y: float) -> tuple[int, int]:
    """Where a point on the ground is drawn, in pixels of the page."""
    place = await page.evaluate(f"{SCENE}.view.pixel({SCENE}.view.camera.position.clone().set({x}, {y}, 0))")
    return round(place["x"]), round(place["y"])


def cloud() -> dict[str, Any]:
    """Four points with colours of their own and an intensity that grows along x."""
    names = ("x", "y", "z", "rgb", "intensity")
    points = np.zeros(4, [(name, "<u4" if name == "rgb" else "<f4") for name in names])
    points["x"] = [0, 1, 2, 3]
    points["rgb"] = 0x00FF00
    points["intensity"] = [0, 10, 20, 30]
    fields = [
        {"name": name, "offset": 4 * at, "datatype": 6 if name == "rgb" else 7, "count": 1}
        for at, name in enumerate(names)
    ]
    return {
        "header": {"frame_id": "map"},
        "height": 1,
        "width": 4,
        "fields": fields,
        "point_step": 20,
        "row_step": 80,
        "data": list(points.tobytes()),
    }


async def test_a_cloud_is_coloured_by_the_field_and_palette_that_are_chosen(browser: Browser) -> None:
    async with scene(browser) as (node, page):
        points = node.advertise("/cloud", "sensor_msgs/PointCloud2", qos=LATCHED)
        points.publish(cloud())
        colour = f"{layer('/cloud')}?.objects[0]?.geometry.attributes.color"
        colours = f"Array.from({colour}?.array.slice(0, 16) ?? []).join()"
        await page.wait(f"{colours}.startsWith('0,255,0,255,0,255,0,255')")
        await page.wait("!document.querySelector('.legends')")
        await unfold(page, "/cloud")
        await choose(page, "Colour by", "intensity")
        await choose(page, "Colours", "viridis")
        await page.wait(f"{colours}.startsWith('72,40,120,255') && {colours}.endsWith('253,231,37,255')")
        await page.wait(f"{text('.legends')}.includes('/cloud intensity')")
        await page.wait(f"{text('.legend-range')} === '030'")
        # Kept with the layout.
        assert (await page.evaluate(LAYOUT))["panels"][0]["config"]["layerSettings"]["/cloud"] == {
            "colour": "intensity",
            "palette": "viridis",
        }
        assert await violations(page) == []
        await choose(page, "Decay time", "30")

        async def has_two() -> object:
            """Publish one more: of clouds that arrive while one is compressed, only the newest is."""
            points.publish(cloud())
            return await page.evaluate(f"{layer('/cloud')}.objects.length >= 2")

        await until_answered(has_two)
        await choose(page, "Decay time", "0")
        await page.wait(f"{layer('/cloud')}.objects.length === 1")


def curve(count: int) -> tuple[np.ndarray[Any, Any], dict[str, Any]]:
    """Points along a spiral, and the cloud of them."""
    turn = np.linspace(0, 6, count)
    places = np.stack([3 * np.cos(turn), 3 * np.sin(turn), 0.1 * turn], axis=1).astype("<f4")
    fields = [{"name": name, "offset": 4 * at, "datatype": 7, "count": 1} for at, name in enumerate("xyz")]
    shape = {"height": 1, "width": count, "fields": fields, "point_step": 12, "row_step": 12 * count}
    return places, {"header": {"frame_id": "map"}, **shape, "data": places.tobytes()}


async def test_of_large_clouds_no_more_points_arrive_than_are_drawn(
    browser: Browser, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[tuple[int, int]] = []
    compress = compressed.compress

    def noted(cloud: Any, wish: Any) -> dict[str, Any]:
        found = compress(cloud, wish)
        made.append((wish.stride, found["width"] * found["height"]))
        return found

    monkeypatch.setattr(compressed, "compress", noted)
    async with scene(browser) as (node, page):
        node.advertise("/cloud", "sensor_msgs/PointCloud2", qos=LATCHED).publish(curve(600_000)[1])
        await page.wait(f"{layer('/cloud')}?.oneOf.value > 1")
        share = await page.evaluate(f"{layer('/cloud')}.oneOf.value")
        await unfold(page, "/cloud")
        await page.wait(f"document.querySelector('.layers').textContent.includes('1 of {share} points')")
        points = f"{layer('/cloud')}.objects[0].geometry.drawRange.count"
        await page.wait(f"{points} > 0 && {points} <= {600_000 // share}")
        assert await violations(page) == []
    assert made[0] == (1, 600_000)
    assert made[-1] == (share, 600_000 // share)


async def test_clouds_arrive_compressed(browser: Browser, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    compress = compressed.compress

    def noted(cloud: Any, wish: Any) -> dict[str, Any]:
        found = compress(cloud, wish)
        sizes.append(len(found["compressed_data"]))
        return found

    monkeypatch.setattr(compressed, "compress", noted)
    places, message = curve(20_000)
    async with scene(browser) as (node, page):
        points = node.advertise("/cloud", "sensor_msgs/PointCloud2", qos=LATCHED)
        points.publish(message)
        drawn = f"{layer('/cloud')}?.objects[0]?.geometry"
        await page.wait(f"{drawn}?.attributes.position.count >= 20000")
        found = await page.evaluate(f"Array.from({drawn}.attributes.position.array.slice(0, 60000))")
        assert await violations(page) == []
    assert sizes and sizes[0] < len(places.tobytes()) / 4
    # The page draws them in another order.
    assert np.abs(np.sort(found[2::3]) - places[:, 2]).max() <= 0.00101


async def test_namespaces_of_markers_and_the_look_of_maps_are_set(browser: Browser) -> None:
    async with scene(browser) as (node, page):
        marks = node.advertise("/marks", "visualization_msgs/MarkerArray", qos=LATCHED)
        shape = {"type": 1, "color": {"a": 1.0}, "scale": {"x": 1.0, "y": 1.0, "z": 1.0}}
        header = {"header": {"frame_id": "map"}}
        marks.publish({"markers": [{**shape, **header, "ns": ns} for ns in ("walls", "doors")]})
        grid = node.advertise("/map", "nav_msgs/OccupancyGrid", qos=LATCHED)
        # More cells than one tile has.
        info = {"resolution": 0.05, "width": 1500, "height": 2}
        grid.publish({**header, "info": info, "data": [0, 100, -1] * 1000})
        await page.wait(f"{layer('/map')}?.objects[0].children.length === 2")
        palette = f"Array.from({layer('/map')}.uniforms.palette.value.image.data.slice(400, 404)).join()"
        await unfold(page, "/map")
        await choose(page, "Colours", "rviz")
        await page.wait(f"{palette} === '255,0,255,180'")
        await choose(page, "Opacity", "50")
        await page.wait(f"{layer('/map')}.uniforms.opacity.value === 0.5")
        await page.click('[aria-label="Settings of /marks"]')
        shown = f"{layer('/marks')}.objects.map((it) => it.visible).join()"
        assert await page.evaluate(shown) == "true,true"
        await page.click(".layer-options label:has-text('doors')")
        await page.wait(f"{shown} === 'true,false'")
        # Also for markers that come later.
        marks.publish({"markers": [{**shape, **header, "ns": "doors", "id": 2}]})
        await page.wait(f"{shown} === 'true,false,false'")


async def test_what_is_clicked_is_described_also_by_keys(browser: Browser) -> None:
    async with scene(browser, demo=True) as (_, page):
        await page.wait(f"{SCENE}.base && {layer('/map')}?.objects[0].children.length === 1")
        await page.click('[role=toolbar] >> text="Top view"')
        await page.calm()
        robot = await page.evaluate(f"{SCENE}.robotPlace")
        x, y = round(robot["x"]) + 1.0, round(robot["y"]) + 1.0
        await page.mouse("click", *await at(page, x, y))
        await page.wait(f"/^(\\/map|\\/scan)/.test({text('.details')})")
        shown = await page.evaluate(
            "document.querySelectorAll('.details dd')[1].textContent.split(', ').map(Number)"
        )
        assert shown[:2] == pytest.approx([x, y], abs=0.1)
        await page.click('[aria-label="Close the selection"]')
        await page.wait("!document.querySelector('.details')")
        await page.click('[role=toolbar] >> text="Inspect"')
        for key in ("ArrowLeft", "Enter"):
            await page.keyboard("press", key)
        await page.wait(f"{text('.details')}.includes('From the robot')")
        assert await violations(page) == []


async def test_a_point_is_published_and_views_are_kept(browser: Browser) -> None:
    async with scene(browser, demo=True) as (node, page):
        points: list[tuple[str, float, float]] = []
        node.subscribe(
            "/clicked_point",
            lambda message: points.append((message.header.frame_id, message.point.x, message.point.y)),
            "geometry_msgs/PointStamped",
        )
        await page.wait(f"{SCENE}.base")
        await page.click('.view-cube >> text="Top"')
        position = f"{SCENE}.view.camera.position"
        await page.wait(f"{position}.z - {SCENE}.view.controls.target.z > 3")
        await page.click('[role=toolbar] >> text="Publish point"')
        robot = await page.evaluate(f"{SCENE}.robotPlace")
        x, y = robot["x"] + 0.5, robot["y"] + 0.5
        await page.mouse("click", *await at(page, x, y))
        await until(lambda: len(points) == 1)
        frame, *place = points[0]
        assert frame == "map"
        assert place == pytest.approx([x, y], abs=0.05)
        await page.click('.scene-tools summary:has-text("Views")')
        await page.click('text="Save this view"')
        saved = await page.evaluate(f"{SCENE}.view.viewpoint")
        await page.click('[role=toolbar] >> text="Orbit view"')
        await page.wait(f"{SCENE}.view.viewpoint[0] < {SCENE}.view.viewpoint[3] - 1")
        await page.click('.scene-tools summary:has-text("Views")')
        await page.click('.menu >> text="View 1"')
        await page.wait(f"JSON.stringify({SCENE}.view.viewpoint) === '{saved}'.replaceAll(' ', '')")


async def test_waypoints_are_followed_until_a_stop(browser: Browser) -> None:
    async with scene(browser, demo=True) as (_, page):
        await page.wait(f"!!{SCENE}.base")
        await page.click('[role=toolbar] >> text="Top view"')
        await page.click('[role=toolbar] >> text="Waypoints"')
        await page.calm()
        robot = await page.evaluate(f"{SCENE}.robotPlace")
        # The first one is where the robot is: it arrives at once.
        first = await at(page, robot["x"], robot["y"])
        second = await at(page, robot["x"] + 2.0, robot["y"])
        for place in (first, second):
            await page.mouse("click", *place)
        rows = "[...document.querySelectorAll('.waypoints li')].map((it) => it.textContent)"
        await page.wait(f"{rows}.length === 2")
        # A waypoint is dragged, and the list is put in another order and back.
        third = await at(page, robot["x"] + 2.0, robot["y"] + 1.0)
        before = await page.evaluate(f"{rows}[1]")
        await page.drag(second, third)
        await page.wait(f"{rows}[1] !== {before!r} && {rows}.length === 2")
        await page.click('[aria-label="Move waypoint 1 down"]')
        await page.click('[aria-label="Move waypoint 2 up"]')
        assert await violations(page) == []
        await page.click(".waypoints [type=submit]")
        await page.wait("document.querySelectorAll('.waypoints li')[1].matches('.current')")
        await page.keyboard("press", "Escape")
        await page.wait("!document.querySelector('.waypoints .current')")
        assert await page.evaluate("document.querySelector('.waypoints [type=submit]').disabled")
        await release(page)
        # Nothing goes on by itself.
        await anyio.sleep(0.5)
        assert not await page.evaluate("document.querySelector('.waypoints .current')")
        assert "Cancelled" in await page.evaluate(text(".goal-state"))
