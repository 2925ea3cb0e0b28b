"""The robot's own page on the demo robot: by its pixels, and by what arrives at the robot."""

from __future__ import annotations

import json
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import anyio
import anyio.abc
import pytest

from rwt import Server
from rwt.extensions.dashboard.page_server import serve_page
from rwt.extensions.hub.hub import open_hub
from tests.browser.driver import LEFT_MESH, LEFT_STREAM, REFUSED, Browser, Page, Size
from tests.browser.grip import Grip, hold_until
from tests.browser.stand import Stand, stand
from tests.browser.test_panels import release
from tests.waiting import until

pytestmark = pytest.mark.anyio

DISTROS = pytest.mark.parametrize("distro", ["jazzy", "noetic"])
SIZE: Size = {"width": 1400, "height": 900}
PHONE: Size = {"width": 390, "height": 844}
TOKEN = "0123456789abcdef0123"


@asynccontextmanager
async def dashboard(
    browser: Browser, distro: str, path: str = "", *, robot: bool = True, size: Size = SIZE
) -> AsyncIterator[tuple[Stand, Page]]:
    async with (
        stand(distro, browser.built, robot=robot) as served,
        browser.page(f"{served.url}{path}", **size) as page,
    ):
        yield served, page


def text(selector: str) -> str:
    return f"document.querySelector({json.dumps(selector)})?.textContent"


async def open_tab(page: Page, title: str) -> None:
    """Show a docked panel, or open one."""
    await page.click(f".dv-tab >> text='{title}'")


@DISTROS
async def test_it_opens_by_itself_on_what_it_finds(browser: Browser, distro: str) -> None:
    async with dashboard(browser, distro) as (_, page):
        await page.wait("document.querySelector('.state-open')")
        for panel in ("scene", "camera", "teleop", "topics"):
            await page.wait(f"document.querySelector('.panel-{panel}')")
        await page.wait(f"{text('header')}.includes('ROS {'2 jazzy' if distro == 'jazzy' else 1}')")
        await page.wait("document.querySelector('.camera-state')?.textContent.includes('MJPEG')")
        # The map's floor, the scan and the yellow wall that the camera sees.
        picture = await page.picture_when(
            f"dashboard {distro}",
            lambda seen: (
                seen.count((245, 245, 249), 8) > 20_000
                and seen.count((54, 170, 249), 40) + seen.count((26, 228, 182), 40) > 100
                and seen.count((185, 140, 50), 45) > 3_000
            ),
        )
        assert picture.count((203, 28, 37), 12) > 1_000, "the stop button"


@DISTROS
async def test_it_is_driven_by_keys_while_they_are_held(browser: Browser, distro: str) -> None:
    async with dashboard(browser, distro) as (served, page):
        speeds: list[float] = []
        served.node.subscribe("/odom", lambda odom: speeds.append(odom.twist.twist.linear.x))
        await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
        await page.calm()  # Until the 3D view is loaded, the page is blocked again and again.
        grip = Grip(page, "key")
        await grip.drive_until(lambda: bool(speeds) and speeds[-1] == pytest.approx(0.4))
        await grip.release()
        await until(lambda: speeds[-1] == 0.0)


async def test_a_stick_and_buttons_drive_only_while_they_are_held(browser: Browser) -> None:
    async with dashboard(browser, "jazzy") as (served, page):
        sent: list[tuple[float, float]] = []
        served.node.subscribe("/cmd_vel", lambda twist: sent.append((twist.linear.x, twist.angular.z)))
        await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
        await page.calm()
        assert sent == []
        grip = Grip(page, "stick")
        await grip.drive_until(lambda: any(one == pytest.approx((0.4, 0), abs=0.03) for one in sent))
        await grip.release()
        await until(lambda: sent[-3:] == [(0.0, 0.0)] * 3)
        await page.evaluate("document.querySelector('.drive-left').focus()")
        await hold_until(page, " ", lambda: sent[-1] == pytest.approx((0.0, 0.8)))
        await page.keyboard("up", " ")
        await until(lambda: sent[-3:] == [(0.0, 0.0)] * 3)


