"""Each tool, on both ways that lead to a robot: the gateway, and a connection to a robot elsewhere."""

from __future__ import annotations

import json
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

import anyio
import pytest
from jsonschema import Draft202012Validator

from rwt.extensions.mcp.agent import RESULT_BYTES
from tests.extensions.mcp.agents import (
    agent_at,
    agent_of_connection,
    done,
    picture_of,
    refused,
    served,
    text_of,
    url_of,
    value,
)
from tests.extensions.mcp.robots import SmallRobot, small_robot

if TYPE_CHECKING:
    from mcp.client import Client

pytestmark = [pytest.mark.anyio, pytest.mark.timeout(120)]

Pair = tuple["Client", SmallRobot]
WAYS = ("gateway", "connection")


@asynccontextmanager
async def _agent(way: str) -> AsyncIterator[Pair]:
    async with small_robot() as (server, robot):
        at = agent_at(url_of(server)) if way == "gateway" else agent_of_connection(server.urls[0])
        async with at as client:
            yield client, robot


@pytest.fixture(params=WAYS)
async def both(request: pytest.FixtureRequest) -> AsyncIterator[Pair]:
    """An agent and its robot, on each way."""
    async with _agent(request.param) as both:
        yield both


async def test_an_agent_finds_out_what_is_there_and_reads_it(both: Pair) -> None:
    agent, _ = both
    listed = await done(agent, "list_robot")
    for line in ("/battery [sensor_msgs/msg/BatteryState]", "/add [example_interfaces/srv/AddTwoInts]"):
        assert line in listed
    assert "/count [example_interfaces/action/Fibonacci]" in listed
    assert "/rosapi/" not in listed and "/get_parameters" not in listed
    assert "/rosapi/topics" in await done(agent, "list_robot", plumbing=True, filter="/rosapi/*")
    only = await done(agent, "list_robot", kinds=["topics"], filter="*cam*")
    assert only.splitlines()[0] == "topics (1):"
    parameters = await done(agent, "list_robot", kinds=["parameters"], filter="*small*")
    assert "/small_robot:speed" in parameters

    described = await done(agent, "describe_type", type="example_interfaces/AddTwoInts")
    assert "a: int64" in described and "sum: int64" in described and '"a":0' in described
    battery = await value(agent, "read_topic", topic="/battery", fields=["percentage", "header.frame_id"])
    assert battery == {"percentage": 0.75, "header.frame_id": ""}
    assert (await value(agent, "read_topic", topic="/status")) == {"data": "ready"}
    assert (await value(agent, "get_parameter", name="/small_robot:speed")) == 0.5


async def test_what_can_be_seen_is_seen(both: Pair) -> None:
    agent, _ = both
    camera = await agent.call_tool("read_topic", {"topic": "/camera"})
    picture = picture_of(camera).convert("RGB")
    assert picture.size == (40, 30)
    above, below = picture.getpixel((20, 4)), picture.getpixel((20, 26))
    assert isinstance(above, tuple) and isinstance(below, tuple)
    assert above[0] > 200 > 60 > above[2] and below[2] > 200 > 60 > below[0]
    scan = await agent.call_tool("read_topic", {"topic": "/scan"})
    assert "ahead: 2.00 m" in text_of(scan) and "behind: nothing in reach" in text_of(scan)
    drawn = picture_of(scan).convert("L")
    assert drawn.getpixel((320, 16)) == 0 and drawn.getpixel((320, 600)) == 255  # 2 m of 2.1 m, ahead is up.
    chart = await agent.call_tool("read_topic", {"topic": "/map"})
    assert "50% occupied" in text_of(chart) and "50% unknown" in text_of(chart)
    assert "x from -5.00 to 5.00 m" in text_of(chart)
    grey = picture_of(chart).convert("L")
    assert (grey.size, grey.getpixel((10, 8)), grey.getpixel((10, 1))) == ((20, 10), 0, 205)


