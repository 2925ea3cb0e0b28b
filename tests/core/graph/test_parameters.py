from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_graph import GraphError, MemoryGraph, Node
from rwt_graph.parameters.values import ParameterType, coerce, decode, encode, type_of
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.errors import CallTimeout, NotFound, ParameterRejected
from rwt_participant.messages import Message, ParameterValue

if TYPE_CHECKING:
    from tests.core.graph.conftest import Advance

INT64 = st.integers(-(2**63), 2**63 - 1)
VALUES: st.SearchStrategy[ParameterValue] = st.one_of(
    st.booleans(),
    INT64,
    st.floats(allow_nan=False),
    st.text(),
    st.binary(),
    st.lists(st.booleans()),
    st.lists(INT64),
    st.lists(st.floats(allow_nan=False)),
    st.lists(st.text()),
)
VALUE_TYPE = Registry().message("rcl_interfaces/ParameterValue")


@given(VALUES)
def test_every_value_survives_its_message(value: ParameterValue) -> None:
    message = Payload.from_value(VALUE_TYPE, encode(value)).value()
    again = decode(message)
    assert again == value
    assert type(again) is type(value)


@given(VALUES)
def test_a_value_fits_its_own_type(value: ParameterValue) -> None:
    assert coerce(value, type_of(value)) == value


@pytest.mark.parametrize(
    ("value", "wanted", "expected"),
    [
        (1, ParameterType.DOUBLE, 1.0),
        ([1, 2], ParameterType.DOUBLE_ARRAY, [1.0, 2.0]),
        ([1, 2.5], ParameterType.DOUBLE_ARRAY, [1, 2.5]),
        ((1, 2), ParameterType.INTEGER_ARRAY, [1, 2]),
        ([], ParameterType.INTEGER_ARRAY, []),
        ([], ParameterType.BYTE_ARRAY, b""),
        ([0, 255], ParameterType.BYTE_ARRAY, b"\x00\xff"),
    ],
)
def test_values_that_may_stand_for_another_type(
    value: ParameterValue, wanted: ParameterType, expected: ParameterValue
) -> None:
    made = coerce(value, wanted)
    assert made == expected
    assert type(made) is type(expected)


@pytest.mark.parametrize(
    ("value", "wanted", "text"),
    [
        ("x", ParameterType.DOUBLE, "Wrong parameter type, expected double, got string"),
        (True, ParameterType.INTEGER, "Wrong parameter type, expected integer, got bool"),
        (1.0, ParameterType.INTEGER, "Wrong parameter type, expected integer, got double"),
        ([256], ParameterType.BYTE_ARRAY, "Wrong parameter type, expected byte array, got integer array"),
        ([], ParameterType.INTEGER, "Wrong parameter type, expected integer, got string array"),
    ],
)
def test_values_of_the_wrong_type(value: ParameterValue, wanted: ParameterType, text: str) -> None:
    with pytest.raises(ParameterRejected) as caught:
        coerce(value, wanted)
    assert str(caught.value) == text


@pytest.mark.parametrize("value", [{"a": 1}, [1, "x"], [[1]], [True, 1], object()])
def test_values_that_ros_2_does_not_have(value: ParameterValue) -> None:
    with pytest.raises(ParameterRejected, match="a parameter must be a bool"):
        type_of(value)


@pytest.mark.parametrize("value", [2**63, [-(2**63) - 1]])
def test_integers_that_are_too_long(value: ParameterValue) -> None:
    with pytest.raises(ParameterRejected, match="64 bits"):
        encode(value)


def test_a_message_of_an_unknown_type_is_refused() -> None:
    message = Payload.from_value(VALUE_TYPE, {"type": 77}).value()
    with pytest.raises(ParameterRejected, match="77 is not a parameter type"):
        decode(message)


def test_declaring_and_setting(graph: MemoryGraph) -> None:
    node = Node(graph, "demo")
    heard: list[ParameterValue] = []

    def on_change(value: ParameterValue) -> None:
        if isinstance(value, float) and value > 10:
            raise ParameterRejected("too fast")
        heard.append(value)

    assert node.parameters.declare("max_speed", 1.0, on_change=on_change) == 1.0
    node.parameters.declare("frame", "odom", read_only=True)
    assert node.parameters.names() == ("frame", "max_speed", "use_sim_time")
    assert node.parameters.get("use_sim_time") is True
    node.parameters.set("max_speed", 2)
    assert node.parameters.get("max_speed") == 2.0
    assert heard == [2.0]
    for name, value, text in (
        ("max_speed", 11.0, "too fast"),
        ("max_speed", "fast", "expected double"),
        ("frame", "map", "parameter frame is read-only"),
        ("nope", 1, "parameter nope cannot be set because it was not declared"),
    ):
        with pytest.raises(ParameterRejected, match=text):
            node.parameters.set(name, value)
    assert node.parameters.get("max_speed") == 2.0
    with pytest.raises(NotFound, match="node /demo has no parameter nope"):
        node.parameters.get("nope")
    with pytest.raises(GraphError, match="declared the parameter frame already"):
        node.parameters.declare("frame", "x")
    with pytest.raises(ParameterRejected):
        node.parameters.declare("tree", {"a": 1})