async def test_stop_is_latched_and_cancels_goals(browser: Browser) -> None:
    async with dashboard(browser, "jazzy") as (served, page):
        speeds: list[float] = []
        served.node.subscribe("/odom", lambda odom: speeds.append(odom.twist.twist.linear.x))
        await open_tab(page, "Goal")
        await page.wait("document.querySelector('.goal [type=submit]:not(:disabled)')")
        await page.click("text=0.5 m ahead")
        await page.click("text=0.5 m ahead")
        await page.click("text=Go there")
        await until(lambda: bool(speeds) and max(speeds) > 0.1)
        await page.keyboard("press", "Escape")
        await page.wait("document.querySelector('.goal-canceled')")
        await until(lambda: speeds[-1] == 0.0)
        assert await page.evaluate("document.querySelector('.goal [type=submit]').matches(':disabled')")
        await release(page)
        await page.wait("document.querySelector('.goal [type=submit]:not(:disabled)')")


@asynccontextmanager
async def cuttable(url: str) -> AsyncIterator[tuple[str, anyio.Event]]:
    """The same server behind a network that falls silent: no byte passes, and nobody is told."""
    host, port = url.removeprefix("http://").rstrip("/").split(":")
    silent = anyio.Event()

    async def pump(source: anyio.abc.ByteStream, target: anyio.abc.ByteStream) -> None:
        with suppress(anyio.EndOfStream, anyio.BrokenResourceError, anyio.ClosedResourceError):
            while True:
                data = await source.receive()
                if silent.is_set():
                    await anyio.sleep_forever()
                await target.send(data)

    async def serve(client: anyio.abc.SocketStream) -> None:
        async with client, await anyio.connect_tcp(host, int(port)) as server:  # noqa: SIM117 - closes the client even if connecting to the server fails
            async with anyio.create_task_group() as pumps:
                pumps.start_soon(pump, client, server)
                pumps.start_soon(pump, server, client)

    async with (
        await anyio.create_tcp_listener(local_host="127.0.0.1") as listener,
        anyio.create_task_group() as tasks,
    ):
        tasks.start_soon(listener.serve, serve)
        yield f"http://127.0.0.1:{listener.extra(anyio.abc.SocketAttribute.local_port)}/", silent
        tasks.cancel_scope.cancel()


@pytest.mark.parametrize("end", ["tab", "network"])
async def test_the_robot_stops_when_the_tab_or_the_network_goes_while_it_drives(
    browser: Browser, end: str
) -> None:
    async with stand("jazzy", browser.built) as served, cuttable(served.url) as (url, silent):
        speeds: list[float] = []
        served.node.subscribe("/odom", lambda odom: speeds.append(odom.twist.twist.linear.x))
        async with browser.page(url, **SIZE) as page:
            await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
            await page.calm()
            await Grip(page, "key").drive_until(lambda: bool(speeds) and speeds[-1] == pytest.approx(0.4))
            if end == "network":
                silent.set()
                await until(lambda: speeds[-1] == 0.0)
        await until(lambda: speeds[-1] == 0.0)


async def test_a_click_in_the_scene_sends_the_robot_there(browser: Browser) -> None:
    async with dashboard(browser, "jazzy") as (served, page):
        await served.slow_down()
        goals: list[Any] = []
        served.node.subscribe("/plan", lambda plan: goals.append(plan.poses[-1].pose.position))
        await page.wait("document.querySelector('.scene-view')?.robotScene?.base")
        await page.click("text=Top view")
        await page.click("text=Set goal")
        spot = await page.evaluate(
            """(async () => {
              // The view turns, and notices below it change its height: until the spot stays where it is.
              const { view } = document.querySelector(".scene-view").robotScene;
              const at = view.controls.target.clone().set(-2.0, -2.0, 0);
              let spot = view.pixel(at);
              for (let frames = 0; frames < 20; frames++) {
                await new Promise(requestAnimationFrame);
                const now = view.pixel(at);
                if (now.x !== spot.x || now.y !== spot.y) frames = 0;
                spot = now;
              }
              return spot;
            })()"""
        )
        await page.mouse("move", spot["x"], spot["y"])
        await page.mouse("down")
        await page.mouse("move", spot["x"] + 60, spot["y"])
        await page.mouse("up")
        await page.wait("document.querySelector('.goal-underway')")
        await page.click(".goal-state button")
        await page.wait("document.querySelector('.goal-canceled')")
        await until(lambda: bool(goals))
        assert (goals[0].x, goals[0].y) == (pytest.approx(-2.0, abs=0.15), pytest.approx(-2.0, abs=0.15))


