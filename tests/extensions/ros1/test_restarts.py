"""What a restarted node offers comes back at every restart, on a graph that is its own master.

ROS is not needed. The measure is readings of the master's tables, which a graph makes each second, not time.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from typing import Any, Final

import anyio
import anyio.abc
import pytest

from rwt.extensions.ros1 import Ros1Graph, discovery
from rwt.extensions.ros1.registrar import Registrar
from rwt.extensions.ros1.wire import rpc
from rwt.extensions.ros1.wire.tcpros import encode_header
from rwt_interfaces.payload import Payload
from rwt_participant.errors import ProviderGone
from rwt_participant.goals import GoalStatus
from tests.contract.graph.harness import GoalDiary
from tests.extensions.ros1.test_hostile import Serve, receive_header, sends, start
from tests.processes import free_port
from tests.waiting import until

pytestmark = pytest.mark.anyio

#: Restarts of each test.
RESTARTS: Final = 50

#: Readings after the master's tables list what was restarted: one lists it, and the next sees its type. Two
#: seconds, since one is made each second.
READINGS: Final = 2

EMPTY: Final = {"type": "std_srvs/Empty", "md5sum": "d41d8cd98f00b204e9800998ecf8427e"}
TRIGGER: Final = {"type": "std_srvs/Trigger", "md5sum": "937c9679a518e3a18d831e57125ea522"}


class Readings:
    """Makes the readings of a graph's tables by hand."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._found: list[discovery.Discovery] = []

        async def wait_for_ever(each: discovery.Discovery) -> None:
            self._found.append(each)
            try:
                await anyio.sleep_forever()
            finally:
                self._found.remove(each)

        monkeypatch.setattr(discovery.Discovery, "run", wait_for_ever)

    async def read(self) -> None:
        """Let every graph read the tables once, and its questions be answered."""
        await anyio.wait_all_tasks_blocked()
        for each in tuple(self._found):
            await each.poll()
        await settled()

    async def until(self, holds: Callable[[], object]) -> None:
        """Read until something holds; fail if that takes more than `READINGS`."""
        for _ in range(READINGS):
            await self.read()
            if holds():
                return
        await until(holds, f"not after {READINGS} readings")  # Of their last answers.


def offers(node: str, type: dict[str, str]) -> Serve:
    """A service that tells its type, also to a client that only looks whether it accepts connections."""

    async def serve(stream: anyio.abc.SocketStream) -> None:
        async with stream:
            try:
                await receive_header(stream)
                await stream.send(encode_header({"callerid": node, **type}))
                await stream.receive()
            except (anyio.EndOfStream, anyio.BrokenResourceError):
                pass

    return serve


async def settled() -> None:
    """Return when what goes over the loopback interface has arrived and was answered."""
    for _ in range(5):
        await anyio.sleep(0.001)
        await anyio.wait_all_tasks_blocked()


@pytest.fixture
def readings(monkeypatch: pytest.MonkeyPatch) -> Readings:
    return Readings(monkeypatch)


@pytest.fixture
async def graph(readings: Readings, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Ros1Graph]:
    """The bridge's graph, which is the master."""
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    async with Ros1Graph(master=f"ros1-master://127.0.0.1:{free_port()}") as joined:
        yield joined


@pytest.fixture
async def tasks(graph: Ros1Graph) -> AsyncIterator[anyio.abc.TaskGroup]:
    async with anyio.create_task_group() as group:
        yield group
        group.cancel_scope.cancel()


def _offer(robot: Ros1Graph) -> None:
    """One endpoint of each kind, two of them of types that the bridge does not know beforehand."""
    robot.registry.add_text("int32 number", "my_msgs/Thing")
    node = robot.node("robot")
    node.advertise("/own", "my_msgs/Thing")
    node.advertise("/text", "std_msgs/String")
    node.subscribe("/heard", lambda _: None, "std_msgs/String")
    node.advertise_service("/fast", "std_srvs/Trigger", lambda _: {"success": True})

    async def execute(goal: Any) -> None:
        await anyio.sleep_forever()

    node.advertise_action("/count", "actionlib_tutorials/Fibonacci", execute)


def _is_listed(graph: Ros1Graph) -> bool:
    found = [graph.topic(name) for name in ("/own", "/text")]
    heard = graph.topic("/heard")
    return (
        all(each is not None and each.type is not None and each.publishers for each in found)
        and heard is not None
        and bool(heard.subscribers)
        and graph.service("/fast") is not None
        and graph.action("/count") is not None
        and any(each.name == "/robot" for each in graph.nodes())
    )


def _is_gone(graph: Ros1Graph) -> bool:
    left = [graph.service("/fast"), graph.action("/count")]
    topics = [graph.topic(name) for name in ("/own", "/text")]
    return left == [None, None] and not any(each and each.publishers for each in topics)


