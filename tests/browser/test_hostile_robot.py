"""The page at a server that means it ill: names that are HTML, numbers that are none, far too much of all."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from typing import Any
from xml.sax.saxutils import escape

import pytest
from websockets.asyncio.server import ServerConnection, serve

from rwt.extensions.dashboard.page_server import serve_page
from tests.browser.driver import REFUSED, Browser
from tests.browser.test_panels import KINDS, open_panels, text

pytestmark = pytest.mark.anyio

HOSTILE = "<img src=x onerror=\"document.title='broken in'\">"
#: As JSON has it: 1e999 is read as an infinity, and null stands where NaN would.
INFINITE = "@infinite@"
TYPES = (
    *("std_msgs/String", "geometry_msgs/Twist", "sensor_msgs/Image", "sensor_msgs/CompressedImage"),
    *("sensor_msgs/PointCloud2", "sensor_msgs/LaserScan", "sensor_msgs/BatteryState", "nav_msgs/Odometry"),
    "sensor_msgs/NavSatFix",
    *("nav_msgs/OccupancyGrid", "nav_msgs/Path", "visualization_msgs/MarkerArray", "rosgraph_msgs/Log"),
    *("diagnostic_msgs/DiagnosticArray", "geometry_msgs/PoseStamped", "rosbridge_msgs/ConnectedClients"),
    "trajectory_msgs/JointTrajectory",
)
NAMED = {
    "/tf": "tf2_msgs/TFMessage",
    "/rosout": "rosgraph_msgs/Log",
    "/gate/approvals": "rwt_gate_msgs/Approvals",
    "/gate/leases": "rwt_gate_msgs/Leases",
    "/gate/stopped": "rwt_gate_msgs/EmergencyStop",
    "/recorder/state": "rwt_recorder_msgs/RecorderState",
    "/robot_description": "std_msgs/String",
    "/joint_states": "sensor_msgs/JointState",
}
#: By topic, so that names of topics are hostile, too.
TOPICS = {f"/{HOSTILE}/{number}": type for number, type in enumerate(TYPES)} | NAMED
SERVICES = [
    *("/gate/stop", "/gate/approve", "/recorder/start", "/recorder/stop", "/player/toggle_paused"),
    *("/player/get_rate", f"/{HOSTILE}/toggle_paused", f"/{HOSTILE}/list_parameters", f"/{HOSTILE}"),
]
#: Panels that show nothing which the robot says as a text.
SILENT = {"device", "camera", "joints", "goal", "scene", "server", "plot", "position"}


def message() -> dict[str, Any]:
    """One that has something hostile in every field that any panel looks at."""
    point = {"x": INFINITE, "y": None, "z": HOSTILE, "w": INFINITE}
    pose = {"position": point, "orientation": point}
    header = {"frame_id": HOSTILE, "stamp": {"sec": INFINITE, "nanosec": HOSTILE, "secs": None, "nsecs": -1}}
    marker = {
        **{"header": header, "ns": HOSTILE, "id": 1, "type": 9, "action": 0, "pose": pose, "scale": point},
        **{
            "color": {"r": INFINITE, "g": None, "b": 1, "a": 1},
            "points": [point],
            "colors": [],
            "text": HOSTILE,
        },
    }
    approval = {
        **{"id": HOSTILE, "act": "constructor", "name": HOSTILE, "rule": HOSTILE, "client": HOSTILE},
        **{"role": HOSTILE, "content": HOSTILE, "asked": {"sec": INFINITE}, "seconds": INFINITE},
        "remember_seconds": INFINITE,
    }
    lease = {"topic": HOSTILE, "holder": HOSTILE, "role": HOSTILE}
    status = {"name": HOSTILE, "level": INFINITE, "message": HOSTILE, "hardware_id": HOSTILE}
    return {
        **{
            "header": header,
            "data": HOSTILE,
            "msg": HOSTILE,
            "name": HOSTILE,
            "level": INFINITE,
            "file": HOSTILE,
        },
        **{"status": [{**status, "values": [{"key": HOSTILE, "value": HOSTILE}]}], "percentage": INFINITE},
        **{
            "voltage": None,
            "current": HOSTILE,
            "ranges": [INFINITE, None, HOSTILE],
            "angle_increment": INFINITE,
        },
        **{
            "info": {"width": INFINITE, "height": None, "resolution": -1, "origin": pose},
            "pose": {"pose": pose},
        },
        **{
            "twist": {"twist": {"linear": point, "angular": point}},
            "poses": [{"pose": pose, "header": header}],
        },
        **{
            "transforms": [
                {"header": header, "child_frame_id": f"{HOSTILE} child", "transform": {"translation": point}}
            ]
        },
        **{"markers": [marker], "width": INFINITE, "height": 2, "encoding": HOSTILE, "format": HOSTILE},
        **{"fields": [{"name": HOSTILE, "offset": INFINITE, "datatype": 99, "count": -1}], "point_step": 0},
        **{"approvals": [approval], "leases": [lease, {**lease, "requests": [{"client": HOSTILE}]}]},
        **{"stopped": True, "by": HOSTILE, "reason": HOSTILE, "recording": True, "since": {"sec": INFINITE}},
        **{"latitude": 90, "longitude": -180, "altitude": HOSTILE, "position_covariance_type": INFINITE},
        **{"position_covariance": [INFINITE, None, HOSTILE, -1, INFINITE]},
        **{"messages": INFINITE, "bytes": INFINITE, "largest_bytes": None, "dropped": INFINITE},
        **{"problem": HOSTILE, "clients": [{"ip_address": HOSTILE, "connection_time": {"sec": INFINITE}}]},
    }


def answer(service: str, many: list[str]) -> dict[str, Any]:
    """Of rosapi, where there are many names more, and of whatever else is called."""
    answers: dict[str, dict[str, Any]] = {
        "/rosapi/topics": {
            "topics": [*TOPICS, *many],
            "types": [*TOPICS.values(), *["std_msgs/Float64"] * len(many)],
        },
        "/rosapi/services": {"services": [*SERVICES, *many]},
        "/rosapi/action_servers": {"action_servers": [f"/{HOSTILE}", *many]},
        "/rosapi/nodes": {"nodes": [f"/{HOSTILE}", *many]},
        "/rosapi/get_ros_version": {"version": 1, "distro": HOSTILE},
        "/rosapi/node_details": {
            **{
                "publishing": [f"/{HOSTILE}/0"],
                "subscribing": [f"/{HOSTILE}/0"],
                "services": [f"/{HOSTILE}"],
            },
        },
        "/rosapi/get_param_names": {"names": [f"/{HOSTILE}:{HOSTILE}", f"/{HOSTILE}"]},
        "/rosapi/get_param": {"value": json.dumps(HOSTILE)},
    }
    return answers.get(
        service, {"type": HOSTILE, "typedefs": [{"type": HOSTILE}], "rate": INFINITE, "value": HOSTILE}
    )


def as_text(op: dict[str, Any]) -> str:
    return json.dumps(op).replace(f'"{INFINITE}"', "1e999")


async def converse(client: ServerConnection, many: list[str], own: dict[str, dict[str, Any]]) -> None:
    async for received in client:
        asked = json.loads(received)
        if asked["op"] == "call_service":
            values = answer(asked["service"], many)
            reply = {"op": "service_response", "id": asked.get("id"), "service": asked["service"]}
            await client.send(as_text({**reply, "values": values, "result": True}))
        elif asked["op"] == "subscribe":
            sent = own.get(asked["topic"]) or message()
            await client.send(as_text({"op": "publish", "topic": asked["topic"], "msg": sent}))
            await client.send(as_text({"op": "status", "level": "error", "msg": HOSTILE}))


@asynccontextmanager
async def hostile_robot(count: int = 0, own: dict[str, dict[str, Any]] | None = None) -> AsyncIterator[str]:
    """A robot with that many names more, and messages of its own on some topics."""
    many = [f"/many/name_{number:05}" for number in range(count)]
    async with serve(partial(converse, many=many, own=own or {}), "127.0.0.1", 0, max_size=None) as server:
        yield f"ws://127.0.0.1:{server.sockets[0].getsockname()[1]}"


@pytest.mark.parametrize(("count", "kinds"), [(0, KINDS), (10_000, ("topics", "services", "nodes"))])
async def test_no_panel_believes_or_breaks(browser: Browser, count: int, kinds: tuple[str, ...]) -> None:
    async with (
        hostile_robot(count) as robot,
        serve_page("ws://127.0.0.1:0", robot) as listener,
        browser.page(listener.url.replace("ws", "http", 1) + "/web/settings.json", 1200, 800) as page,
    ):
        url = listener.url.replace("ws", "http", 1) + "/"
        # It has no HTTP: neither roles nor metrics, meshes or streams.
        page.forgive(REFUSED, "ERR_FAILED", "CORS", "404", "400", "426", "Failed to load resource", "/stream")
        for kind in kinds:
            config: dict[str, object] = {}
            if kind == "topics":
                config = {"topic": f"/{HOSTILE}/0"}
            elif kind in ("services", "actions"):
                config = {"name": f"/{HOSTILE}"}
            elif kind == "values":
                config = {"fields": [{"topic": f"/{HOSTILE}/0", "path": "data"}]}
            elif kind == "plot":
                config = {"lines": [{"topic": f"/{HOSTILE}/7", "path": "twist.twist.linear.x"}]}
            await page.goto(f"{url}web/settings.json")
            await open_panels(page, url, [(kind, config)], robot=robot)
            await page.wait(f"document.querySelector('.panel-{kind}')?.children.length")
            if kind not in SILENT:
                await page.wait(f"{text(f'.panel-{kind}')}.includes('onerror')")
            assert await page.evaluate("document.querySelectorAll('main img').length") == 0, kind
            assert "broken in" not in await page.evaluate("document.title"), kind
            assert "This panel failed" not in await page.evaluate("document.body.textContent"), kind


def described(name: str, lower: object, upper: object, velocity: object = 1) -> str:
    limit = f'<limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="1"/>'
    return f'<joint name="{escape(name, {chr(34): "&quot;"})}" type="revolute">{limit}</joint>'


BOMB = (
    '<!DOCTYPE robot [<!ENTITY e0 "ha">'
    + "".join(f'<!ENTITY e{n} "{f"&e{n - 1};" * 10}">' for n in range(1, 9))
    + "]>"
)
"""Entities that stand for 200 MB."""


@pytest.mark.parametrize(
    ("description", "sliders"),
    [
        # Of what is no range, no joint is made; a speed is never negative.
        (
            described(HOSTILE, -1, 1, -1e308)
            + described("endless", "-1e999", "1e999")
            + described("turned", 1, -1)
            + described("nothing", "NaN", HOSTILE.replace("<", "&lt;").replace('"', "&quot;")),
            [HOSTILE],
        ),
        ("".join(described(f"j{n}", -1, 1) for n in range(5000)), [f"j{n}" for n in range(100)]),
        # The description is no XML: every joint of the robot may move, by half a turn.
        ("<joint", ["endless", "j0", HOSTILE]),
        (f'{BOMB}<joint name="&e8;"/>', ["endless", "j0", HOSTILE]),
    ],
    ids=["limits", "many", "no XML", "entities"],
)
async def test_a_hostile_description_gives_sliders_with_limits(
    browser: Browser, description: str, sliders: list[str]
) -> None:
    head = BOMB if BOMB in description else ""
    names = list(dict.fromkeys([*sliders, "endless"]))
    own: dict[str, dict[str, Any]] = {
        "/robot_description": {"data": f"{head}<robot name='r'>{description.removeprefix(head)}</robot>"},
        "/joint_states": {"name": names, "position": [0.5] * len(names)},
    }
    async with (
        hostile_robot(own=own) as robot,
        serve_page("ws://127.0.0.1:0", robot) as listener,
        browser.page(listener.url.replace("ws", "http", 1) + "/web/settings.json", 1200, 800) as page,
    ):
        page.forgive(REFUSED, "ERR_FAILED", "CORS", "404", "400", "426", "Failed to load resource", "/stream")
        # What browsers say of a text that is no XML, Chromium with a style that the page's policy holds off.
        page.forgive("inline style", "XML Parsing Error")
        url = listener.url.replace("ws", "http", 1) + "/"
        await open_panels(page, url, [("joints", {})], robot=robot)
        labels = "[...document.querySelectorAll('.jog label')].map((it) => it.textContent)"
        await page.wait(f"{labels}.length === {len(sliders)}")
        assert sorted(await page.evaluate(labels)) == sorted(sliders)
        ranges = await page.evaluate(
            "[...document.querySelectorAll('.jog input')].map((it) => [Number(it.min), Number(it.max)])"
        )
        assert all(-3.15 < least < most < 3.15 for least, most in ranges)
        assert "broken in" not in await page.evaluate("document.title")