HOSTILE = "<img src=x onerror=\"document.title='broken in'\">"


async def test_names_texts_and_numbers_from_the_robot_are_shown_and_not_believed(browser: Browser) -> None:
    async with stand("jazzy", browser.built, robot=False) as served:
        texts = served.node.advertise("/text", "std_msgs/String", latch=True)
        texts.publish({"data": HOSTILE})
        served.node.advertise("/huge", "std_msgs/String", latch=True).publish({"data": "x" * 16_000_000})
        served.node.advertise("/robot_description", "std_msgs/String", latch=True).publish({"data": HOSTILE})
        scan = {
            "ranges": [float("nan"), float("inf"), 1.0],
            "range_max": float("inf"),
            "angle_increment": 1.0,
        }
        served.node.advertise("/scan", "sensor_msgs/LaserScan", latch=True).publish(scan)
        grid = {"info": {"width": 100_000, "height": 100_000, "resolution": 0.1}, "data": []}
        served.node.advertise("/map", "nav_msgs/OccupancyGrid", latch=True).publish(grid)
        odom = {"pose": {"pose": {"position": {"x": float("nan")}}}}
        served.node.advertise("/odom", "nav_msgs/Odometry", latch=True).publish(odom)
        async with browser.page(served.url, **SIZE) as page:
            await page.wait("document.querySelector('.panel-topics tbody tr')")
            await page.click("button >> text='/text'")
            await page.wait(f"{text('.panel-topics .tree')}.includes('onerror')")
            await page.click("button >> text='/huge'")
            await page.wait(f"{text('.panel-topics .tree')}.includes('more')")
            for fault in (
                "/map: the map's width is 100000",
                "/odom: the pose has NaN or infinite numbers",
                "/robot_description: the",
            ):
                await page.wait(f"{text('.scene-problems')}.includes({json.dumps(fault)})")
            assert await page.evaluate("document.querySelectorAll('img').length") == 0
            assert "broken" not in await page.evaluate("document.title")


async def test_ten_thousand_topics_are_listed_searched_and_break_nothing(browser: Browser) -> None:
    async with stand("jazzy", browser.built, robot=False) as served:
        for number in range(10_000):
            served.node.advertise(f"/many/topic_{number:05}", "std_msgs/Float64")
        async with browser.page(served.url, **SIZE) as page:
            await page.wait("document.querySelectorAll('.panel-topics tbody tr').length === 200")
            await page.click(".panel-topics input[type=search]")
            await page.evaluate(
                "((i) => { i.value = '09999'; i.dispatchEvent(new Event('input', {bubbles: true})) })"
                "(document.querySelector('.panel-topics input[type=search]'))"
            )
            await page.wait("document.querySelectorAll('.panel-topics tbody tr').length === 1")


@DISTROS
async def test_a_message_is_published_from_a_form_that_knows_its_type(browser: Browser, distro: str) -> None:
    async with dashboard(browser, distro, robot=False) as (served, page):
        heard: list[Any] = []
        served.node.subscribe("/pose", heard.append, "geometry_msgs/PoseStamped")
        await page.wait("document.querySelector('.panel-topics tbody tr')")
        await page.click("button >> text='/pose'")
        await page.click(".panel-topics summary >> text=Publish")
        await page.wait("document.querySelector('.message-form input')")
        fill = """((name, value) => {
          const labels = [...document.querySelectorAll(".message-form label")];
          const input = labels.find(l => l.textContent.startsWith(name)).querySelector("input");
          input.value = value;
          input.dispatchEvent(new Event("input", { bubbles: true }));
        })"""
        await page.evaluate(f"{fill}('x', 'nonsense')")
        await page.wait("document.querySelector('.message-form .problem')")
        assert await page.evaluate("document.querySelector('.panel-topics form [type=submit]').disabled")
        await page.evaluate(f"{fill}('x', '1.5')")
        await page.evaluate(f"{fill}('frame_id', 'map')")
        await page.click(".panel-topics form [type=submit]")
        await until(lambda: bool(heard))
        assert (heard[0].pose.position.x, heard[0].header.frame_id) == (1.5, "map")


