"""Types without an installed package: their exchange, their description to others, and malformed calls."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

from rwt_graph.api import GoalEvents, Participant, ServerGoal, ServiceCall
from rwt_graph.errors import Ros2Error
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.goals import GoalStatus
from tests.extensions.ros2.live.program import NODE
from tests.extensions.ros2.live.values import comparable
from tests.waiting import until

if TYPE_CHECKING:
    from rwt.extensions.ros2 import Ros2Graph
    from rwt_graph.api import Sample
    from tests.statements import Program

pytestmark = pytest.mark.anyio

_PLANT = "string name\nfloat64[] heights\ngeometry_msgs/Point place\nint8 LARGE=3\n"
_WATER = "garden_msgs/Plant plant\n---\nfloat32 litres\n"
_GROW = "float32 metres\n---\nstring name\n---\nfloat32 height\n"


def garden(plant: str = _PLANT) -> Registry:
    """Definitions of a package that is installed nowhere."""
    registry = Registry()
    registry.add_text(plant, "garden_msgs/Plant")
    registry.add_text(_WATER, "garden_msgs/Water", "srv")
    registry.add_text(_GROW, "garden_msgs/Grow", "action")
    return registry


async def joined(registry: Registry) -> AsyncIterator[Ros2Graph]:
    from rwt.extensions.ros2 import Ros2Graph

    async with Ros2Graph(registry) as graph:
        yield graph


@pytest.fixture
async def gardener(domain: int) -> AsyncIterator[Ros2Graph]:
    """A graph that knows the package by its definitions."""
    async for graph in joined(garden()):
        yield graph


@pytest.fixture
async def other(domain: int) -> AsyncIterator[Ros2Graph]:
    """Another one: to ROS 2, they are two programs."""
    async for graph in joined(garden()):
        yield graph


@pytest.fixture
async def stranger(domain: int) -> AsyncIterator[Ros2Graph]:
    """A graph that knows the standard interfaces only, not even those that are installed."""
    async for graph in joined(Registry()):
        yield graph


def payload(graph: Ros2Graph, type: str, value: object) -> Payload:
    return Payload.from_value(graph.registry.message(type), value)


async def test_topics_services_and_actions_of_a_package_that_is_not_installed(
    gardener: Ros2Graph, other: Ros2Graph
) -> None:
    ours, theirs = gardener.participant("/ours"), other.participant("/theirs")
    samples: list[Sample] = []
    ours.subscribe("/plants", samples.append)
    publisher = theirs.advertise("/plants", other.registry.message("garden_msgs/Plant"))
    theirs.advertise_service("/water", other.registry.service("garden_msgs/Water"), partial(_water, other))
    theirs.advertise_action("/grow", other.registry.action("garden_msgs/Grow"), partial(_grow, other))
    await until(lambda: gardener.topic("/plants") and gardener.service("/water") and gardener.action("/grow"))
    fern = {"name": "fern", "heights": [1.0, 2.5], "place": {"x": 1.0, "y": 2.0, "z": 3.0}}
    await until(lambda: publisher.publish(payload(other, "garden_msgs/Plant", fern)) or samples)
    assert comparable(samples[0].payload.value()) == fern
    answers: list[Any] = []
    ours.call_service(
        "/water", payload(gardener, "garden_msgs/Water_Request", {"plant": fern}), answers.append
    )
    feedback: list[Any] = []
    results: list[Any] = []
    events = GoalEvents(lambda *end: results.append(end), lambda each: feedback.append(each.value()))
    ours.send_goal("/grow", payload(gardener, "garden_msgs/Grow_Goal", {"metres": 2.0}), events)
    await until(lambda: answers and results and feedback)
    assert answers[0].value().litres == 2.5
    ((status, result),) = results
    assert (status, result.value().name, feedback[0].height) == (GoalStatus.SUCCEEDED, "fern", 1.0)


def _water(graph: Ros2Graph, call: ServiceCall) -> None:
    request: Any = call.request.value()
    call.reply(payload(graph, "garden_msgs/Water_Response", {"litres": max(request.plant.heights)}))


def _grow(graph: Ros2Graph, goal: ServerGoal) -> None:
    goal.accept()

    def finish() -> None:
        goal.feedback(payload(graph, "garden_msgs/Grow_Feedback", {"height": 1.0}))
        goal.finish(GoalStatus.SUCCEEDED, payload(graph, "garden_msgs/Grow_Result", {"name": "fern"}))

    graph.clock.call_later(0.2, finish)


async def test_a_message_is_learned_from_the_node_that_publishes_it(
    stranger: Ros2Graph, program: Program
) -> None:
    program.run(
        """
