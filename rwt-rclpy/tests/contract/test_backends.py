"""Nodes in the graph of their process, of a server over a Unix socket, over Zenoh, and in virtual time.

Each test waits for what comes, and for nothing else, so that it is right on a machine of any speed.
"""

from __future__ import annotations

import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

import rwt_rclpy
from rwt import MemoryGraph, Server

#: How long anything is waited for, in seconds: only what is broken takes so long.
PATIENCE = 60.0


@contextmanager
def in_memory() -> Iterator[None]:
    with rwt_rclpy.join("memory"):
        yield


@contextmanager
def on_a_server(graph: MemoryGraph | None = None) -> Iterator[None]:
    with tempfile.TemporaryDirectory() as folder:
        url = f"unix://{Path(folder) / 'robot.sock'}"
        with Server(url, graph=graph or MemoryGraph()), rwt_rclpy.join(url):
            yield


@contextmanager
def beside_a_server_of_actions() -> Iterator[None]:
    graph = MemoryGraph()

    def offer() -> None:
        kind = graph.registry.action("example_interfaces/Fibonacci")
        graph.participant("/robot").advertise_action("/rejecting", kind, lambda goal: goal.reject("no way"))

    with on_a_server(graph):
        graph.run_on_graph(offer)
        yield


@contextmanager
def over_zenoh() -> Iterator[None]:
    pytest.importorskip("zenoh")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    from anyio.from_thread import start_blocking_portal

    from rwt.extensions.zenoh import ZenohGraph

    other = ZenohGraph(listen=[f"tcp/127.0.0.1:{port}"])
    with (
        start_blocking_portal() as portal,
        portal.wrap_async_context_manager(other),
        rwt_rclpy.join(f"zenoh:tcp/127.0.0.1:{port}"),
    ):
        yield


@contextmanager
def in_virtual_time() -> Iterator[None]:
    from rwt_rclpy.middleware.link import VirtualDomain

    with VirtualDomain():
        yield


@pytest.fixture(params=[in_memory, on_a_server, over_zenoh, in_virtual_time])
def rclpy(request: pytest.FixtureRequest) -> Iterator[Any]:
    import rclpy

    from rwt_rclpy.middleware.link import DOMAINS

    with ExitStack() as stack:
        stack.enter_context(request.param())
        rclpy.init(args=[])
        yield rclpy
        rclpy.try_shutdown()
        DOMAINS.reset()


def node(rclpy: Any, executor: Any, name: str, **options: Any) -> Any:
    made = rclpy.create_node(name, **options)
    executor.add_node(made)
    return made