async def test_a_viewer_sees_no_controls_that_it_may_not_use_and_why(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0", demo=True, auth={"default_role": "viewer"}) as server,
        browser.page(server.urls[0].replace("ws", "http", 1) + "/", **SIZE) as page,
    ):
        await page.wait("document.querySelector('.camera-state')")
        assert not await page.evaluate("document.querySelector('.panel-teleop, .panel-goal')")
        await page.wait(f"{text('header')}.includes('viewer')")
        await page.click("button >> text='/cmd_vel'")
        await page.wait(f"{text('.refusal')}?.includes('viewer')")
        await page.wait("document.querySelector('.scene-tools button')?.disabled")


async def test_a_token_is_asked_for_and_kept_out_of_every_address(browser: Browser) -> None:
    tokens = {"tablet": {"token": TOKEN, "role": "admin"}}
    targets: list[str] = []
    async with (
        Server("ws://127.0.0.1:0", demo=True, auth={"tokens": tokens}) as server,
        browser.page(server.urls[0].replace("ws", "http", 1) + "/", **SIZE) as page,
    ):
        await page.wait("document.querySelector('[name=token]')")
        await page.evaluate(
            f"((i) => {{ i.value = {TOKEN!r}; i.dispatchEvent(new Event('input', {{bubbles: true}})) }})"
            "(document.querySelector('[name=token]'))"
        )
        await page.click("text=Sign in")
        await page.wait("document.querySelector('.camera-state')?.textContent.includes('MJPEG')")
        targets += await page.evaluate("performance.getEntriesByType('resource').map(r => r.name)")
        assert TOKEN not in "".join([*targets, await page.evaluate("location.href")])
        assert await page.evaluate("Object.values(sessionStorage).length") == 1
        assert TOKEN not in await page.evaluate("JSON.stringify(localStorage)")
        # The robot's meshes are for those with a token, too: a wheel is drawn, and no file is missing.
        row = "document.querySelector('.scene-view')?.robotScene?.rows.value.find((it) => it.layer?.robot)"
        meshes = f"{row}?.layer.robot.getObjectsByProperty('isMesh', true).length"
        await page.wait(f"{meshes} > 5")
        assert await page.evaluate(f"{row}.layer.problem.value") == ""
        # Refusals before the token are errors of the network on the console, and expected.
        page.forgive("401", REFUSED)


async def test_all_is_restored_after_the_server_was_away(browser: Browser) -> None:
    first = Server("ws://127.0.0.1:0", demo=True)
    await first.__aenter__()
    url = first.urls[0]
    async with browser.page(url.replace("ws", "http", 1) + "/", **SIZE) as page:
        await page.wait("document.querySelector('.camera-state')?.textContent.includes('MJPEG')")
        drawn = "document.querySelector('.scene-view').robotScene.view.drawn"
        # With all its meshes: what is cut off while it loads is another story.
        texts: list[str] = []
        first.node("reader").subscribe(
            "/robot_description", lambda text: texts.append(text.data), "std_msgs/String"
        )
        await until(lambda: bool(texts))
        meshes = len(set(re.findall(r'filename="([^"]+)"', texts[0])))
        loaded = "performance.getEntriesByType('resource').filter(r => r.name.includes('/packages/'))"
        await page.wait(f"new Set({loaded}.map(r => r.name)).size >= {meshes}")
        await page.evaluate("document.querySelector('.camera canvas').dataset.same = 'yes'")
        await first.__aexit__(None, None, None)
        await page.wait("document.querySelector('.state-lost')")
        async with Server(url, demo=True) as second:
            await page.wait("document.querySelector('.state-open')")
            before = await page.evaluate(drawn)
            await page.wait(f"{drawn} > {before} + 3")
            heard: list[float] = []
            second.node("test").subscribe("/cmd_vel", lambda twist: heard.append(twist.linear.x))
            await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
            await page.calm()
            await page.evaluate("document.querySelector('.drive-left').focus()")
            await hold_until(page, "ArrowUp", lambda: 0.4 in [round(each, 2) for each in heard])
            await page.keyboard("up", "ArrowUp")
            assert await page.evaluate("document.querySelector('.camera canvas').dataset.same") == "yes"
            page.forgive(REFUSED, "ERR_CONNECTION", "WebSocket", "ERR_INCOMPLETE_CHUNKED", "Failed to fetch")