async def test_numbers_are_watched_and_conditions_waited_for(both: Pair) -> None:
    agent, _ = both
    seen = await value(agent, "watch_numbers", topic="/number", seconds=0.5)
    data = seen["fields"]["data"]
    assert seen["messages"] > 2 and data["last"] - data["first"] == seen["messages"] - 1
    assert data["min"] == data["first"] and data["max"] == data["last"]
    end = data["last"] + 5
    waited = await done(agent, "wait_for", topic="/number", field="data", comparison=">=", value=end)
    assert re.search(r"is true after \d", waited)
    late = await refused(
        agent, "wait_for", topic="/number", field="data", comparison="<", value=0, timeout=0.2
    )
    assert "did not become true within 0.2 s; last seen: " in late
    assert "cannot be compared" in await refused(
        agent, "wait_for", topic="/number", field="data", comparison="contains", value="x"
    )


async def test_acts_reach_the_robot_and_velocities_end_with_a_stop(both: Pair) -> None:
    agent, robot = both
    told = await done(agent, "publish", topic="/cmd_vel", message={"linear": {"x": 0.5}}, seconds=0.4)
    assert told.endswith(", then zeros")
    with anyio.fail_after(20):
        await robot.stopped.wait()
    assert robot.heard[-1] == 0.0 and set(robot.heard[:-1]) == {0.5} and len(robot.heard) > 2
    await done(agent, "publish", topic="/new", message={"data": "x"}, type="std_msgs/String")
    assert "pass its `type`" in await refused(agent, "publish", topic="/newer", message={"data": "x"})
    assert (await value(agent, "call_service", service="/add", request={"a": 2, "b": 3})) == {"sum": 5}
    assert "not calibrated" in await refused(agent, "call_service", service="/fail")
    assert "did you mean /add?" in await refused(agent, "call_service", service="/ad")
    await done(agent, "set_parameter", name="/small_robot:speed", value=0.25)
    assert robot.node.parameters.get("speed") == 0.25
    assert await refused(agent, "set_parameter", name="/small_robot:nought", value=1)


async def test_goals_are_followed_left_running_and_cancelled(both: Pair) -> None:
    agent, robot = both
    ended = await done(agent, "send_goal", action="/count", goal={"order": 4})
    assert ended.startswith("the goal succeeded") and '"sequence":[0,1,2,3]' in ended
    left = await done(agent, "send_goal", action="/count", goal={"order": 0}, timeout=0.3)
    found = re.search(r"goal_id: (\S+)\.", left)
    assert found and "last feedback:" in left
    assert "and continues" in await done(agent, "check_goal", goal_id=found[1])
    assert "the goal canceled" in await done(agent, "cancel_goal", goal_id=found[1])
    with anyio.fail_after(20):
        await robot.canceled.wait()
    assert "yours are: none" in await refused(agent, "check_goal", goal_id=found[1])
    assert "did you mean /count?" in await refused(agent, "send_goal", action="/cont")


async def test_progress_is_reported_and_a_cancelled_call_cancels_its_goal(both: Pair) -> None:
    agent, robot = both
    reported = anyio.Event()
    messages: list[str | None] = []

    async def on_progress(progress: float, total: float | None, message: str | None) -> None:
        messages.append(message)
        reported.set()

    async with anyio.create_task_group() as tasks:

        async def send() -> None:
            await agent.call_tool(
                "send_goal", {"action": "/count", "goal": {"order": 0}}, progress_callback=on_progress
            )

        tasks.start_soon(send)
        with anyio.fail_after(20):
            await reported.wait()
        tasks.cancel_scope.cancel()
    with anyio.fail_after(20):
        await robot.canceled.wait()
    assert messages[0] is not None and '"sequence"' in messages[0]


async def test_errors_say_what_is_wrong_and_what_to_do(both: Pair) -> None:
    agent, _ = both
    assert "did you mean /battery?" in await refused(agent, "read_topic", topic="/batery")
    assert "no message on /cmd_vel within 0.1 s" in await refused(
        agent, "read_topic", topic="/cmd_vel", timeout=0.1
    )
    assert "there are header, voltage" in await refused(
        agent, "read_topic", topic="/battery", fields=["charg3"]
    )
    wrong = await refused(agent, "read_topic", topik="/battery")
    assert "`topic`: Field required" in wrong and "Arguments: topic, timeout, fields" in wrong
    assert "at most 60 s" in await refused(agent, "watch_numbers", topic="/number", seconds=600)
    assert "nought_msgs/Nought" in await refused(agent, "describe_type", type="nought_msgs/Nought")


