"""Safety of the dashboard: what it sends while stopped or without a connection, and how it is released."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import anyio
import pytest

from rwt import Server
from rwt.extensions.markers import Colour, InteractiveMarkerServer, box, interactive_marker, move_plane
from tests.browser.driver import Browser, Page
from tests.browser.stalling_proxy import StallingProxy, stalling_proxy
from tests.browser.test_panels import open_panels, text
from tests.waiting import until

pytestmark = pytest.mark.anyio

TWIST = "geometry_msgs/Twist"
PANELS: list[tuple[str, dict[str, object]]] = [
    ("teleop", {"topic": "/cmd_vel"}),
    ("goal", {}),
    ("topics", {"topic": "/cmd_vel"}),
    ("services", {"name": "/add_two_ints"}),
    ("actions", {"name": "/fibonacci"}),
    ("parameters", {"node": "/demo_robot"}),
    ("scene", {"waypoints": [{"place": {"x": 1.0, "y": 0.0, "yaw": 0.0}, "frame": "map"}]}),
]
#: What holds the joints of an arm.
HOLD: dict[str, list[object]] = {"joint_names": [], "points": []}
#: The panels that the menu of a page offers, by the names of their kinds.
ALL = """[...document.querySelectorAll('[data-kind]')].map((it) => it.dataset.kind)"""

#: Records what the page sends. The worker's own questions, which are not recorded, only ask for the time.
RECORD = """(() => {
  globalThis.sent = [];
  const post = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (message, ...rest) {
    if (message?.kind === "send") {
      const { op, topic, service, action, msg } = JSON.parse(message.text);
      globalThis.sent.push([op, topic ?? service ?? action ?? "", JSON.stringify(msg ?? "")]);
    }
    return post.call(this, message, ...rest);
  };
})()"""

#: Tries every control of the panel that is shown, also those that look disabled.
TRY_ALL = """(async () => {
  const pause = (ms) => new Promise((later) => setTimeout(later, ms));
  const panel = document.querySelector(".panel");
  for (const it of panel.querySelectorAll("details")) it.open = true;
  await pause(300);
  const key = (it, type, key) => it.dispatchEvent(new KeyboardEvent(type, { key, bubbles: true }));
  for (const form of panel.querySelectorAll("form")) {
    try { form.requestSubmit(); } catch {}
  }
  for (const it of panel.querySelectorAll("input, select")) {
    if (it.type === "checkbox") { it.click(); await pause(20); it.click(); continue; }
    for (const type of ["input", "change"]) it.dispatchEvent(new Event(type, { bubbles: true }));
  }
  for (const it of panel.querySelectorAll("button, .stick, canvas")) {
    // Another topic or service would be chosen.
    if (!it.isConnected || it.closest(".list")) continue;
    const { left, top, width, height } = it.getBoundingClientRect();
    const [clientX, clientY] = [left + width / 2, top + height / 4];
    const at = { bubbles: true, pointerId: 1, button: 0, clientX, clientY };
    for (const type of ["pointerdown", "pointermove"]) {
      try { it.dispatchEvent(new PointerEvent(type, at)); } catch {}
    }
    await pause(20);
    it.dispatchEvent(new PointerEvent("pointerup", at));
    for (const name of ["Enter", "ArrowUp"]) key(it, "keydown", name);
    await pause(20);
    for (const name of ["Enter", "ArrowUp"]) key(it, "keyup", name);
    it.click?.();
  }
  const scene = panel.querySelector(".scene-view")?.robotScene;
  if (scene) {
    // Layers that were switched off and on again ask for their markers anew.
    const handles = () => scene.rows.value.some(({ layer }) => layer?.handles.value.length);
    for (let turn = 0; turn < 100 && !handles(); turn++) await pause(100);
    for (const { layer } of scene.rows.value) {
      for (const handle of layer?.handles.value ?? []) {
        handle.key("ArrowUp", false);
        handle.release(true);
        handle.press({ x: 0, y: 0 });
      }
    }
    const place = { x: 0, y: 0, yaw: 0 };
    for (const tool of ["goal", "pose", "point", "waypoint"]) scene.tools.onPlace(tool, place);
  }
  await pause(200);
})()"""

#: Services that only answer.
QUESTIONS = ("/is_paused", "/get_rate", "/describe_parameters", "/get_interactive_markers")
#: Services that stop something, or reduce what this page may do.
SAFE = ("/recorder/stop", "/gate/release_lease", "/gate/stop")


def commands(sent: list[list[str]]) -> set[tuple[str, str]]:
    """Return the recorded ops that act on the robot."""

    def acts(op: str, name: str, message: str) -> bool:
        if op == "publish":
            # To stand still is no command.
            values = json.loads(message)
            if values == HOLD:
                return False
            parts = [values[each] for each in ("linear", "angular") if each in values]
            return not parts or any(value for part in parts for value in part.values())
        if op == "call_service":
            is_read = name.startswith("/rosapi/") and not name.startswith("/rosapi/set")
            return not is_read and not name.endswith(QUESTIONS) and name not in SAFE
        return op == "send_action_goal"

    return {(op, name) for op, name, message in sent if acts(op, name, message)}


@asynccontextmanager
async def walk(browser: Browser, **settings: Any) -> AsyncIterator[tuple[Server, Page]]:
    """Open all panels, one shown at a time, at a robot with everything that takes commands."""
    async with Server("ws://127.0.0.1:0", demo=True, **settings) as server:
        node = server.node("marks")
        node.advertise("/initialpose", "geometry_msgs/PoseWithCovarianceStamped")
        markers = InteractiveMarkerServer(node, "/marks")
        cube = box((1.0, 1.0, 0.1), Colour(0.0, 1.0, 1.0, 0.9))
        markers.insert(interactive_marker("slab", controls=[move_plane("z", cube)]))
        markers.apply_changes()
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 700, 700) as page:
            page.forgive("Invalid pointer id", "setPointerCapture", "NotFoundError", "404")
            await open_panels(page, url, PANELS)
            await page.click('header .menus summary:has-text("Add panel")')
            kinds: list[str] = await page.wait(f"{ALL}.length && {ALL}")
            known = {kind for kind, _ in PANELS}
            await open_panels(page, url, [*PANELS, *((kind, {}) for kind in kinds if kind not in known)])
            yield server, page


async def try_all(page: Page, *, is_viewer: bool = False) -> set[tuple[str, str]]:
    """Try every control of every panel; return the ops that act on the robot.

    Args:
        is_viewer: most controls are missing.
    """
    await page.evaluate("globalThis.sent.length = 0")
    tabs = await page.evaluate("[...document.querySelectorAll('[role=tab]')].map((it) => it.id.slice(4))")
    assert len(tabs) >= 20
    for kind in tabs:
        await page.evaluate(f"document.getElementById('tab {kind}').click()")
        await page.wait(f"document.querySelector('.panel-{kind}')")
        ready = {
            "joints": ".jog input",
            "topics": ".panel-topics summary",
            "services": ".message-form input",
            "actions": ".message-form input",
            "parameters": ".panel-parameters tbody tr",
            "scene": ".scene-tools",
        }.get(kind)
        if ready and (kind == "scene" or not is_viewer):
            await page.wait(f"document.querySelector({ready!r})")
        if kind == "scene" and not is_viewer:
            rows = "document.querySelector('.scene-view').robotScene.rows.value"
            await page.wait(f"{rows}.some(({{ layer }}) => layer?.handles.value.length)")
        if kind == "topics" and not is_viewer:
            await page.evaluate("document.querySelector('.detail details').open = true")
            await page.wait("document.querySelector('.message-form input')")
            # Zero is no command: something that moves is to be published.
            await page.evaluate(
                """(() => {
                  const input = document.querySelector('.message-form input');
                  input.value = '0.3';
                  input.dispatchEvent(new Event('input', { bubbles: true }));
                })()"""
            )
        await page.evaluate(TRY_ALL)
    sent: list[list[str]] = await page.evaluate("globalThis.sent")
    return commands(sent)


async def test_while_stopped_no_control_of_any_panel_sends_a_command(browser: Browser) -> None:
    async with walk(browser) as (server, page):
        moved: list[float] = []
        server.node("wheels").subscribe("/cmd_vel", lambda twist: moved.append(twist.linear.x), TWIST)
        await page.evaluate(RECORD)
        sent = await try_all(page)
        # The walk reaches every way in which the page commands a robot.
        for act in (
            ("publish", "/cmd_vel"),
            ("publish", "/arm_controller/joint_trajectory"),
            ("publish", "/marks/feedback"),
            ("publish", "/initialpose"),
            ("publish", "/clicked_point"),
            ("call_service", "/add_two_ints"),
            ("call_service", "/rosapi/set_param"),
            ("send_action_goal", "/fibonacci"),
            ("send_action_goal", "/navigate_to_pose"),
        ):
            assert act in sent
        await page.keyboard("press", "Escape")
        await page.wait("document.querySelector('.stopped')")
        await anyio.sleep(0.5)
        moved.clear()
        assert await try_all(page) == set()
        assert set(moved) <= {0.0}
        await page.wait(f"{text('.notices')}.includes('not sent. Blocked: the stop is on.')")


async def test_a_viewer_sends_no_command_by_any_control(browser: Browser) -> None:
    viewer = {"default_role": "viewer"}
    async with walk(browser, auth=viewer) as (_, page):
        await page.evaluate(RECORD)
        assert await try_all(page, is_viewer=True) == set()
        # Some have no control that could be disabled, as a click in the 3D view.
        await page.wait(f"{text('.notices')}.includes('not sent. Your role does not allow it.')")


#: Clicks each box of the list of layers twice, the second time before or after the list is drawn again.
CLICK_TWICE = """(async () => {
  const boxes = [...document.querySelectorAll(".panel-scene input[type=checkbox]")];
  for (const [index, box] of boxes.entries()) {
    box.click();
    if (index % 4) await new Promise((later) => setTimeout(later, 8 * (index % 4 - 1)));
    box.click();
  }
  return boxes.length;
})()"""


async def test_a_layer_that_is_switched_twice_is_as_before(browser: Browser) -> None:
    async with walk(browser) as (_, page):
        await page.evaluate("document.getElementById('tab scene').click()")
        rows = "document.querySelector('.scene-view')?.robotScene?.rows.value"
        await page.wait(f"{rows}?.some(({{ layer }}) => layer?.handles.value.length)")
        await page.evaluate(
            "document.querySelectorAll('.panel-scene details').forEach((it) => { it.open = true; })"
        )
        shown = f"JSON.stringify({rows}.filter(({{ layer }}) => layer).map(({{ topic }}) => topic))"
        await anyio.sleep(1)  # Until all topics are known.
        before = await page.evaluate(shown)
        assert await page.evaluate(CLICK_TWICE) >= 4
        await page.wait(f"{shown} === {json.dumps(before)}")


STOPPED = "document.querySelector('.stopped')"
PLACE = "(b => [b.left, b.top, b.right, b.bottom])(document.querySelector({!r}).getBoundingClientRect())"


async def press_at(page: Page, x: float, y: float, seconds: float) -> None:
    """Press the mouse at a place for a time."""
    await page.mouse("move", x, y)
    await page.mouse("down")
    await anyio.sleep(seconds)
    await page.mouse("up")


@pytest.mark.parametrize("size", [(1300, 800), (390, 844), (844, 390)])
async def test_only_holding_another_control_releases_the_stop(
    browser: Browser, size: tuple[int, int]
) -> None:
    async with Server("ws://127.0.0.1:0", demo=True) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", *size) as page:
            await open_panels(page, url, [("teleop", {"topic": "/cmd_vel"})])
            await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
            left, top, right, bottom = await page.evaluate(PLACE.format(".stop"))
            x, y = (left + right) / 2, (top + bottom) / 2
            for seconds in (0.0, 0.05, 1.5, 0.0):
                await press_at(page, x, y, seconds)
                await page.wait(STOPPED)
            left, top, right, bottom = await page.evaluate(PLACE.format(".release"))
            assert not (left <= x <= right and top <= y <= bottom)
            await press_at(page, (left + right) / 2, (top + bottom) / 2, 0.0)
            await anyio.sleep(1.2)
            assert await page.evaluate(f"Boolean({STOPPED})")
            await press_at(page, (left + right) / 2, (top + bottom) / 2, 1.6)
            await page.wait(f"!{STOPPED}")


@pytest.mark.parametrize(
    ("panel", "focus"),
    [
        (("topics", {}), ".panel-topics input"),
        (("scene", {}), ".scene-view canvas"),
        (("teleop", {}), ".drive-left"),
    ],
    ids=["text", "canvas", "drive"],
)
@pytest.mark.parametrize("size", [(1300, 800), (390, 844)])
async def test_escape_stops_from_every_focus(
    browser: Browser, panel: tuple[str, dict[str, object]], focus: str, size: tuple[int, int]
) -> None:
    async with Server("ws://127.0.0.1:0", demo=True) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", *size) as page:
            await open_panels(page, url, [panel])
            await page.wait(f"document.querySelector({focus!r})")
            if "canvas" in focus:
                await page.wait("document.querySelector('.scene-tools button')")
                await page.evaluate(
                    "document.querySelector('.scene-view').robotScene.tools.choose('measure')"
                )
            await page.evaluate(f"document.querySelector({focus!r}).focus()")
            await page.keyboard("press", "Escape")
            await page.wait(STOPPED)


async def test_a_page_that_stalls_says_that_driving_ended(browser: Browser) -> None:
    async with (
        Server("ws://127.0.0.1:0", demo=True) as server,
        browser.page(f"{server.urls[0].replace('ws', 'http', 1)}/healthz", 700, 700) as page,
    ):
        url = server.urls[0].replace("ws", "http", 1) + "/"
        await open_panels(page, url, [("teleop", {"topic": "/cmd_vel", "sound": True})])
        await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
        await page.evaluate(
            """(() => {
              globalThis.tones = 0;
              const { start } = OscillatorNode.prototype;
              OscillatorNode.prototype.start = function () { tones++; return start.call(this); };
            })()"""
        )
        await page.calm()
        await page.evaluate("document.querySelector('.drive-left').focus()")
        await page.keyboard("down", "ArrowUp")
        await page.evaluate("(() => { const end = Date.now() + 900; while (Date.now() < end); })()")
        await page.wait(f"{text('.drive')}.includes('release the control, and take it again')")
        await page.wait("tones === 1")
        await page.keyboard("up", "ArrowUp")
        assert await page.evaluate(f"{text('.drive')}.includes('take it again')")
        await page.keyboard("down", "ArrowUp")
        await page.wait(f"!{text('.drive')}.includes('take it again')")
        await page.keyboard("up", "ArrowUp")


MENU = "header .menus details[open]"


@asynccontextmanager
async def open_menu(
    browser: Browser, *panels: tuple[str, dict[str, object]], **settings: Any
) -> AsyncIterator[tuple[Server, Page, Callable[[], Awaitable[None]]]]:
    """A page, and what unfolds one of its menus."""
    async with Server("ws://127.0.0.1:0", demo=True, **settings) as server:
        url = server.urls[0].replace("ws", "http", 1) + "/"
        async with browser.page(f"{url}healthz", 1300, 800) as page:
            await open_panels(page, url, list(panels))

            async def unfold() -> None:
                await page.click('header .menus summary:has-text("Add panel")')
                await page.wait(f"document.querySelector({MENU!r})")

            yield server, page, unfold


@pytest.mark.parametrize("focus", ["in the menu", "nowhere"])
async def test_escape_only_closes_a_menu_while_nothing_moves(browser: Browser, focus: str) -> None:
    async with open_menu(browser, ("log", {})) as (_, page, unfold):
        await unfold()
        if focus == "nowhere":
            await page.evaluate("document.activeElement.blur()")
        await page.keyboard("press", "Escape")
        await page.wait(f"!document.querySelector({MENU!r})")
        assert not await page.evaluate(STOPPED)
        await page.keyboard("press", "Escape")
        await page.wait(STOPPED)


async def test_escape_in_a_menu_stops_what_this_page_drives(browser: Browser) -> None:
    async with open_menu(browser, ("teleop", {"topic": "/cmd_vel"})) as (_, page, unfold):
        await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
        await page.evaluate("document.querySelector('.drive-left').focus()")
        await page.keyboard("down", "ArrowUp")
        await page.keyboard("up", "ArrowUp")
        await unfold()
        await page.keyboard("press", "Escape")
        await page.wait(STOPPED)


async def test_escape_in_a_menu_stops_a_goal(browser: Browser) -> None:
    async with open_menu(browser, ("actions", {"name": "/fibonacci"})) as (_, page, unfold):
        await page.wait("document.querySelector('.message-form input')")
        await page.evaluate(
            "((i) => { i.value = '40'; i.dispatchEvent(new Event('input', {bubbles: true})) })"
            "(document.querySelector('.message-form input'))"
        )
        await page.click(".panel-actions [type=submit]")
        await page.wait(f"{text('.panel-actions')}.includes('Feedback')")
        await unfold()
        await page.keyboard("press", "Escape")
        await page.wait(STOPPED)


async def test_escape_in_a_menu_stops_for_the_holder_of_a_lease(browser: Browser) -> None:
    rule = {"topics": ["/cmd_vel"], "lease": {"seconds": 60}, "stop": {}}
    gate = {"rules": {"drive": rule}}
    async with open_menu(browser, ("teleop", {"topic": "/cmd_vel"}), gate=gate) as (_, page, unfold):
        await page.click("text=Take the lease")
        await page.wait(f"{text('.lease')}.includes('Release the lease')")
        await unfold()
        await page.keyboard("press", "Escape")
        await page.wait(STOPPED)


@asynccontextmanager
async def linked(
    browser: Browser, *panels: tuple[str, dict[str, object]]
) -> AsyncIterator[tuple[Server, StallingProxy, Page]]:
    """A page whose connection can stall."""
    async with (
        Server("ws://127.0.0.1:0", demo=True) as server,
        stalling_proxy(int(server.urls[0].rsplit(":", 1)[1].strip("/"))) as link,
    ):
        url = f"http://127.0.0.1:{link.port}/"
        async with browser.page(f"{url}healthz", 900, 700) as page:
            page.forgive("WebSocket", "Failed to load", "ERR_")
            await open_panels(page, url, list(panels))
            yield server, link, page


async def test_a_lost_connection_is_seen_and_nothing_drives_by_itself_afterwards(browser: Browser) -> None:
    async with linked(browser, ("topics", {"topic": "/odom"}), ("goal", {})) as (server, link, page):
        odom: list[float] = []
        server.node("watch").subscribe("/odom", lambda it: odom.append(it.twist.twist.linear.x))
        await page.wait("document.querySelector('.goal [type=submit]:not(:disabled)')")
        link.stall()
        await page.wait("document.querySelector('.goal [type=submit]').matches(':disabled')")
        await page.wait(f"{text('.panel-goal .blocked')}.startsWith('Blocked: ')")
        await page.wait("document.querySelector('.panel-topics.stale[data-age$=\" s old\"]')")
        await page.wait(f"{text('.link-lost')}.includes('No answer from the robot')")
        await page.wait(f"{text('.link-lost')}.includes('Connection lost (')")
        await page.wait(f"/Next attempt in [0-9]+ s|Connecting/.test({text('.link-lost')})")
        # Pressed without a connection, the stop is the first that the robot gets.
        await page.keyboard("press", "Escape")
        await page.wait(f"{text('.stopped')}.includes('sent first')")
        commanded: list[Any] = []
        server.node("wheels").subscribe("/cmd_vel", commanded.append, TWIST)
        link.resume()
        await page.wait("document.querySelector('.state-open') && !document.querySelector('.link-lost')")
        await page.wait("!document.querySelector('.stale')")
        await until(lambda: len(commanded) > 3)
        assert {each.linear.x for each in commanded} == {0.0}
        assert await page.evaluate(f"{text('.stopped')}.includes('until you release')")


async def test_notices_cover_no_control_and_repeats_merge(browser: Browser) -> None:
    async with linked(browser, ("teleop", {})) as (_, _link, page):
        await page.wait("document.querySelector('.drive-forward:not(:disabled)')")
        before = await page.evaluate(PLACE.format(".drive-forward"))
        # The same status twelve times, with another number each time.
        await page.evaluate(
            """(() => {
              const worker = Worker.prototype;
              const post = worker.postMessage;
              worker.postMessage = function (message, ...rest) {
                globalThis.decoder = this;
                return post.call(this, message, ...rest);
              };
            })()"""
        )
        await page.wait("Boolean(globalThis.decoder)")
        await page.evaluate(
            """(() => {
              for (let lost = 1; lost <= 12; lost++) {
                const message = { op: "status", level: "warning", msg: `/cloud: ${lost} messages dropped` };
                const data = { kind: "message", socket: 1, mustTake: false, message };
                globalThis.decoder.onmessage({ data });
              }
            })()"""
        )
        await page.wait(f"{text('.notices')}.includes('/cloud: 12 messages dropped \u00d7 12')")
        assert await page.evaluate("document.querySelectorAll('.notice').length") == 1
        assert await page.evaluate(PLACE.format(".drive-forward")) == before
        covered = """[...document.querySelectorAll('main button, header button')].filter((it) => {
          const { left, top, width, height } = it.getBoundingClientRect();
          return document.elementFromPoint(left + width / 2, top + height / 2)?.closest('.notices');
        }).length"""
        assert await page.evaluate(covered) == 0


async def test_a_page_without_panels_offers_some(browser: Browser) -> None:
    async with linked(browser, ("topics", {})) as (_, _link, page):
        await page.wait("document.querySelector('.panel-topics tbody tr')")
        await page.click('[aria-label="Close Topics"]')
        await page.wait(f"{text('.no-panels')}.includes('All panels are closed.')")
        await page.click("text=Reset layout")
        await page.wait("document.querySelector('.panel-scene') && !document.querySelector('.no-panels')")