def spin_until(executor: Any, ready: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not ready():
        assert time.monotonic() < deadline, "it did not come"
        executor.spin_once(timeout_sec=0.05)


def interface(name: str) -> Any:
    from rwt_rclpy.messages.loaded import classes

    return classes().by_type_name(name)


def test_messages_arrive_in_order(rclpy: Any, executor: Any) -> None:
    String = interface("std_msgs/msg/String")
    heard: list[str] = []
    node(rclpy, executor, "listener").create_subscription(
        String, "/chatter", lambda message: heard.append(message.data), 100
    )
    publisher = node(rclpy, executor, "talker").create_publisher(String, "chatter", 100)
    numbers = iter(range(10_000))

    def hears() -> bool:
        publisher.publish(String(data=str(next(numbers))))
        return len(heard) >= 5

    spin_until(executor, hears)
    wanted = [int(each) for each in heard]
    assert wanted == list(range(wanted[0], wanted[0] + len(wanted)))


def test_a_nodes_own_messages_come_once(rclpy: Any, executor: Any) -> None:
    Int32 = interface("std_msgs/msg/Int32")
    it = node(rclpy, executor, "both")
    heard: list[int] = []
    it.create_subscription(Int32, "/numbers", lambda message: heard.append(message.data), 100)
    publisher = it.create_publisher(Int32, "/numbers", 100)
    for number in range(3):
        publisher.publish(Int32(data=number))
    spin_until(executor, lambda: 2 in heard)
    publisher.publish(Int32(data=9))
    spin_until(executor, lambda: 9 in heard)
    assert heard == [0, 1, 2, 9]


def test_late_joiners_get_what_is_kept(rclpy: Any, executor: Any) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    Int32 = interface("std_msgs/msg/Int32")
    it = node(rclpy, executor, "map_server")
    it.create_publisher(Int32, "/map", latched).publish(Int32(data=7))
    first: list[int] = []
    it.create_subscription(Int32, "/map", lambda message: first.append(message.data), latched)
    spin_until(executor, lambda: first)
    second: list[int] = []
    it.create_subscription(Int32, "/map", lambda message: second.append(message.data), latched)
    spin_until(executor, lambda: second)
    assert first == [7] == second


def test_services_are_called_and_found(rclpy: Any, executor: Any) -> None:
    AddTwoInts = interface("example_interfaces/srv/AddTwoInts")
    server, caller = node(rclpy, executor, "server"), node(rclpy, executor, "caller")

    def add(request: Any, response: Any) -> Any:
        response.sum = request.a + request.b
        return response

    server.create_service(AddTwoInts, "/add", add)
    client = caller.create_client(AddTwoInts, "/add")
    assert client.wait_for_service(PATIENCE)
    future = client.call_async(AddTwoInts.Request(a=1, b=2))
    spin_until(executor, future.done)
    assert future.result().sum == 3


def test_a_service_that_is_withdrawn_is_not_offered(rclpy: Any, executor: Any) -> None:
    Trigger = interface("std_srvs/srv/Trigger")
    it = node(rclpy, executor, "server")
    service = it.create_service(Trigger, "/go", lambda request, response: response)
    assert it.create_client(Trigger, "/go").wait_for_service(PATIENCE)
    it.destroy_service(service)
    client = it.create_client(Trigger, "/go")
    spin_until(executor, lambda: not client.service_is_ready())


def test_parameters_of_another_node(rclpy: Any, executor: Any) -> None:
    from rclpy.parameter_client import AsyncParameterClient

    it = node(rclpy, executor, "camera")
    it.declare_parameter("rate", 5)
    client = AsyncParameterClient(node(rclpy, executor, "tuner"), "/camera")
    assert client.wait_for_services(PATIENCE)
    future = client.get_parameters(["rate"])
    spin_until(executor, future.done)
    assert future.result().values[0].integer_value == 5


def test_actions_with_feedback_and_result(rclpy: Any, executor: Any) -> None:
    from rclpy.action import ActionClient, ActionServer

    Fibonacci = interface("example_interfaces/action/Fibonacci")

    def execute(handle: Any) -> Any:
        sequence = [0, 1]
        for _ in range(handle.request.order - 1):
            sequence.append(sequence[-1] + sequence[-2])
            handle.publish_feedback(Fibonacci.Feedback(sequence=sequence))
        handle.succeed()
        return Fibonacci.Result(sequence=sequence)

    ActionServer(node(rclpy, executor, "server"), Fibonacci, "/fibonacci", execute)
    client = ActionClient(node(rclpy, executor, "caller"), Fibonacci, "/fibonacci")
    spin_until(executor, client.server_is_ready)
    feedback: list[Any] = []
    sent = client.send_goal_async(Fibonacci.Goal(order=5), feedback_callback=feedback.append)
    spin_until(executor, sent.done)
    assert sent.result().accepted
    result = sent.result().get_result_async()
    spin_until(executor, result.done)
    assert list(result.result().result.sequence) == [0, 1, 1, 2, 3, 5]
    assert result.result().status == 4
    spin_until(executor, lambda: feedback)


@pytest.mark.parametrize("rclpy", [beside_a_server_of_actions], indirect=True)
def test_a_goal_that_a_server_rejects_ends_as_aborted(rclpy: Any, executor: Any) -> None:
    from rclpy.action import ActionClient

    Fibonacci = interface("example_interfaces/action/Fibonacci")
    client = ActionClient(node(rclpy, executor, "caller"), Fibonacci, "/rejecting")
    spin_until(executor, client.server_is_ready)
    sent = client.send_goal_async(Fibonacci.Goal(order=1))
    spin_until(executor, sent.done)
    result = sent.result().get_result_async()
    spin_until(executor, result.done)
    assert (result.result().status, result.result().result) == (6, Fibonacci.Result())


@pytest.mark.parametrize("rclpy", [on_a_server], indirect=True)
def test_all_feedback_comes_once_and_before_the_result(
    rclpy: Any, executor: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rclpy.action import ActionClient, ActionServer

    from rwt_rclpy.middleware.robot_graph import RobotTopic

    late: list[Callable[[], None]] = []
    receive = RobotTopic._receive

    def receive_late(topic: RobotTopic, message: Any) -> None:
        if topic.name == "/count/_action/feedback":
            late.append(lambda: receive(topic, message))
        else:
            receive(topic, message)

    monkeypatch.setattr(RobotTopic, "_receive", receive_late)
    Fibonacci, Int32 = interface("example_interfaces/action/Fibonacci"), interface("std_msgs/msg/Int32")

    def execute(handle: Any) -> Any:
        for number in range(handle.request.order):
            handle.publish_feedback(Fibonacci.Feedback(sequence=[number]))
        handle.succeed()
        return Fibonacci.Result()

    it = node(rclpy, executor, "both")
    told: list[Any] = []
    it.create_subscription(Fibonacci.Impl.FeedbackMessage, "/count/_action/feedback", told.append, 10)
    ActionServer(it, Fibonacci, "/count", execute)
    client = ActionClient(it, Fibonacci, "/count")
    spin_until(executor, client.server_is_ready)
    feedback: list[int] = []
    sent = client.send_goal_async(
        Fibonacci.Goal(order=5),
        feedback_callback=lambda message: feedback.append(message.feedback.sequence[0]),
    )
    spin_until(executor, sent.done)
    result = sent.result().get_result_async()
    spin_until(executor, result.done)
    assert feedback == [0, 1, 2, 3, 4]
    spin_until(executor, lambda: len(late) == 5)
    for each in late:
        it.context._rwt_link.run(each)
    heard: list[Any] = []
    it.create_subscription(Int32, "/after", heard.append, 1)
    it.create_publisher(Int32, "/after", 1).publish(Int32())
    spin_until(executor, lambda: heard)
    assert len(told) == 5


def test_the_graph_lists_what_is_there(rclpy: Any, executor: Any) -> None:
    String = interface("std_msgs/msg/String")
    it = node(rclpy, executor, "talker", namespace="/robot")
    publisher = it.create_publisher(String, "/status", 1)
    it.create_subscription(String, "/status", lambda _: None, 1)
    spin_until(
        executor, lambda: dict(it.get_topic_names_and_types()).get("/status") == ["std_msgs/msg/String"]
    )
    spin_until(executor, lambda: publisher.get_subscription_count() >= 1)
    spin_until(executor, lambda: it.count_publishers("/status") >= 1)
    assert "/robot/talker" in it.get_fully_qualified_node_names()


def test_a_graph_that_is_none_is_refused() -> None:
    from rwt_rclpy.middleware.joining import CannotJoin

    with pytest.raises(CannotJoin, match="is no graph: expected `memory`"), rwt_rclpy.join("nowhere"):
        pass
    with pytest.raises(CannotJoin, match="cannot be joined"), rwt_rclpy.join("unix:///nobody/listens.sock"):
        pass