def test_an_on_change_that_breaks_refuses_and_is_logged(
    graph: MemoryGraph, caplog: pytest.LogCaptureFixture
) -> None:
    def on_change(_value: ParameterValue) -> None:
        raise ZeroDivisionError("oops")

    node = Node(graph, "demo")
    node.parameters.declare("x", 1, on_change=on_change)
    with pytest.raises(ParameterRejected, match="oops"):
        node.parameters.set("x", 2)
    assert node.parameters.get("x") == 1
    assert "ZeroDivisionError" in caplog.text


@pytest.mark.anyio
async def test_parameters_of_any_node(graph: MemoryGraph) -> None:
    async with graph:
        demo, other = Node(graph, "demo", "/robot"), Node(graph, "other")
        demo.parameters.declare("max_speed", 1.0)
        demo.parameters.declare("octets", b"\x01\x02")
        demo.parameters.declare("anything", None)
        name = "/robot/demo:max_speed"
        assert await other.params.get(name) == 1.0
        await other.params.set(name, 3)
        assert demo.parameters.get("max_speed") == 3.0
        assert await other.params.get("/robot/demo:octets") == b"\x01\x02"
        with pytest.raises(ParameterRejected, match="expected double, got string"):
            await other.params.set(name, "fast")
        with pytest.raises(ParameterRejected, match="was not declared"):
            await other.params.set("/robot/demo:nope", 1)
        with pytest.raises(ParameterRejected, match="because it is of a fixed type"):
            await other.params.delete(name)
        assert not await other.params.has("/robot/demo:anything")
        await other.params.set("/robot/demo:anything", [1, 2])
        assert await other.params.has("/robot/demo:anything")
        await other.params.delete("/robot/demo:anything")
        with pytest.raises(NotFound, match="parameter anything of node /robot/demo is not set"):
            await other.params.delete("/robot/demo:anything")
        with pytest.raises(NotFound, match="node /nobody is not there"):
            await other.params.get("/nobody:x")
        assert not await other.params.has("/nobody:x")
        assert await other.params.names() == (
            "/other:use_sim_time",
            "/robot/demo:max_speed",
            "/robot/demo:octets",
            "/robot/demo:use_sim_time",
        )


@pytest.mark.anyio
async def test_names_without_a_node_are_kept_in_the_global_tree(graph: MemoryGraph) -> None:
    async with graph:
        node = Node(graph, "n", "/ns")
        await node.params.set("/robot/gains", {"p": 1})
        await node.params.set("relative", 5)
        assert await node.params.get("/robot/gains/p") == 1
        assert await node.params.has("/robot")
        assert await node.params.names() == ("/ns/n:use_sim_time", "/ns/relative", "/robot/gains/p")
        await node.params.delete("/robot")
        with pytest.raises(NotFound, match="/robot/gains is not set"):
            await node.params.get("/robot/gains")
        with pytest.raises(NotFound):
            await node.params.delete("/robot")
        assert await node.params.get("/") == {"ns": {"relative": 5}}


@pytest.mark.anyio
async def test_the_six_services(graph: MemoryGraph) -> None:
    async with graph:
        node = Node(graph, "demo")
        node.parameters.declare("arm.gain", 0.5, description="of the arm")
        node.parameters.declare("arm.deep.er", 1)
        node.parameters.declare("name", "x", read_only=True)

        async def call(service: str, request: Mapping[str, object]) -> Message:
            return await node.call(f"/demo/{service}", request)

        described = await call("describe_parameters", {"names": ["arm.gain", "nope"]})
        first, second = described.descriptors
        assert (first.name, first.type, first.description, first.read_only) == (
            "arm.gain",
            3,
            "of the arm",
            False,
        )
        assert (second.name, second.type) == ("nope", 0)
        assert [v.type for v in (await call("get_parameters", {"names": ["name", "nope"]})).values] == [4, 0]
        assert list((await call("get_parameter_types", {"names": ["name", "nope"]})).types) == [4, 0]

        async def listed(prefixes: list[str], depth: int) -> list[str]:
            result = (await call("list_parameters", {"prefixes": prefixes, "depth": depth})).result
            return list(result.names)

        assert await listed([], 0) == ["arm.deep.er", "arm.gain", "name", "use_sim_time"]
        assert await listed([], 1) == ["name", "use_sim_time"]
        assert await listed(["arm"], 1) == ["arm.gain"]
        assert await listed(["arm", "name"], 0) == ["arm.deep.er", "arm.gain", "name"]
        result = (await call("list_parameters", {})).result
        assert list(result.prefixes) == ["arm", "arm.deep"]

        def parameter(name: str, value: ParameterValue) -> dict[str, object]:
            return {"name": name, "value": encode(value)}

        both = {"parameters": [parameter("arm.gain", 0.9), parameter("name", "y")]}
        results = (await call("set_parameters", both)).results
        assert [(r.successful, r.reason) for r in results] == [
            (True, ""),
            (False, "parameter name is read-only"),
        ]
        assert node.parameters.get("arm.gain") == 0.9
        both = {"parameters": [parameter("arm.gain", 0.1), parameter("name", "y")]}
        outcome = (await call("set_parameters_atomically", both)).result
        assert (outcome.successful, outcome.reason) == (False, "parameter name is read-only")
        assert node.parameters.get("arm.gain") == 0.9