async def test_resources_and_prompts_lead_to_the_same(both: Pair) -> None:
    agent, _ = both
    (overview,) = (await agent.list_resources()).resources
    assert str(overview.uri) == "robot://overview"
    (read,) = (await agent.read_resource("robot://overview")).contents
    assert "/battery" in getattr(read, "text", "")
    templates = (await agent.list_resource_templates()).resource_templates
    assert {each.uri_template for each in templates} == {"robot://topics/{+topic}", "robot://types/{+type}"}
    (read,) = (await agent.read_resource("robot://topics/battery")).contents
    assert '"percentage":0.75' in getattr(read, "text", "")
    _, picture = (await agent.read_resource("robot://topics/camera")).contents
    assert picture.mime_type == "image/jpeg" and hasattr(picture, "blob")
    (read,) = (await agent.read_resource("robot://types/std_msgs/String")).contents
    assert "data: string" in getattr(read, "text", "")
    prompts = {each.name: each for each in (await agent.list_prompts()).prompts}
    assert set(prompts) == {"get_to_know", "check_health", "drive_to"}
    filled = await agent.get_prompt("drive_to", {"place": "the door"})
    assert "the door" in getattr(filled.messages[0].content, "text", "")


async def test_frames_are_listed_and_looked_up() -> None:
    async with served(gateways=["mcp"], mcp={"default_role": "admin"}) as server:
        node = server.node("frames")
        node.publish(
            "/tf_static",
            {
                "transforms": [
                    {
                        "header": {"frame_id": "map"},
                        "child_frame_id": "base_link",
                        "transform": {
                            "translation": {"x": 1.0},
                            "rotation": {"z": 0.70710678, "w": 0.70710678},
                        },
                    }
                ]
            },
            "tf2_msgs/TFMessage",
            latch=True,
        )
        async with agent_at(url_of(server)) as agent:
            assert "└─ base_link (static)" in await done(agent, "list_frames", seconds=0.1)
            found = await value(
                agent, "look_up_transform", target="map", source="base_link", point=[1.0, 0.0, 0.0]
            )
            assert found["degrees"]["yaw"] == 90.0
            assert [round(each, 6) for each in found["point"]] == [1.0, 1.0, 0.0]
            assert await refused(agent, "look_up_transform", target="map", source="nought", timeout=0.1)
        node.close()


async def test_what_tools_say_of_themselves() -> None:
    async with _agent("gateway") as (agent, _):
        tools = {tool.name: tool for tool in (await agent.list_tools()).tools}
    hints = {name: tool.annotations for name, tool in tools.items() if tool.annotations}
    looks = {name for name, hint in hints.items() if hint.read_only_hint}
    acts = {"publish", "call_service", "send_goal", "cancel_goal", "set_parameter"}
    assert hints.keys() == tools.keys() and tools.keys() - looks == acts
    assert {name for name in acts if hints[name].destructive_hint} == acts - {"cancel_goal"}
    assert {name for name in acts if hints[name].idempotent_hint} == {"cancel_goal", "set_parameter"}
    assert {name for name in tools if hints[name].open_world_hint} == acts
    for tool in tools.values():
        assert tool.output_schema is not None and tool.output_schema["type"] == "object"
        Draft202012Validator.check_schema(tool.output_schema)
        # Some models do not support tuples of JSON Schema.
        assert "prefixItems" not in json.dumps((tool.input_schema, tool.output_schema))