from test_msgs.msg import Defaults, MultiNested
received = []
publisher = node.create_publisher(MultiNested, '/nested', 10)
node.create_publisher(Defaults, '/defaults', 10)
take = lambda message: received.append(plain(message))
subscription = node.create_subscription(Defaults, '/to_them', take, 10)
"""
    )
    samples: list[Sample] = []
    stranger.participant("/ours").subscribe("/nested", samples.append)
    await until(lambda: _type_of(stranger, "/nested") and _type_of(stranger, "/defaults"))
    expected = "publisher.publish(MultiNested()); result = plain(MultiNested())"
    await until(lambda: program.run(expected) and samples)
    assert comparable(samples[0].payload.value()) == program.run(expected)
    # Defaults and constants come from the file of the definition.
    defaults = stranger.registry.message("test_msgs/Defaults")
    publisher = stranger.participant("/theirs").advertise("/to_them", defaults)
    await until(
        lambda: publisher.publish(Payload.from_value(defaults, {})) or program.run("result = received")
    )
    assert program.run("result = received[0] == plain(Defaults())") is True
    assert not stranger.problems.of("/nested")


def _type_of(graph: Ros2Graph, topic: str) -> str:
    info = graph.topic(topic)
    return info.type.name if info is not None and info.type is not None else ""


async def test_the_definition_of_the_publisher_is_used_if_it_is_another(
    graph: Ros2Graph, program: Program
) -> None:
    graph.registry.add_text("int32 nothing_like_it\n", "test_msgs/BasicTypes")
    samples: list[Sample] = []
    ours = graph.participant("/ours")
    ours.subscribe("/basic", samples.append, graph.registry.message("test_msgs/BasicTypes"))
    program.run(
        """
