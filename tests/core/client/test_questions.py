"""rosapi, parameters, types and time."""

from __future__ import annotations

import time
from typing import Any

import anyio
import msgspec
import pytest

from rwt.rosapi.type_services import typedefs
from rwt_client import FieldInfo, NodeDetails, RosVersion
from rwt_client.endpoints.remote_types import definition_texts
from rwt_client.rosapi import TypeDef
from rwt_interfaces import JAZZY, NOETIC, Registry
from rwt_participant.api import Listed
from rwt_participant.errors import CallFailed, NotFound, ParameterRejected, UnknownType
from tests.core.client.worlds import World, scripted, world

pytestmark = pytest.mark.anyio

ADD = "example_interfaces/AddTwoInts"


def furnish(it: World) -> None:
    it.node.advertise("/odom", "nav_msgs/Odometry")
    it.node.subscribe("/cmd_vel", lambda _: None, type="geometry_msgs/Twist")
    it.node.advertise_service("/add", ADD, lambda request: {"sum": 0})
    it.node.advertise_action("/fibonacci", "example_interfaces/Fibonacci", _never)


async def _never(goal: Any) -> dict[str, object]:
    return {}


async def test_questions_about_topics() -> None:
    async with world() as it:
        furnish(it)
        api = it.robot.api
        assert Listed("/odom", "nav_msgs/msg/Odometry") in await api.topics()
        assert await api.topics_for_type("geometry_msgs/Twist") == ("/cmd_vel",)
        assert await api.topic_type("/odom") == "nav_msgs/msg/Odometry"
        assert await api.topic_type("/nothing") == ""
        assert await api.publishers("/odom") == ("/test_robot",)
        assert await api.subscribers("/cmd_vel") == ("/test_robot",)


async def test_questions_about_services_and_actions() -> None:
    async with world() as it:
        furnish(it)
        api = it.robot.api
        assert "/add" in await api.services()
        assert await api.services_for_type(ADD) == ("/add",)
        assert await api.service_type("/add") == "example_interfaces/srv/AddTwoInts"
        assert await api.service_node("/add") == "/test_robot"
        assert await api.service_host("/add") != ""
        assert await api.service_providers(ADD) == ("/test_robot",)
        assert await api.action_servers() == ("/fibonacci",)
        assert await api.action_type("/fibonacci") == "example_interfaces/action/Fibonacci"


async def test_questions_about_nodes() -> None:
    async with world() as it:
        furnish(it)
        assert {"/test_robot", "/rosapi"} <= set(await it.robot.api.nodes())
        info = await it.robot.api.node("/test_robot")
        assert isinstance(info, NodeDetails)
        assert ("/odom" in info.publishing, info.subscribing) == (True, ("/cmd_vel",))
        with pytest.raises(CallFailed, match="node /nobody does not exist"):
            await it.robot.api.node("/nobody")


async def test_questions_about_types() -> None:
    async with world() as it:
        api = it.robot.api
        (point,) = await api.message_details("geometry_msgs/Point")
        assert point.name == "geometry_msgs/Point"
        assert point.fields[0] == FieldInfo("x", "double", -1, "0.0")
        (request, *_) = await api.service_request_details(ADD)
        assert [field.name for field in request.fields] == ["a", "b"]
        (response, *_) = await api.service_response_details(ADD)
        assert [field.name for field in response.fields] == ["sum"]
        action = "example_interfaces/Fibonacci"
        for question in (api.action_goal_details, api.action_result_details, api.action_feedback_details):
            assert len((await question(action))[0].fields) == 1
        (status, *_) = await api.message_details("action_msgs/GoalStatus")
        assert ("STATUS_SUCCEEDED", "4") in status.constants
        assert "std_msgs/msg/String" in await api.interfaces()


async def test_time_and_version() -> None:
    async with world() as it:
        assert abs(await it.robot.time_ns() - time.time_ns()) < 10_000_000_000
        assert await it.robot.api.ros_version() == RosVersion(2, "jazzy")
    async with world(distro="noetic") as it:
        assert abs(await it.robot.time_ns() - time.time_ns()) < 10_000_000_000
        with pytest.raises(CallFailed):
            await it.robot.api.ros_version()
        assert it.robot.types.distro is NOETIC


class TestInVirtualTime:
    @pytest.fixture
    def anyio_backend(self, virtual_time: object) -> object:
        return virtual_time

    async def test_a_robot_without_rosapi_is_not_waited_for_long(self) -> None:
        start = anyio.current_time()
        async with scripted(ros_version=None, timeout=30) as (_, robot):
            assert anyio.current_time() - start == pytest.approx(3.0)
            assert robot.types.distro is None


async def test_an_answer_of_another_shape_is_told() -> None:
    async with scripted() as (server, robot):
        server.answers["/rosapi/topics"] = {"topics": 5}
        with pytest.raises(CallFailed, match="rosapi answers topics with something else"):
            await robot.api.topics()


# -- parameters ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("distro", "name"), [("jazzy", "/test_robot:speed"), ("noetic", "/test_robot/speed")]
)
async def test_parameters(distro: str, name: str) -> None:
    async with world(distro=distro) as it:
        it.node.parameters.declare("speed", 0.5)
        params = it.robot.params
        assert await params.get(name) == 0.5
        await params.set(name, 0.75)
        assert (await params.get(name), it.node.parameters.get("speed")) == (0.75, 0.75)
        assert await params.has(name)
        assert not await params.has(f"{name}_limit")
        assert name in await params.names()