async def _registered(robot: Ros1Graph) -> None:
    session = robot.session
    assert session is not None

    def is_complete() -> bool:
        kinds = [each.kind for each in session.registrar.confirmed if each.node.name == "/robot"]
        names = {each.name for each in session.registrar.confirmed}
        return "Service" in kinds and {"/own", "/text", "/heard", "/fast", "/count/goal"} <= names

    await until(is_complete)


@pytest.mark.parametrize("how", ["stopped", "killed"])
async def test_every_kind_of_endpoint_comes_back(
    graph: Ros1Graph, readings: Readings, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    if how == "killed":  # Its registrations stay at the master.

        async def no_farewell(_: Registrar) -> None:
            return

        monkeypatch.setattr(Registrar, "leave", no_farewell)
    uri = graph.master.replace("http", "ros1").rstrip("/")
    for _ in range(RESTARTS // 5):  # Five kinds of endpoints in each.
        async with Ros1Graph(master=uri) as robot:
            _offer(robot)
            await _registered(robot)
            await readings.until(lambda: _is_listed(graph))
            answer = await graph.node("caller").call("/fast", {})
            assert answer.success
        if how == "stopped":
            await readings.until(lambda: _is_gone(graph))


async def test_a_service_comes_back_from_whatever_its_probe_met(
    graph: Ros1Graph, readings: Readings, tasks: anyio.abc.TaskGroup
) -> None:
    """Its node was killed before its type was known: the master's tables are the same after the restart."""
    for number in range(RESTARTS):
        await _serve(graph, "/robot", "/fast", f"rosrpc://127.0.0.1:{free_port()}")
        for _ in range(1 + number % 7):
            await readings.read()
        assert graph.service("/fast") is None
        alive = await start(graph, tasks, offers("/robot", TRIGGER))
        uri = f"rosrpc://127.0.0.1:{alive.port}"
        await _serve(graph, "/robot", "/fast", uri)
        await readings.until(lambda: graph.service("/fast") is not None)
        await rpc.call(graph.master, "unregisterService", "/robot", "/fast", uri)
        await readings.until(lambda: graph.service("/fast") is None)


async def test_a_service_that_two_nodes_offer_in_turn_is_always_known(
    graph: Ros1Graph, readings: Readings, tasks: anyio.abc.TaskGroup
) -> None:
    """The master has the last one; what the other node has answered says nothing about a later time."""
    providers = {
        "/first": await start(graph, tasks, offers("/first", EMPTY)),
        "/second": await start(graph, tasks, offers("/second", TRIGGER)),
    }
    types = {"/first": EMPTY["type"], "/second": TRIGGER["type"]}
    for number in range(RESTARTS):
        node = ("/first", "/second")[number % 2]
        await _serve(graph, node, "/shared", f"rosrpc://127.0.0.1:{providers[node].port}")

        def is_known(node: str = node) -> bool:
            info = graph.service("/shared")
            return info is not None and (info.node, info.type.name) == (node, types[node])

        await readings.until(is_known)


async def test_services_of_a_node_that_answered_late_come_back_together(
    graph: Ros1Graph, readings: Readings, tasks: anyio.abc.TaskGroup
) -> None:
    names = [f"/service{number}" for number in range(20)]
    for name in names:
        await _serve(graph, "/robot", name, f"rosrpc://127.0.0.1:{free_port()}")
    for _ in range(8):
        await readings.read()
    alive = await start(graph, tasks, offers("/robot", EMPTY))
    for name in names:
        await _serve(graph, "/robot", name, f"rosrpc://127.0.0.1:{alive.port}")
    await readings.until(lambda: all(graph.service(name) is not None for name in names))


async def test_a_node_that_has_ended_costs_one_question_a_reading(
    graph: Ros1Graph, readings: Readings, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(20):
        await _serve(graph, "/robot", f"/service{number}", f"rosrpc://127.0.0.1:{free_port()}")
    await readings.read()
    asked: list[str] = []
    call = graph.session.call_master if graph.session is not None else None
    assert call is not None

    async def counted(method: str, caller: str, *params: Any) -> Any:
        asked.append(method)
        return await call(method, caller, *params)

    monkeypatch.setattr(graph.session, "call_master", counted)
    for _ in range(5):
        await readings.read()
    assert asked.count("lookupService") == 5


async def test_the_log_tells_each_time_that_a_service_is_not_available(
    graph: Ros1Graph, readings: Readings, tasks: anyio.abc.TaskGroup, caplog: pytest.LogCaptureFixture
) -> None:
    node = await start(graph, tasks, offers("/robot", {"type": "my_srvs/Own", "md5sum": "0" * 32}))
    where = ("/robot", "/own", f"rosrpc://127.0.0.1:{node.port}")
    for number in range(1, 4):
        await rpc.call(graph.master, "registerService", *where, node.uri)
        for _ in range(3):
            await readings.read()
        assert caplog.text.count("service /own cannot be called") == number
        await rpc.call(graph.master, "unregisterService", *where)
        await readings.read()


async def test_a_topic_whose_node_has_another_type_after_its_restart(
    graph: Ros1Graph, readings: Readings, tasks: anyio.abc.TaskGroup
) -> None:
    """A subscriber without a type meets it; the master's tables are the same as before."""
    string = {
        "callerid": "/robot",
        "topic": "/out",
        "type": "std_msgs/String",
        "md5sum": "992ce8a1687cec8c8bd883ec73ca41d1",
        "message_definition": "string data\n",
    }
    number = {
        **string,
        "type": "std_msgs/Int32",
        "md5sum": "da5909fbe378aeaf85e547e830cc1bb7",
        "message_definition": "int32 data\n",
    }
    subscription = None
    for header in (string, number, string, number):
        node = await start(graph, tasks, sends(encode_header(header)))
        await rpc.call(graph.master, "registerPublisher", "/robot", "/out", header["type"], node.uri)
        await readings.read()
        if subscription is None:
            subscription = graph.node("listener").subscribe("/out", lambda _: None)

        def has_type(name: str = header["type"]) -> bool:
            info = graph.topic("/out")
            return info is not None and info.type is not None and info.type.name == name

        await until(has_type)


async def test_a_publisher_that_left_between_two_readings_is_forgotten(
    graph: Ros1Graph, readings: Readings, tasks: anyio.abc.TaskGroup
) -> None:
    """Its connection was faster than the tables, which are the same before and after."""
    header = {
        "callerid": "/quick",
        "topic": "/chatter",
        "type": "std_msgs/String",
        "md5sum": "992ce8a1687cec8c8bd883ec73ca41d1",
        "message_definition": "string data\n",
    }
    graph.node("listener").subscribe("/chatter", lambda _: None, "std_msgs/String")
    await readings.read()
    quick = await start(graph, tasks, sends(encode_header(header)))
    where = ("/quick", "/chatter", "std_msgs/String", quick.uri)
    await rpc.call(graph.master, "registerPublisher", *where)
    await until(lambda: "/quick" in _publishers(graph))
    await rpc.call(graph.master, "unregisterPublisher", "/quick", "/chatter", quick.uri)
    await readings.until(lambda: "/quick" not in _publishers(graph))


def _publishers(graph: Ros1Graph) -> list[str]:
    info = graph.topic("/chatter")
    return [] if info is None else [each.node for each in info.publishers]


async def test_a_service_of_this_process_is_offered_once_the_other_node_is_gone(
    graph: Ros1Graph, readings: Readings, tasks: anyio.abc.TaskGroup
) -> None:
    where = await _alive(graph, tasks, "/other", "/go")
    graph.node("server").advertise_service("/go", "std_srvs/Trigger", lambda _: {})
    await readings.read()
    assert await rpc.call(graph.master, "lookupService", "/x", "/go") == where[2]
    await rpc.call(graph.master, "unregisterService", *where)
    await readings.read()
    await until(lambda: _is_confirmed(graph, "/go"))


def _is_confirmed(graph: Ros1Graph, name: str) -> bool:
    assert graph.session is not None
    return any(each.name == name for each in graph.session.registrar.confirmed)


async def test_goals_end_when_their_server_is_killed(
    graph: Ros1Graph, readings: Readings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its registrations stay, and a new server does not know the goals of the one before."""

    async def no_farewell(_: Registrar) -> None:
        return

    monkeypatch.setattr(Registrar, "leave", no_farewell)
    uri = graph.master.replace("http", "ros1").rstrip("/")
    diary = GoalDiary()
    client = graph.participant("/client")
    async with Ros1Graph(master=uri) as robot:
        _offer(robot)
        await _registered(robot)
        await readings.until(lambda: _is_listed(graph))
        goal = graph.registry.action("actionlib_tutorials/Fibonacci").goal
        client.send_goal("/count", Payload.from_value(goal, {"order": 3}), diary.events)
        await until(lambda: "accepted" in diary.heard)
        assert robot.session is not None
        robot.session.close()  # As the kernel does.
    await until(lambda: len(diary.heard) == 2)
    status, reason = diary.heard[1]
    assert status is GoalStatus.ABORTED
    assert reason == f"{ProviderGone.__name__}: Action /count is no longer connected"


async def _alive(
    graph: Ros1Graph, tasks: anyio.abc.TaskGroup, node: str, service: str
) -> tuple[str, str, str]:
    other = await start(graph, tasks, offers(node, TRIGGER))
    where = (node, service, f"rosrpc://127.0.0.1:{other.port}")
    await rpc.call(graph.master, "registerService", *where, other.uri)
    return where


async def _serve(graph: Ros1Graph, node: str, service: str, uri: str) -> None:
    """Register a service of a node whose calls nobody answers."""
    await rpc.call(graph.master, "registerService", node, service, uri, "http://127.0.0.1:1/")