@pytest.mark.anyio
async def test_changes_are_published(graph: MemoryGraph) -> None:
    async with graph:
        node = Node(graph, "demo")
        events: list[Message] = []
        node.subscribe("/parameter_events", events.append)
        node.parameters.declare("x", None)
        node.parameters.set("x", 1)
        node.parameters.set("x", 2)
        await node.params.delete("/demo:x")
        changes = [
            (event.node, [p.name for p in event.new_parameters], [p.name for p in event.changed_parameters],
             [p.name for p in event.deleted_parameters])
            for event in events
        ]  # fmt: skip
        assert changes == [
            ("/demo", ["x"], [], []),
            ("/demo", [], ["x"], []),
            ("/demo", [], [], ["x"]),
        ]
        assert events[1].changed_parameters[0].value.integer_value == 2
        assert events[0].stamp.sec == 1


@pytest.mark.anyio
async def test_a_node_that_does_not_answer(graph: MemoryGraph, advance: Advance) -> None:
    async with graph:
        participant = graph.participant("/mute")
        service = graph.registry.service("rcl_interfaces/GetParameters")
        participant.advertise_service("/mute/get_parameters", service, lambda _: None)
        node = Node(graph, "n")
        outcomes: list[str] = []

        async def ask() -> None:
            try:
                await node.params.get("/mute:x")
            except CallTimeout:
                outcomes.append("timeout")

        graph.spawn(ask, "ask")
        await advance(6)
        assert outcomes == ["timeout"]


@pytest.mark.anyio
async def test_on_ros_1_parameters_live_in_the_tree(noetic: MemoryGraph) -> None:
    async with noetic:
        heard: list[ParameterValue] = []
        node, other = Node(noetic, "demo_robot"), Node(noetic, "other")
        await other.params.set("/demo_robot/preset", 7)
        assert node.parameters.declare("preset", 1, on_change=heard.append) == 7
        assert node.parameters.declare("max_speed", 0.5, on_change=heard.append) == 0.5
        node.parameters.declare("gains", {"p": 1})
        await other.params.set("/demo_robot/max_speed", 1)
        await other.params.set("/demo_robot:max_speed", 0.75)
        assert heard == [7, 1.0, 0.75]
        assert await other.params.get("/demo_robot/max_speed") == 0.75
        assert node.parameters.get("max_speed") == 0.75
        with pytest.raises(ParameterRejected, match="expected double"):
            await other.params.set("/demo_robot/max_speed", "fast")
        node.parameters.set("max_speed", 2.0)
        assert await other.params.names() == (
            "/demo_robot/gains/p",
            "/demo_robot/max_speed",
            "/demo_robot/preset",
            "/rosdistro",
            "/rosversion",
            "/run_id",
        )
        assert {each.type.name for each in noetic.services()} == {
            "roscpp/GetLoggers",
            "roscpp/SetLoggerLevel",
        }
        await other.params.delete("/demo_robot/max_speed")
        with pytest.raises(NotFound):
            node.parameters.get("max_speed")
        heard.clear()
        node.close()
        await other.params.set("/demo_robot/max_speed", "anything now")
        assert heard == []


@pytest.mark.anyio
@pytest.mark.parametrize(("value", "warned"), [(False, 1), (True, 0)])
async def test_use_sim_time_can_be_set_and_a_contradiction_is_logged(
    graph: MemoryGraph, value: bool, warned: int
) -> None:
    async with graph:
        node, other = Node(graph, "talker"), Node(graph, "other")
        lines: list[str] = []
        other.subscribe("/rosout", lambda line: lines.append(line.msg))
        await other.params.set("/talker:use_sim_time", value)
        assert node.parameters.get("use_sim_time") is value
        assert len([line for line in lines if "use_sim_time is false now" in line]) == warned


def test_ros_1s_core_says_what_it_is_and_gives_each_run_an_id(noetic: MemoryGraph) -> None:
    assert noetic.parameters.get("/rosdistro") == "noetic\n"
    assert noetic.parameters.get("/rosversion") == "1.17.0\n"
    another = MemoryGraph(Registry(DISTROS["noetic"]))
    assert noetic.parameters.get("/run_id") != another.parameters.get("/run_id")
