"""Panels for data: plots, recordings and layouts of the dashboard."""

from __future__ import annotations

import json
import time
from typing import Any

import anyio
import pytest

from rwt import Server
from rwt_participant.qos import LATCHED
from tests.browser.driver import Browser, Page
from tests.browser.test_panels import open_panels, panel, text, violations
from tests.waiting import until

pytestmark = pytest.mark.anyio


async def write(page: Page, selector: str, value: str) -> None:
    """Have a field contain a text, as if it was typed."""
    await page.evaluate(
        "((i, value) => { i.focus(); i.value = value; i.dispatchEvent(new Event('input', {bubbles: true})) })"
        f"(document.querySelector({json.dumps(selector)}), {json.dumps(value)})"
    )


def address(server: Server) -> str:
    return server.urls[0].replace("ws", "http", 1) + "/"


async def test_a_plot_has_derived_series_and_every_topic_is_found(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0") as server:
        node = server.node("many")
        for number in range(600):
            node.advertise(f"/many/topic_{number:03}", "std_msgs/Float64")
        speed = node.advertise("/zz/speed", "geometry_msgs/Vector3", qos=LATCHED)
        speed.publish({"x": 3.0, "y": 4.0})
        async with browser.page(f"{address(server)}healthz", 900, 700) as page:
            await open_panels(page, address(server), [("plot", {"lines": [], "statistics": True})])
            await page.wait("document.querySelector('.add-field input')")
            await write(page, ".add-field input", "speed zz")
            option = ".suggest-list:popover-open [role=option]"
            await page.wait(f"{text(option)} === '/zz/speed'")
            assert await violations(page) == []
            await page.click(option)
            field = ".add-field label:nth-of-type(2) input"
            await page.wait(f"!document.querySelector({json.dumps(field)}).disabled")
            await write(page, field, "@nonsense(1)")
            await page.wait(f"{text('.add-field .problem')}.includes('unknown function')")
            await write(page, field, "@norm.@mul(2)")
            await page.click(".add-field [type=submit]")
            await page.wait(f"{text('.plot-table .now')} === '10.0'")
            # Mean and standard deviation; a latched message comes once for each subscription.
            row = "[...document.querySelectorAll('.plot-table tbody .number')].map((it) => it.textContent)"
            assert (await page.evaluate(row))[2:4] == ["10.0", "0.00"]


async def test_plots_share_cursor_and_zoom(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0", demo=True) as server,
        browser.page(f"{address(server)}healthz", 1300, 800) as page,
    ):
        position = {"lines": [{"topic": "/odom", "path": "pose.pose.position.x"}], "marks": [0.5]}
        speed = {"lines": [{"topic": "/odom", "path": "twist.twist.linear.x"}]}
        await page.evaluate("localStorage.setItem('rwt-side', 'false')")
        key = f"rwt-last-layout{server.urls[0]}/"
        panels = [
            {"id": f"plot {at}", "kind": "plot", "config": each} for at, each in enumerate([position, speed])
        ]
        grid = [
            {
                "type": "leaf",
                "size": 650,
                "data": {"id": str(at), "views": [each["id"]], "activeView": each["id"]},
            }
            for at, each in enumerate(panels)
        ]
        dock = {
            "grid": {
                "root": {"type": "branch", "size": 700, "data": grid},
                **{"width": 1300, "height": 700, "orientation": "HORIZONTAL"},
            },
            "panels": {
                each["id"]: {"id": each["id"], "contentComponent": "plot", "title": "Plot"} for each in panels
            },
            "activeGroup": "0",
        }
        layout = json.dumps({"version": 1, "panels": panels, "dock": dock})
        await page.evaluate(f"localStorage.setItem({json.dumps(key)}, {json.dumps(layout)})")
        await page.goto(address(server))
        await page.wait("document.querySelectorAll('.plot-chart canvas').length === 2")
        now = "[...document.querySelectorAll('.plot-table .now')].filter((it) => it.textContent !== '\u2013')"
        await page.wait(f"{now}.length === 2")
        zoomed = "document.querySelectorAll('.plot-tools output').length"
        # There is nothing to zoom until two values have come.
        while not await page.evaluate(zoomed):
            await page.click(".plot-tools >> text=Zoom in")
        assert await page.evaluate(zoomed) == 2
        await page.evaluate("document.querySelector('.plot-chart').focus()")
        await page.keyboard("press", "ArrowLeft")
        await page.wait("document.querySelectorAll('.plot-cursor:not([hidden])').length === 2")
        spoken = "[...document.querySelectorAll('.plot-chart')].map((it) => it.ariaValueText).join()"
        assert "/odom pose.pose.position.x: 0" in await page.evaluate(spoken)
        await page.click(".plot-tools >> text=All")
        await page.wait(f"{zoomed} === 0")


async def test_a_layout_with_an_unknown_panel_opens_and_keeps_it(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0", demo=True) as server,
        browser.page(f"{address(server)}healthz") as page,
    ):
        await open_panels(page, address(server), [("of the future", {"a": 1}), ("battery", {})])
        await page.wait(f"{text('[class*=future]')}.includes('does not know the panel of the future')")
        await page.click("[role=tab] >> text=Battery")
        await page.wait(f"{text('.panel-battery')}.includes('V')")
        saved = f"localStorage.getItem({json.dumps('rwt-last-layout' + server.urls[0] + '/')})"
        layout = json.loads(await page.evaluate(saved))
        assert layout["panels"][0] == {"id": "of the future", "kind": "of the future", "config": {"a": 1}}


async def test_the_node_graph_marks_dead_ends_and_zooms(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0", demo=True) as server,
        browser.page(f"{address(server)}healthz", 900, 700) as page,
    ):
        server.node("quiet").advertise("/unheard", "std_msgs/String")
        await open_panels(page, address(server), [("nodes", {})])
        await page.wait(f"{text('.nodes-picture svg')}.includes('/tf')")
        assert "/unheard" not in await page.evaluate(text(".nodes-picture svg"))
        await page.click("text=Show dead ends")
        dead = (
            "[...document.querySelectorAll('.nodes-picture .dead')]"
            ".find((it) => it.textContent.includes('/unheard'))"
        )
        await page.wait(f"{dead}?.textContent.startsWith('no subscriber')")
        width = "document.querySelector('.nodes-picture svg').getBoundingClientRect().width"
        before = await page.evaluate(width)
        await page.click(".nodes >> text=Zoom in")
        await page.wait(f"{width} > 1.3 * {before}")
        assert await violations(page) == []


def transforms(stamp_s: float, *pairs: tuple[str, str]) -> dict[str, Any]:
    """Return a message of transforms from parents to children."""
    stamp = {"sec": int(stamp_s), "nanosec": int(stamp_s % 1 * 1e9)}
    headers = [
        {"header": {"stamp": stamp, "frame_id": parent}, "child_frame_id": child} for parent, child in pairs
    ]
    return {"transforms": [{**each, "transform": {"rotation": {"w": 1.0}}} for each in headers]}


async def test_frames_show_rates_by_stamps_and_the_faults_of_the_tree(browser: Browser) -> None:
    async with panel(browser, "jazzy", "frames", robot=False, size=(900, 600)) as (served, page):
        tf = served.node.advertise("/tf", "tf2_msgs/TFMessage")
        shown = text(".panel-frames")
        await page.wait(f"{shown}.includes('/tf')")
        began = time.time()
        number = 0
        # Ten messages at a time: as a busy network hands them on.
        while not await page.evaluate(f"{shown}.includes('wheel 50.0 Hz')"):
            for _ in range(10):
                number += 1
                tf.publish(transforms(began + number / 50, ("base", "wheel")))
            tf.publish(transforms(time.time(), ("map", "odom"), ("odom", "base"), ("a", "b"), ("b", "a")))
            tf.publish(transforms(time.time(), ("world", "odom")))
            await anyio.sleep(0.2)
        for fault in (
            "Loop: a \u2192 b \u2192 a",
            "odom has several parents: map, world.",
            "Published by /test",
        ):
            await page.wait(f"{shown}.includes({json.dumps(fault)})")
        await page.wait("document.querySelector('.frames').textContent.includes('the loop begins again')")
        assert await violations(page) == []


async def test_a_topic_with_messages_that_are_too_large_is_shown_on_request(browser: Browser) -> None:
    async with Server("ws://127.0.0.1:0", web={"message_bytes": 100_000}) as server:
        node = server.node("robot")
        huge = node.advertise("/huge", "std_msgs/String", qos=LATCHED)
        huge.publish({"data": "begin " + "x" * 200_000})
        async with browser.page(f"{address(server)}healthz", 900, 500) as page:
            await open_panels(page, address(server), [("topics", {"topic": "/huge"})])
            await page.wait(f"{text('.too-large')}.startsWith('/huge is not shown: a message has 0.2 MB')")
            assert not await page.evaluate("document.querySelector('.detail .tree')")
            assert await violations(page) == []
            await until(
                lambda: (
                    not any(topic.name == "/huge" and topic.subscribers for topic in server.graph.topics())
                )
            )
            await page.click(".too-large button")
            await page.wait(f"{text('.detail .tree')}.includes('begin x')")
            assert not await page.evaluate("document.querySelector('.too-large')")


@pytest.mark.parametrize(("language", "written"), [("en-US", "13:04:05.006"), ("de-AT", "13:04:05,006")])
async def test_the_log_has_milliseconds_lines_and_nodes(
    browser: Browser, language: str, written: str
) -> None:
    async with (
        Server("ws://127.0.0.1:0") as server,
        browser.page(f"{address(server)}healthz", 900, 500, language=language) as page,
    ):
        log = server.node("robot").advertise("/rosout", "rcl_interfaces/Log", qos=LATCHED)
        # By the browser's zone, whatever that is.
        sec = int(await page.evaluate("new Date(2026, 4, 1, 13, 4, 5).getTime() / 1000"))
        entry = {"stamp": {"sec": sec, "nanosec": 6_000_000}, "level": 40, "name": "planner"}
        log.publish({**entry, "msg": "Traceback:\n    line 7\n      x = 1"})
        await open_panels(page, address(server), [("log", {})])
        await page.wait(f"{text('.log-entries')}.includes({written!r})")
        line = "document.querySelector('.log-text')"
        assert await page.evaluate(f"{line}.innerText.split('\\n').length") == 3
        log.publish({**entry, "name": "driver", "msg": "hot"})
        await page.wait(f"{text('.log-entries')}.includes('hot')")
        await page.evaluate(
            "((s) => { s.value = 'driver'; s.dispatchEvent(new Event('change', {bubbles: true})) })"
            "([...document.querySelectorAll('.log select')].at(-1))"
        )
        await page.wait("document.querySelectorAll('.log-text').length === 1")
        assert await page.evaluate(text(".log-entries .log-text")) == "hot"
        assert await violations(page) == []


async def test_diagnostics_that_are_errors_come_before_stale_ones(browser: Browser) -> None:
    async with panel(browser, "jazzy", "diagnostics", robot=False, size=(700, 500)) as (served, page):
        array = served.node.advertise("/diagnostics", "diagnostic_msgs/DiagnosticArray", latch=True)
        levels = {"a stale": 3, "b ok": 0, "c error": 2, "d warning": 1}
        array.publish({"status": [{"level": level, "name": name} for name, level in levels.items()]})
        names = "[...document.querySelectorAll('.diagnostics summary')].map((it) => it.textContent).join()"
        await page.wait(f"/error.*stale.*warning.*ok/.test({names})")
        assert (await page.evaluate(text(".diagnostics [role=status]"))).startswith("Error")