async def test_without_rosapi_the_servers_words_are_told() -> None:
    async with scripted() as (server, robot):
        server.answers["/rosapi/get_param"] = "Service /rosapi/get_param does not exist"
        with pytest.raises(CallFailed, match="Service /rosapi/get_param does not exist"):
            await robot.params.get("/a:b")


# -- types ---------------------------------------------------------------------------------------------------


async def test_types_of_the_robots_own_come_from_its_graph() -> None:
    async with world(fetch_types=False) as it:
        it.graph.registry.add_text("string name\nfloat32[] values\nPart[2] parts", "my_robot/Status")
        it.graph.registry.add_text("uint8 id\nbuiltin_interfaces/Time when", "my_robot/Part")
        it.graph.registry.add_text("Part part\n---\nbool ok", "my_robot/Check", "srv")
        it.graph.registry.add_text("Part part\n---\nbool ok\n---\nfloat64 done", "my_robot/Build", "action")
        with pytest.raises(UnknownType, match=r"await types\.fetch"):
            it.robot.types["my_robot/Status"]
        status = await it.robot.types.fetch("my_robot/Status")
        assert status is it.robot.types["my_robot/msg/Status"]
        assert status.__struct_fields__ == ("name", "values", "parts")

        it.node.advertise_service("/check", "my_robot/Check", lambda request: {"ok": request.part.id == 7})
        assert (await it.robot.call("/check", {"part": {"id": 7}})).ok

        async def build(goal: Any) -> dict[str, object]:
            return {"ok": goal.request.part.id == 8}

        it.node.advertise_action("/build", "my_robot/Build", build)
        goal = await it.robot.send_goal("/build", {"part": {"id": 8}})
        assert (await goal.result(timeout=5)).result.ok


async def test_the_graphs_definition_wins_over_the_standard_one() -> None:
    async with scripted() as (server, robot):
        separator = "=" * 80
        text = f"string data\nmy_msgs/Mood mood\n\n{separator}\nMSG: my_msgs/Mood\nuint8 level"
        server.answers["/rosapi/get_ros_version"] = {"version": 2, "distro": "jazzy"}
        server.answers["/rosapi/topics_and_raw_types"] = {
            "topics": ["/a", "/b"],
            "types": ["std_msgs/msg/String", "strange_msgs/msg/Broken"],
            "typedefs_full_text": [text, "this is no definition at all ="],
        }
        await robot.identify(None, True)
        string: Any = robot.types["std_msgs/String"]()
        assert string.mood.level == 0
        assert robot.types.full_text("std_msgs/String").strip() == text


async def test_a_type_that_nobody_knows() -> None:
    async with world() as it:
        with pytest.raises(
            UnknownType, match=r'no message "my_msgs/X" is known \(the robot does not know it either\)'
        ):
            await it.robot.types.fetch("my_msgs/X")
        with pytest.raises(UnknownType):
            await it.robot.types.fetch("not a name")


async def test_a_definition_may_be_added() -> None:
    async with scripted() as (server, robot):
        robot.types.add_text("uint8 level", "my_msgs/Mood")
        async with robot.topic("/mood", "my_msgs/Mood") as moods:
            await server.hears("subscribe")
            server.publish("/mood", {"level": 3})
            assert (await moods.get(timeout=5)).level == 3
        with pytest.raises(UnknownType, match="my_msgs/Bad: "):
            robot.types.add_text("uint8 1x", "my_msgs/Bad")


async def test_without_rosapi_both_spellings_of_time_are_read() -> None:
    async with scripted() as (server, robot):
        server.answers.update({"/rosapi/get_ros_version": "no", "/rosapi/get_time": "no"})
        await robot.identify(None, True)
        assert robot.types.distro is None
        async with robot.topic("/header", "std_msgs/Header") as headers:
            await server.hears("subscribe")
            server.publish("/header", {"stamp": {"secs": 5, "nsecs": 6}, "frame_id": "a", "seq": 3})
            stamp = (await headers.get(timeout=5)).stamp
        assert (stamp.sec, stamp.nanosec) == (5, 6)


@pytest.mark.parametrize("name", ["nav_msgs/Odometry", "sensor_msgs/JointState", "visualization_msgs/Marker"])
def test_typedefs_tell_the_same_fields_as_the_definition(name: str) -> None:
    registry, copy = Registry(JAZZY), Registry(JAZZY)
    described = msgspec.convert(typedefs(registry.message(name), registry), list[TypeDef])
    for each, text in reversed(definition_texts(one.info() for one in described).items()):
        copy.add_text(text, each)
    wanted, found = registry.definition(name), copy.definition(name)
    assert [(field.name, str(field.type)) for field in found.fields] == [
        (field.name, str(field.type)) for field in wanted.fields
    ]


async def test_a_parameter_that_is_misspelled_is_told_with_the_nearest() -> None:
    async with world() as it:
        it.node.parameters.declare("max_speed", 0.5)
        params = it.robot.params
        meant = r"; did you mean /test_robot:max_speed\?$"
        for name in ("/test_robot:max_sped", "/test_robt:max_speed"):
            with pytest.raises(NotFound, match=meant):
                await params.get(name)
            with pytest.raises(ParameterRejected, match=meant):
                await params.set(name, 1.0)
            with pytest.raises(NotFound, match=meant):
                await params.delete(name)
        assert await params.get("/test_robot:max_sped", 7) == 7