from test_msgs.msg import BasicTypes
publisher = node.create_publisher(BasicTypes, '/basic', 10)
"""
    )
    publish = "publisher.publish(BasicTypes(int32_value=-7)); result = publisher.get_subscription_count()"
    await until(lambda: program.run(publish) and samples)
    message: Any = samples[0].payload.value()
    assert message.int32_value == -7
    assert graph.registry.message("test_msgs/BasicTypes").definition.fields[0].name == "nothing_like_it"


async def test_what_nobody_describes_is_reported_once(
    gardener: Ros2Graph, stranger: Ros2Graph, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING, "rwt_graph")
    reported: list[tuple[str, str]] = []
    stranger.problems.observers.add(lambda *problem: reported.append(problem))
    node = gardener.participant("/gardener")
    node.advertise("/plants", gardener.registry.message("garden_msgs/Plant"))
    node.advertise_service("/water", gardener.registry.service("garden_msgs/Water"), lambda _: None)
    node.advertise_action("/grow", gardener.registry.action("garden_msgs/Grow"), lambda _: None)
    names = {"/plants", "/water", "/grow/_action/send_goal", "/grow/_action/get_result"}
    names.add("/grow/_action/feedback")
    await until(lambda: {name for name, _ in reported} >= names)
    (plants,) = (text for name, text in reported if name == "/plants")
    assert plants == (
        "/plants cannot be exchanged: its type garden_msgs/msg/Plant is not known here, and no node "
        "describes it; give its definition with --interfaces DIR"
    )
    (water,) = (text for name, text in reported if name == "/water")
    assert water.startswith("/water cannot be called: garden_msgs/srv/Water is not known here")
    assert [text for text in caplog.messages if "garden_msgs" in text] == [
        text for _, text in reported if "garden_msgs" in text
    ]
    assert all("of node  " not in text for text in caplog.messages)


async def test_services_with_another_definition_are_not_called(
    gardener: Ros2Graph, stranger: Ros2Graph
) -> None:
    stranger.registry.add_text("int8 x\n---\n", "garden_msgs/Water", "srv")
    service = gardener.registry.service("garden_msgs/Water")
    gardener.participant("/gardener").advertise_service("/water", service, lambda _: None)
    await until(lambda: stranger.problems.of("/water"))
    assert "its node defines garden_msgs/srv/Water otherwise" in stranger.problems.of("/water")[0]
    assert stranger.service("/water") is None


_RAW_CLIENT = f"""
from rclpy.impl.implementation_singleton import rclpy_implementation
from rwt.extensions.ros2.type_supports.calls import RawClient
from rwt.extensions.ros2.type_supports.selection import type_supports
from rwt_interfaces.registry import Registry
registry = Registry()
registry.add_text({_PLANT!r}, "garden_msgs/Plant")
registry.add_text({_WATER!r}, "garden_msgs/Water", "srv")
made, forms = type_supports().service(registry.service("garden_msgs/Water"))
profile = qos.QoSProfile(depth=10).get_c_qos_profile()
client = RawClient(rclpy_implementation.Client(node.handle, made, "/water", profile), "/water", forms)
"""


@pytest.mark.parametrize("body", [b"", b"\xff", b"\xff\xff\xff\xff" * 3, bytes(2**20)])
async def test_a_malformed_request_ends_with_its_call(
    gardener: Ros2Graph, program: Program, body: bytes
) -> None:
    ours = gardener.participant("/ours")
    ours.advertise_service(
        "/water", gardener.registry.service("garden_msgs/Water"), partial(_water, gardener)
    )
    program.run(_RAW_CLIENT)
    await until(lambda: program.run("result = client.endpoint.service_server_is_available()"))
    request = payload(gardener, "garden_msgs/Water_Request", {"plant": {"heights": [4.0]}})
    for data in (b"\0\1\0\0" + body, request.cdr()):
        program.run(f"sent = client.send(bytes.fromhex({data.hex()!r}))")
    answer = payload(gardener, "garden_msgs/Water_Response", {"litres": 4.0})
    await until(lambda: program.run("call = client.take(); result = call is not None"))
    taken = program.run("result = [call.id.number == sent, call.data.hex()]")
    assert taken == [True, answer.cdr().hex()]


async def test_others_see_the_hash_and_a_program_may_use_the_installed_package_as_well(
    graph: Ros2Graph, program: Program
) -> None:
    type = graph.registry.message("test_msgs/Arrays")
    graph.participant("/ours").advertise("/arrays", type)
    # Both describe the fields to the middleware of one process, which accepts one description of a name.
    program.run(
        """
from rclpy.impl.implementation_singleton import rclpy_implementation
from rwt.extensions.ros2.ament import add_installed
from rwt.extensions.ros2.type_supports.selection import type_supports
from rwt_interfaces.registry import Registry
from test_msgs.msg import Arrays
registry = Registry()
add_installed(registry)
made = type_supports().message(registry.message('test_msgs/Arrays'))
profile = qos.QoSProfile(depth=10).get_c_qos_profile()
installed = node.create_publisher(Arrays, '/arrays', 10)
defined = rclpy_implementation.Publisher(node.handle, made, '/arrays', profile)
"""
    )
    hashes = "result = [str(i.topic_type_hash) for i in node.get_publishers_info_by_topic('/arrays')]"
    await until(lambda: program.run(hashes) == [type.rihs01] * 3)
    program.run("defined.destroy_when_not_in_use()")


@pytest.mark.parametrize("ask", ["words", "functions"])
async def test_a_middleware_of_another_kind_exchanges_installed_types(
    program: Program, domain: int, ask: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    from rwt.extensions.ros2 import Ros2Graph
    from rwt.extensions.ros2.type_supports import fast_cdr, selection

    caplog.set_level(logging.INFO, "rwt.extensions.ros2")
    if ask == "words":
        monkeypatch.setattr(fast_cdr, "CDR_WORDS", 4)
    else:
        monkeypatch.setattr(fast_cdr, "SYMBOLS", ("no_such_function",) * 3)
        fast_cdr.cdr_functions.cache_clear()
    selection.type_supports.cache_clear()
    try:
        async with Ros2Graph() as graph:
            (warning,) = (each for each in caplog.messages if "packages are installed" in each)
            assert ("another layout" if ask == "words" else "Fast CDR 2") in warning
            node: Participant = graph.participant("/ours")
            program.run(
                """