async def test_results_have_the_structure_that_the_tools_state(both: Pair) -> None:
    agent, _ = both
    schemas = {tool.name: tool.output_schema for tool in (await agent.list_tools()).tools}
    found: dict[str, Any] = {}

    async def call(tool: str, **arguments: object) -> None:
        result = await agent.call_tool(tool, arguments)
        assert not result.is_error, text_of(result)
        assert schemas[tool] is not None
        Draft202012Validator(schemas[tool]).validate(result.structured_content)
        found[tool] = result.structured_content

    await call("list_robot", kinds=["topics", "services", "actions", "parameters"])
    battery = {"name": "/battery", "type": "sensor_msgs/msg/BatteryState"}
    listed = {kind: [row["name"] for row in rows["rows"]] for kind, rows in found["list_robot"].items()}
    assert any(row.items() >= battery.items() for row in found["list_robot"]["topics"]["rows"])
    assert {"/add", "/fail"} <= set(listed["services"]) and "/count" in listed["actions"]
    assert "/small_robot:speed" in listed["parameters"]
    await call("describe_type", type="example_interfaces/srv/AddTwoInts")
    described = found["describe_type"]
    assert described["defaults"] == {"request": {"a": 0, "b": 0}, "response": {"sum": 0}}
    assert "a: int64" in described["fields"]["request"]
    for topic, member, expected in (
        ("/battery", "percentage", 0.75),
        ("/camera", "data", "3600 bytes"),
        ("/scan", "range_min", 0.1),
    ):
        await call("read_topic", topic=topic)
        assert found["read_topic"]["message"][member] == pytest.approx(expected)
    await call("read_topic", topic="/battery", fields=["percentage"])
    assert found["read_topic"]["fields"] == {"percentage": 0.75}
    await call("watch_numbers", topic="/number", seconds=0.3)
    assert found["watch_numbers"]["fields"]["data"]["last"] > 0
    await call("wait_for", topic="/number", field="data", comparison=">", value=1)
    assert found["wait_for"]["value"] > 1
    await call("get_parameter", name="/small_robot:speed")
    assert found["get_parameter"] == {"name": "/small_robot:speed", "value": 0.5}
    await call("set_parameter", name="/small_robot:speed", value=0.25)
    await call("list_frames", seconds=0.1)
    await call("publish", topic="/cmd_vel", message={}, seconds=0.2)
    assert found["publish"]["topic"] == "/cmd_vel" and found["publish"]["stop"] == {}
    await call("call_service", service="/add", request={"a": 2, "b": 3})
    assert found["call_service"]["message"] == {"sum": 5}
    await call("send_goal", action="/count", goal={"order": 0}, timeout=0.3)
    goal = found["send_goal"]["goal_id"]
    assert found["send_goal"]["state"] == "executing" and found["send_goal"]["feedback"]["sequence"]
    await call("check_goal", goal_id=goal)
    await call("cancel_goal", goal_id=goal)
    assert found["cancel_goal"]["state"] == "canceled"


async def test_structured_content_is_bounded_as_texts_are() -> None:
    async with small_robot(gateways=["mcp"], mcp={"default_role": "admin"}) as (server, robot):
        for number in range(480):
            robot.node.advertise(f"/a_topic_of_the_robot_{number}", "std_msgs/String")
        rows = [{"header": {"frame_id": f"a rather long name {number}" * 5}} for number in range(96)]
        robot.node.publish("/path", {"poses": rows}, "nav_msgs/Path", latch=True)
        async with agent_at(url_of(server)) as agent:
            for tool, arguments in (
                ("list_robot", {}),
                ("describe_type", {"type": "nav_msgs/Odometry"}),
                ("read_topic", {"topic": "/path"}),
                ("read_topic", {"topic": "/path", "fields": ["poses", "header"]}),
            ):
                content = (await agent.call_tool(tool, arguments)).structured_content
                assert len(json.dumps(content)) < RESULT_BYTES + 512, tool
            listed = (await agent.call_tool("list_robot", {})).structured_content
            assert listed is not None and listed["topics"]["left_out"] > 0


@pytest.mark.parametrize("way", WAYS)
async def test_results_state_what_the_gate_clamped(way: str) -> None:
    fields = {"linear.x": {"max": 0.25, "beyond": "clamp"}}
    gate = {"rules": {"slow": {"topics": ["/cmd_vel"], "fields": fields}}}
    async with small_robot(gateways=["mcp"], mcp={"default_role": "admin"}, gate=gate) as (server, robot):
        at = agent_at(url_of(server)) if way == "gateway" else agent_of_connection(server.urls[0])
        async with at as agent:
            drive = {"topic": "/cmd_vel", "message": {"linear": {"x": 0.5}}}
            result = await agent.call_tool("publish", drive)
        assert robot.heard == [0.25] and result.structured_content is not None
        assert "0.25 in place of 0.5" in result.structured_content["gate"][0]
        assert "the gate: " in text_of(result)