@DISTROS
async def test_the_page_alone_works_with_another_server(browser: Browser, distro: str) -> None:
    async with (
        stand(distro, browser.built) as served,
        serve_page("ws://127.0.0.1:0", served.url.replace("http", "ws", 1)) as listener,
        browser.page(listener.url.replace("ws", "http", 1), **SIZE) as page,
    ):
        heard: list[float] = []
        served.node.subscribe("/cmd_vel", lambda twist: heard.append(twist.linear.x))
        await page.picture_when(
            f"page alone {distro}",
            lambda seen: seen.count((245, 245, 249), 8) > 20_000 and seen.count((185, 140, 50), 45) > 3_000,
        )
        await page.evaluate("document.querySelector('.drive-left').focus()")
        await hold_until(page, "w", lambda: bool(heard) and heard[-1] == pytest.approx(0.4))
        await page.keyboard("up", "w")


@pytest.mark.parametrize("alone", [False, True])
async def test_it_works_with_a_server_that_speaks_the_text_of_ros_1(browser: Browser, alone: bool) -> None:
    """The profile `ros1` refuses what the protocol of 2013 has not."""
    async with (
        Server("ws://127.0.0.1:0", distro="noetic", profile="ros1", demo=True) as server,
        serve_page("ws://127.0.0.1:0", server.urls[0]) as listener,
        browser.page((listener.url if alone else server.urls[0]).replace("ws", "http", 1), **SIZE) as page,
    ):
        heard: list[float] = []
        server.node("test").subscribe("/cmd_vel", lambda twist: heard.append(twist.linear.x))
        for panel in ("scene", "camera", "teleop", "topics"):
            await page.wait(f"document.querySelector('.panel-{panel}')")
        await page.picture_when(
            f"profile ros1 {'alone' if alone else ''}",
            lambda seen: seen.count((245, 245, 249), 8) > 20_000 and seen.count((185, 140, 50), 45) > 3_000,
        )
        await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
        await page.calm()
        await page.evaluate("document.querySelector('.drive-left').focus()")
        await hold_until(page, "w", lambda: bool(heard) and heard[-1] == pytest.approx(0.4))
        await page.keyboard("up", "w")
        await until(lambda: heard[-3:] == [0.0] * 3)
        await open_tab(page, "Services")
        await page.click("button >> text='/add_two_ints'")
        await page.wait("document.querySelector('.panel-services .message-form input')")
        await page.click(".panel-services [type=submit]")
        await page.wait(f"{text('.panel-services [role=status]')}?.includes('sum')")
        assert await page.evaluate("[...document.querySelectorAll('.notice')].map(n => n.textContent)") == []


async def test_a_phone_shows_one_panel_at_a_time_and_is_driven_by_a_thumb(browser: Browser) -> None:
    async with dashboard(browser, "jazzy", size=PHONE) as (served, page):
        heard: list[float] = []
        served.node.subscribe("/cmd_vel", lambda twist: heard.append(twist.linear.x))
        await page.click("[role=tab] >> text=Drive")
        await page.wait("document.querySelectorAll('.panel').length === 1")
        await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
        await page.calm()
        box = await page.evaluate(
            "(({x, y, width, height}) => [x + width / 2, y + height / 2, width, height])"
            "(document.querySelector('.drive-forward').getBoundingClientRect())"
        )
        assert min(box[2:]) >= 44, "large enough for a thumb"
        await page.mouse("move", *box[:2])
        await page.mouse("down")
        await until(lambda: bool(heard) and heard[-1] == pytest.approx(0.4))
        await page.mouse("up")
        await page.picture("phone")
        assert await page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        stop = await page.evaluate(
            "document.querySelector('.stop').getBoundingClientRect().right <= innerWidth"
        )
        assert stop

        # A list has the page to itself until something of it is chosen, which takes half at most.
        await page.click("[role=tab] >> text=Topics")
        share = "document.querySelector('.list').clientHeight / document.querySelector('.split').clientHeight"
        await page.wait(f"document.querySelector('.topic-table tbody tr') && {share} > 0.85")
        await page.click(".topic-table >> text=/odom")
        await page.wait(f"document.querySelector('.detail .tree') && Math.abs({share} - 0.5) < 0.05")