from std_srvs.srv import SetBool
def serve(request, response):
    response.success, response.message = request.data, 'served'
    return response
service = node.create_service(SetBool, '/switch', serve)
client = node.create_client(SetBool, '/ours')
"""
            )
            type = graph.registry.service("std_srvs/SetBool")
            reply = partial(Payload.from_value, type.response, {"success": True, "message": "ours"})
            node.advertise_service("/ours", type, lambda call: call.reply(reply()))
            await until(lambda: graph.service("/switch"))
            answers: list[Any] = []
            node.call_service("/switch", Payload.from_value(type.request, {"data": True}), answers.append)
            await until(lambda: answers)
            assert answers[0].value().message == "served"
            await until(lambda: program.run("result = client.service_is_ready()"))
            program.run("future = client.call_async(SetBool.Request())")
            await until(lambda: program.run("result = future.done() and future.result().message") == "ours")
            graph.registry.add_text("", "garden_msgs/Plant")
            node.advertise("/plants", graph.registry.message("garden_msgs/Plant"))
            assert any("the package garden_msgs" in each for each in caplog.messages)
    finally:
        monkeypatch.undo()
        fast_cdr.cdr_functions.cache_clear()
        selection.type_supports.cache_clear()


async def test_a_publisher_offers_what_subscribers_request(graph: Ros2Graph, program: Program) -> None:
    text = graph.registry.message("std_msgs/String")
    publisher = graph.participant("/ours").advertise("/command", text)
    program.run(
        """
from rclpy.duration import Duration
kept = qos.QoSProfile(depth=5, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
received = []
take = lambda message: received.append(message.data)
subscription = node.create_subscription(String, '/command', take, kept)
"""
    )
    hello = Payload.from_value(text, {"data": "hello"})
    await until(lambda: publisher.publish(hello) or program.run("result = received"))
    assert not graph.problems.of("/command")
    program.run(
        """
hasty = qos.QoSProfile(depth=1, deadline=Duration(seconds=1))
another = node.create_subscription(String, '/command', print, hasty)
"""
    )
    await until(lambda: graph.problems.of("/command"))
    (problem,) = graph.problems.of("/command")
    assert problem == (
        f"{NODE} does not receive what is published on /command here: it requests a deadline that the "
        "publisher does not offer; advertise the topic with a `qos` that has it, or change the subscriber"
    )
    program.run("node.destroy_subscription(another); node.destroy_subscription(subscription)")
    await until(lambda: not graph.problems.of("/command"))


async def test_commands_that_a_stop_must_end_are_not_retained(graph: Ros2Graph, program: Program) -> None:
    graph.may_retain = lambda topic: topic != "/command"
    text = graph.registry.message("std_msgs/String")
    graph.participant("/ours").advertise("/command", text)
    program.run(
        """
kept = qos.QoSProfile(depth=5, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
subscription = node.create_subscription(String, '/command', print, kept)
"""
    )
    await until(lambda: graph.problems.of("/command"))
    assert "it requests a durability that the publisher does not offer" in graph.problems.of("/command")[0]


async def test_a_domain_without_ports_is_rejected(domain: int) -> None:
    from rwt.extensions.ros2 import Ros2Graph

    with pytest.raises(Ros2Error, match="ROS_DOMAIN_ID is 300, and DDS has ports for the domains 0 to 232"):
        async with Ros2Graph(domain=300):
            pass
