"""Parameters: their values, setting and deleting them, and hearing of changes; each as the role allows."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from typing import Any

import anyio.lowlevel
import pytest

from rwt import Settings
from rwt.access.access import Access
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.rosapi import DISCLOSURES, Rosapi
from rwt_graph import MemoryGraph, Node
from rwt_graph.clock import SimulatedClock
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from tests.conftest import START_NS
from tests.extensions.foxglove.conftest import guest
from tests.extensions.foxglove.viewer import Viewer

pytestmark = pytest.mark.anyio

VALUES: dict[str, Any] = {
    "bool": True,
    "int": 7,
    "float": 1.0,
    "text": "hello",
    "ints": [1, 2],
    "floats": [1.0, 2.5],
    "texts": ["a", "b"],
}


@pytest.fixture
async def robot() -> AsyncIterator[Node]:
    """A robot with a parameter of each type."""
    graph = MemoryGraph(clock=SimulatedClock(START_NS))
    async with graph:
        with Rosapi(graph):
            node = Node(graph, "robot")
            for name, value in VALUES.items():
                node.parameters.declare(name, value)
            node.parameters.declare("bytes", b"\1\2")
            node.parameters.declare("any", None)  # Of any type, so that it may be deleted.
            node.parameters.set("any", 1)
            yield node


Connect = Callable[..., Viewer]


@pytest.fixture
def connect(robot: Node) -> Connect:
    def connect(**settings: Any) -> Viewer:
        given = Settings.model_validate(settings)
        gateway = FoxgloveGateway(robot.graph, Access(robot.graph, given, DISCLOSURES))
        viewer = Viewer(gateway)
        return viewer

    return connect


async def values(viewer: Viewer) -> dict[str, Any]:
    """The next values that come: the message, its parameters by name."""
    clock = viewer.client.graph.clock
    assert isinstance(clock, SimulatedClock)
    for _ in range(5000):
        while (each := viewer.heard_one()) is not None:
            if isinstance(each, dict) and each["op"] in ("parameterValues", "status"):
                return {**each, "parameters": {it.pop("name"): it for it in each.get("parameters", ())}}
        await anyio.lowlevel.checkpoint()
        clock.advance(0.0)
    raise AssertionError("no values came")


async def test_all_values_come_with_their_types(connect: Connect) -> None:
    viewer = connect()
    assert "parameters" in str(Viewer(viewer.gateway).welcome[0])
    viewer.say("getParameters", parameterNames=[], id="all")
    said = await values(viewer)
    assert said["id"] == "all"
    of_robot = {name: it for name, it in said["parameters"].items() if name.startswith("/robot.")}
    assert of_robot == {
        "/robot.bool": {"value": True},
        "/robot.int": {"value": 7},
        "/robot.float": {"value": 1.0, "type": "float64"},
        "/robot.text": {"value": "hello"},
        "/robot.ints": {"value": [1, 2]},
        "/robot.floats": {"value": [1.0, 2.5], "type": "float64_array"},
        "/robot.texts": {"value": ["a", "b"]},
        "/robot.bytes": {"value": [1, 2]},
        "/robot.any": {"value": 1},
        "/robot.use_sim_time": of_robot["/robot.use_sim_time"],
    }


async def test_some_values_come_in_the_order_of_their_names(connect: Connect) -> None:
    viewer = connect()
    viewer.say("getParameters", parameterNames=["/robot.text", "/robot.none", "/robot:int", "/none.x"])
    said = await values(viewer)
    assert "id" not in said
    assert list(said["parameters"].items()) == [
        ("/robot.text", {"value": "hello"}),
        ("/robot.int", {"value": 7}),
    ]


async def test_setting_answers_with_what_holds_then(connect: Connect, robot: Node) -> None:
    viewer = connect()
    parameters = [
        {"name": "/robot.int", "value": 8},
        {"name": "/robot.float", "value": 2, "type": "float64"},
        {"name": "/robot.floats", "value": [1, 2], "type": "float64_array"},
        {"name": "/robot.bytes", "value": "AwQF", "type": "byte_array"},
        {"name": "/global", "value": {"a": 1}},
    ]
    viewer.say("setParameters", parameters=parameters, id="set")
    said = await values(viewer)
    assert (said["op"], said["id"]) == ("parameterValues", "set")
    assert [robot.parameters.get(name) for name in ("int", "float", "floats", "bytes")] == [
        8, 2.0, [1.0, 2.0], b"\3\4\5",
    ]  # fmt: skip
    assert said["parameters"]["/global"] == {"value": {"a": 1}}
    viewer.say("setParameters", parameters=[{"name": "/robot.any"}, {"name": "/global"}], id="deleted")
    assert (await values(viewer))["parameters"] == {}
    assert not robot.parameters.has("any") and not robot.graph.parameters.has("/global")


async def test_what_a_node_refuses_is_told_and_the_rest_is_set(connect: Connect, robot: Node) -> None:
    viewer = connect()
    parameters = [{"name": "/robot.int", "value": "no"}, {"name": "/robot.text", "value": "new"}]
    viewer.say("setParameters", parameters=parameters, id="x")
    said = await values(viewer)
    assert "/robot.int: Wrong parameter type, expected integer, got string" in said["message"]
    assert (await values(viewer))["parameters"] == {
        "/robot.int": {"value": 7},
        "/robot.text": {"value": "new"},
    }


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("float64", "x"),
        ("float64", True),
        ("float64_array", [1, "x"]),
        ("byte_array", "!"),
        ("byte_array", 3),
    ],
)
async def test_a_value_that_is_not_of_its_type_sets_nothing(
    connect: Connect, robot: Node, kind: str, value: object
) -> None:
    viewer = connect()
    first = {"name": "/robot.int", "value": 8}
    viewer.say("setParameters", parameters=[first, {"name": "/robot.x", "value": value, "type": kind}])
    assert viewer.statuses() == [f"parameter /robot.x: its value is no {kind}"]
    assert robot.parameters.get("int") == 7


async def test_changes_come_to_those_who_watch(connect: Connect, robot: Node) -> None:
    viewer = connect()
    viewer.say("subscribeParameterUpdates", parameterNames=["/robot.float", "/robot.any", "/tree"])
    robot.parameters.set("float", 3.0)
    assert (await values(viewer))["parameters"] == {"/robot.float": {"value": 3.0, "type": "float64"}}
    robot.parameters.delete("any")
    assert (await values(viewer))["parameters"] == {"/robot.any": {}}
    robot.parameters.set("int", 9)  # Not watched.
    robot.graph.parameters.set("/tree", 5)
    assert (await values(viewer))["parameters"] == {"/tree": {"value": 5}}
    viewer.say("unsubscribeParameterUpdates", parameterNames=["/robot.float", "/tree"])
    robot.parameters.set("float", 4.0)
    robot.graph.parameters.set("/tree", 6)
    viewer.say("subscribeParameterUpdates", parameterNames=[])
    robot.parameters.set("int", 10)
    assert (await values(viewer))["parameters"] == {"/robot.int": {"value": 10}}
    viewer.say("unsubscribeParameterUpdates", parameterNames=[])
    before = robot.graph.topic("/parameter_events")
    assert before is not None and before.subscribers == ()


async def test_a_role_reads_hears_and_sets_what_it_may(connect: Connect, robot: Node) -> None:
    robot.parameters.declare("secret", "hush")
    open_only = [f"/robot:{name}" for name in VALUES]
    viewer = connect(**guest(subscribe=["*"], get_param=open_only, set_param=["/robot:int"]))
    for names in ([], ["/robot.secret", "/robot.int"]):
        viewer.say("getParameters", parameterNames=names, id="x")
        said = await values(viewer)
        assert "hush" not in str(said) and "secret" not in str(said)
        assert said["parameters"]["/robot.int"] == {"value": 7}
    viewer.say("subscribeParameterUpdates", parameterNames=["/robot.secret", "/robot.int"])
    viewer.say("setParameters", parameters=[{"name": "/robot.secret", "value": "x"}])
    assert "roles.guest.set_param" in (await values(viewer))["message"]
    assert robot.parameters.get("secret") == "hush"
    robot.parameters.set("secret", "again")
    robot.parameters.set("int", 11)
    assert (await values(viewer))["parameters"] == {"/robot.int": {"value": 11}}
    viewer.say("subscribeParameterUpdates", parameterNames=[])
    robot.parameters.set("secret", "once more")
    robot.parameters.set("int", 12)
    assert (await values(viewer))["parameters"] == {"/robot.int": {"value": 12}}


async def test_what_a_client_asks_of_parameters_is_bounded(connect: Connect) -> None:
    viewer = connect()
    names = [f"/robot.p{number}" for number in range(1001)]
    viewer.say("getParameters", parameterNames=names)
    viewer.say("subscribeParameterUpdates", parameterNames=names[:1000])
    viewer.say("subscribeParameterUpdates", parameterNames=names[1000:])
    first, second = viewer.statuses()
    assert "1000 are the most: ask" in first and "1000 are the most: watch" in second
    for _ in range(30):
        viewer.say("getParameters", parameterNames=["/robot.int"])
    assert any("await their answers" in each for each in viewer.statuses())
    assert viewer.client.graph.calls_in_flight <= 8
    viewer.leave()
    assert viewer.client.graph.calls_in_flight == 0


async def test_parameters_that_clients_set_are_bounded(connect: Connect) -> None:
    viewer = connect(limits={"parameter_bytes": 2000})
    parameters = [{"name": f"/p{number}", "value": "x" * 500} for number in range(10)]
    viewer.say("setParameters", parameters=parameters)
    assert "limits.parameter_bytes" in (await values(viewer))["message"]


async def test_of_ros_1_all_parameters_are_in_one_tree() -> None:
    graph = MemoryGraph(Registry(DISTROS["noetic"]), SimulatedClock(START_NS))
    async with graph:
        with Rosapi(graph):
            graph.parameters.set("/robot/speed", 1.0)
            settings = Settings(distro="noetic")
            gateway = FoxgloveGateway(graph, Access(graph, settings, DISCLOSURES))
            viewer = Viewer(gateway)
            viewer.say("getParameters", parameterNames=["/robot/speed"])
            assert (await values(viewer))["parameters"] == {"/robot/speed": {"value": 1.0, "type": "float64"}}
            viewer.say("subscribeParameterUpdates", parameterNames=["/robot/speed"])
            graph.parameters.set("/robot/speed", 2.0)
            assert (await values(viewer))["parameters"] == {"/robot/speed": {"value": 2.0, "type": "float64"}}


async def test_without_rosapi_there_are_no_parameters(viewer: Viewer) -> None:
    assert "parameters" not in viewer.welcome[0]["capabilities"]
    viewer.say("getParameters", parameterNames=[])
    assert "/rosapi/get_param_names" in (await values(viewer))["message"]