async def test_layouts_are_kept_and_opened_by_a_link(browser: Browser, tmp_path: Path) -> None:
    layout = {
        "version": 1,
        "panels": [{"id": "topics", "kind": "topics", "config": {"topic": "/odom"}}],
        "dock": None,
    }
    (tmp_path / "only-topics.json").write_text(json.dumps(layout))
    async with Server("ws://127.0.0.1:0", demo=True, web={"layouts": tmp_path}) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}?layout=only-topics", **SIZE) as page:
            await page.wait(f"{text('.panel-topics h2')} === '/odom'")
            assert await page.evaluate("document.querySelectorAll('.panel').length") == 1
            await page.click("summary:has-text('Add panel')")
            await page.click(".menu >> text=Camera")
            await page.wait("document.querySelector('.camera-state')")
            await page.evaluate("location.replace(location.pathname)")
            await page.wait("document.querySelectorAll('.panel').length === 2")
        async with browser.page(f"{url}?layout=missing", **SIZE) as page:
            await page.wait(f"{text('.notice-error')}?.includes('missing')")
            page.forgive("404")


async def test_layouts_are_opened_once_the_user_has_given_a_token(browser: Browser, tmp_path: Path) -> None:
    panel = {"id": "topics", "kind": "topics", "config": {"topic": "/odom"}}
    (tmp_path / "only-topics.json").write_text(json.dumps({"version": 1, "panels": [panel], "dock": None}))
    token = "token-of-a-viewer-of-this-robot"
    auth = {"tokens": {"viewer": {"token": token, "role": "viewer"}}}
    async with Server("ws://127.0.0.1:0", demo=True, web={"layouts": tmp_path}, auth=auth) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}?layout=only-topics", **SIZE) as page:
            page.forgive("401")
            await page.wait("document.querySelector('input[name=token]')")
            await page.evaluate("document.querySelector('input[name=token]').focus()")
            for character in token:
                await page.keyboard("press", character)
            await page.keyboard("press", "Enter")
            await page.wait(f"{text('.panel-topics h2')} === '/odom'")
            assert await page.evaluate("document.querySelectorAll('.panel').length") == 1
            assert await page.evaluate("document.querySelector('.notice-error') === null")
            await page.click("summary:has-text('Layouts')")
            await page.wait(
                "[...document.querySelectorAll('.layouts a')].some(a => a.text === 'only-topics')"
            )


async def test_a_page_at_a_hub_changes_to_another_robot(browser: Browser) -> None:
    async with (
        open_hub("ws://127.0.0.1:0") as hub,
        Server(dial={"urls": [f"{hub.url}/robots/rosie"]}, demo=True),
        Server(dial={"urls": [f"{hub.url}/robots/robbie"]}),
    ):
        await until(lambda: len(hub.robots) == 2)
        url = hub.url.replace("ws", "http", 1)
        async with browser.page(f"{url}/rosie/", 900, 600) as page:
            page.forgive(LEFT_MESH, LEFT_STREAM)
            await page.wait("document.querySelector('.state-open')")
            await page.click('header .menus summary:has-text("Robots")')
            links = "[...document.querySelectorAll('.menus .pair a[aria-label]')]"
            names = f"{links}.map((it) => it.ariaLabel).join()"
            await page.wait(f"{names} === 'robbie in a new window,rosie in a new window'")
            assert (
                await page.evaluate("document.querySelector('.menus a[aria-current]').textContent") == "rosie"
            )
            await page.click('.menus .pair a:has-text("robbie")')
            await page.wait("location.pathname === '/robbie/' && document.querySelector('.state-open')")
            # The other robot has no wheels.
            await page.wait("!document.querySelector('.panel-teleop')")
