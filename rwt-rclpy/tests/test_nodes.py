"""Nodes in one process, in virtual time: topics, services, timers, parameters, actions, logs."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from rwt_rclpy.middleware.link import VirtualDomain


def classes(name: str) -> Any:
    from rwt_rclpy.messages.loaded import classes as known

    return known().by_type_name(name)


def spin_some(executor: Any, seconds: float = 1.0) -> None:
    import rclpy

    executor.spin_until_future_complete(rclpy.task.Future(), seconds)


def node(rclpy: Any, executor: Any, name: str = "node", **options: Any) -> Any:
    made = rclpy.create_node(name, **options)
    executor.add_node(made)
    return made


def test_messages_arrive_in_order_as_objects_of_ones_own(rclpy: Any, executor: Any) -> None:
    String = classes("std_msgs/msg/String")
    talker, listener = node(rclpy, executor, "talker"), node(rclpy, executor, "listener", namespace="home")
    heard: list[Any] = []
    listener.create_subscription(String, "/chatter", heard.append, 10)
    publisher = talker.create_publisher(String, "chatter", 10)
    sent = [String(data=str(number)) for number in range(3)]
    for message in sent:
        publisher.publish(message)
    spin_some(executor)
    assert heard == sent and heard[0] is not sent[0]
    assert publisher.get_subscription_count() == 1 and talker.count_subscribers("chatter") == 1
    with pytest.raises(TypeError):
        publisher.publish("text")


def test_the_depth_of_a_subscription_bounds_what_waits(rclpy: Any, executor: Any) -> None:
    from rclpy.event_handler import SubscriptionEventCallbacks

    Int32 = classes("std_msgs/msg/Int32")
    it = node(rclpy, executor)
    heard: list[int] = []
    lost: list[Any] = []
    it.create_subscription(
        Int32,
        "numbers",
        lambda message: heard.append(message.data),
        2,
        event_callbacks=SubscriptionEventCallbacks(message_lost=lost.append),
    )
    publisher = it.create_publisher(Int32, "numbers", 10)
    for number in range(5):
        publisher.publish(Int32(data=number))
    spin_some(executor)
    assert heard == [3, 4] and lost[0].total_count == 3


def test_late_joiners_get_what_is_kept(rclpy: Any, executor: Any) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    Int32 = classes("std_msgs/msg/Int32")
    it = node(rclpy, executor)
    it.create_publisher(Int32, "map", latched).publish(Int32(data=7))
    heard: list[Any] = []
    it.create_subscription(Int32, "map", heard.append, latched)
    it.create_subscription(Int32, "map", heard.append, 1)
    spin_some(executor)
    assert [message.data for message in heard] == [7]


def test_raw_messages_and_their_info(rclpy: Any, executor: Any) -> None:
    from rclpy.serialization import deserialize_message

    Int32 = classes("std_msgs/msg/Int32")
    it = node(rclpy, executor)
    raw: list[bytes] = []
    infos: list[Any] = []
    it.create_subscription(Int32, "a", raw.append, 1, raw=True)
    it.create_subscription(Int32, "a", lambda message, info: infos.append(info), 1)
    it.create_publisher(Int32, "a", 1).publish(Int32(data=5))
    spin_some(executor)
    assert deserialize_message(raw[0], Int32).data == 5
    assert infos[0]["source_timestamp"] <= infos[0]["received_timestamp"]


def test_large_arrays_cross_as_memory(rclpy: Any, executor: Any) -> None:
    Image = classes("sensor_msgs/msg/Image")
    it = node(rclpy, executor)
    heard: list[Any] = []
    it.create_subscription(Image, "image", heard.append, 1)
    pixels = np.arange(640 * 480 * 3, dtype=np.uint8)
    it.create_publisher(Image, "image", 1).publish(Image(height=480, width=640, data=pixels))
    spin_some(executor)
    assert np.array_equal(np.frombuffer(heard[0].data, np.uint8), pixels)


def test_a_service_answers_and_does_not_when_it_fails(rclpy: Any, executor: Any) -> None:
    AddTwoInts = classes("example_interfaces/srv/AddTwoInts")
    it = node(rclpy, executor)

    def add(request: Any, response: Any) -> Any:
        if request.a < 0:
            raise ValueError("negative")
        response.sum = request.a + request.b
        return response

    it.create_service(AddTwoInts, "add", add)
    client = it.create_client(AddTwoInts, "add")
    assert client.wait_for_service(1.0)
    future = client.call_async(AddTwoInts.Request(a=2, b=3))
    executor.spin_until_future_complete(future, 1.0)
    assert future.result().sum == 5
    failing = client.call_async(AddTwoInts.Request(a=-1))
    with pytest.raises(ValueError, match="negative"):
        executor.spin_until_future_complete(failing, 1.0)
    executor.spin_until_future_complete(failing, 1.0)
    assert not failing.done(), "ROS has no way to say that a service failed"


def test_a_call_of_nobody_stays_without_a_response(rclpy: Any, executor: Any) -> None:
    Empty = classes("std_srvs/srv/Empty")
    client = node(rclpy, executor).create_client(Empty, "nobody")
    assert not client.wait_for_service(3.0)
    future = client.call_async(Empty.Request())
    executor.spin_until_future_complete(future, 5.0)
    assert not future.done()


def test_a_coroutine_waits_for_a_service_without_holding_the_executor(rclpy: Any, executor: Any) -> None:
    from rclpy.callback_groups import ReentrantCallbackGroup

    Empty = classes("std_srvs/srv/Empty")
    it = node(rclpy, executor)
    group = ReentrantCallbackGroup()
    it.create_service(Empty, "inner", lambda request, response: response, callback_group=group)
    client = it.create_client(Empty, "inner", callback_group=group)
    done: list[Any] = []

    async def outer() -> None:
        done.append(await client.call_async(Empty.Request()))

    executor.create_task(outer)
    spin_some(executor)
    assert done == [Empty.Response()]


def test_ten_minutes_pass_at_once_and_always_alike(
    rclpy: Any, rclpy_graph: VirtualDomain, executor: Any
) -> None:
    it = node(rclpy, executor)
    calls: list[tuple[str, float]] = []
    it.create_timer(0.1, lambda: calls.append(("fast", round(rclpy_graph.now, 6))))
    it.create_timer(60.0, lambda: calls.append(("slow", round(rclpy_graph.now, 6))))
    spin_some(executor, 600.05)
    assert len([name for name, _ in calls if name == "fast"]) == 6000
    assert [at for name, at in calls if name == "slow"] == [60.0 * number for number in range(1, 11)]
    assert rclpy_graph.now == pytest.approx(600.05)


def test_a_rate_sleeps_in_a_thread_beside_the_executor(rclpy: Any, rclpy_graph: VirtualDomain) -> None:
    executor = rclpy.executors.SingleThreadedExecutor()
    it = node(rclpy, executor)
    rate = it.create_rate(2.0)
    ticks: list[float] = []
    done = rclpy.task.Future()

    def sleep() -> None:
        for _ in range(3):
            rate.sleep()
            ticks.append(rclpy_graph.now)
        done.set_result(None)

    thread = threading.Thread(target=sleep)
    thread.start()
    executor.spin_until_future_complete(done)
    thread.join(20)
    assert len(ticks) == 3 and ticks == sorted(ticks)
    executor.shutdown()


def test_a_period_that_ends_while_nobody_sleeps_is_not_lost(rclpy: Any, rclpy_graph: VirtualDomain) -> None:
    executor = rclpy.executors.SingleThreadedExecutor()
    it = node(rclpy, executor)
    rate = it.create_rate(2.0)
    executor.spin_until_future_complete(rclpy.task.Future(), timeout_sec=1.2)
    rate.sleep()  # Nothing spins any more: this would wait for ever.
    rate.destroy()
    with pytest.raises(RuntimeError, match="destroyed"):
        rate.sleep()
    executor.shutdown()


def test_timers_can_be_cancelled_and_reset(rclpy: Any, executor: Any) -> None:
    calls: list[int] = []
    timer = node(rclpy, executor).create_timer(1.0, lambda: calls.append(1))
    spin_some(executor, 2.5)
    timer.cancel()
    spin_some(executor, 5.0)
    assert len(calls) == 2 and timer.is_canceled()
    timer.reset()
    assert timer.time_until_next_call() == 1_000_000_000
    spin_some(executor, 1.5)
    assert len(calls) == 3


def test_sim_time_follows_the_clock_topic(rclpy: Any, rclpy_graph: VirtualDomain, executor: Any) -> None:
    from rclpy.parameter import Parameter

    it = node(rclpy, executor, parameter_overrides=[Parameter("use_sim_time", value=True)])
    assert it.get_clock().ros_time_is_active and it.get_clock().now().nanoseconds == 0
    rclpy_graph.advance(5)
    spin_some(executor, 0.5)
    assert it.get_clock().now().nanoseconds >= 1_700_000_005_000_000_000


def test_parameters_are_declared_checked_and_announced(rclpy: Any, executor: Any) -> None:
    from rclpy import exceptions
    from rclpy.parameter import Parameter

    ParameterEvent = classes("rcl_interfaces/msg/ParameterEvent")
    ParameterDescriptor = classes("rcl_interfaces/msg/ParameterDescriptor")
    IntegerRange = classes("rcl_interfaces/msg/IntegerRange")
    it = node(rclpy, executor)
    events: list[Any] = []
    it.create_subscription(ParameterEvent, "/parameter_events", events.append, 10)
    span = [IntegerRange(from_value=0, to_value=10, step=5)]
    it.declare_parameter("speed", 5, ParameterDescriptor(integer_range=span))
    assert it.get_parameter("speed").value == 5
    assert it.set_parameters([Parameter("speed", value=10)])[0].successful
    for value, reason in ((7, "not a valid step"), (11, "out of range"), ("fast", "Wrong parameter type")):
        refused = it.set_parameters([Parameter("speed", value=value)])[0]
        assert not refused.successful and reason in refused.reason
    with pytest.raises(exceptions.ParameterNotDeclaredException):
        it.get_parameter("nothing")
    with pytest.raises(exceptions.ParameterAlreadyDeclaredException):
        it.declare_parameter("speed", 1)
    spin_some(executor)
    assert [each.new_parameters[0].name for each in events if each.new_parameters] == ["speed"]
    assert events[-1].changed_parameters[0].value.integer_value == 10


def test_parameters_are_served_to_other_nodes(rclpy: Any, executor: Any) -> None:
    from rclpy.parameter import Parameter
    from rclpy.parameter_client import AsyncParameterClient

    served = node(rclpy, executor, "served")
    served.declare_parameter("a.b", 1.5)
    client = AsyncParameterClient(node(rclpy, executor, "asking"), "served")
    assert client.wait_for_services(1.0)
    setting = client.set_parameters([Parameter("a.b", value=2.5)])
    executor.spin_until_future_complete(setting, 1.0)
    assert setting.result().results[0].successful and served.get_parameter("a.b").value == 2.5
    listing = client.list_parameters(["a"], 0)
    executor.spin_until_future_complete(listing, 1.0)
    assert listing.result().result.names == ["a.b"]


def test_logs_go_to_the_console_and_to_rosout(
    rclpy: Any, executor: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    Log = classes("rcl_interfaces/msg/Log")
    it = node(rclpy, executor, "logger", namespace="home")
    lines: list[Any] = []
    it.create_subscription(Log, "/rosout", lines.append, 10)
    for _ in range(3):
        it.get_logger().warning("watch out", once=True)
    it.get_logger().debug("not shown")
    it.get_logger().get_child("arm").error("broken")
    spin_some(executor)
    assert [(line.name, line.msg, line.level) for line in lines] == [
        ("home.logger", "watch out", 30),
        ("home.logger.arm", "broken", 40),
    ]
    shown = capsys.readouterr().err.splitlines()
    assert shown[0].startswith("[WARN] [1700000000.") and shown[0].endswith("[home.logger]: watch out")


def test_an_action_from_goal_to_result(rclpy: Any, executor: Any) -> None:
    from rclpy.action import ActionClient, ActionServer, CancelResponse

    Fibonacci = classes("example_interfaces/action/Fibonacci")
    it = node(rclpy, executor)

    def execute(goal: Any) -> Any:
        feedback = Fibonacci.Feedback(sequence=[0, 1])
        for _ in range(goal.request.order):
            feedback.sequence.append(feedback.sequence[-1] + feedback.sequence[-2])
            goal.publish_feedback(feedback)
        goal.succeed()
        return Fibonacci.Result(sequence=feedback.sequence)

    server = ActionServer(
        it, Fibonacci, "fibonacci", execute, cancel_callback=lambda goal: CancelResponse.ACCEPT
    )
    client = ActionClient(it, Fibonacci, "fibonacci")
    assert client.wait_for_server(1.0)
    told: list[Any] = []
    sending = client.send_goal_async(Fibonacci.Goal(order=3), told.append)
    executor.spin_until_future_complete(sending, 1.0)
    handle = sending.result()
    assert handle.accepted
    getting = handle.get_result_async()
    executor.spin_until_future_complete(getting, 1.0)
    assert list(getting.result().result.sequence) == [0, 1, 1, 2, 3] and getting.result().status == 4
    spin_some(executor)
    assert [list(each.feedback.sequence)[-1] for each in told] == [1, 2, 3]
    server.destroy()
    assert not client.wait_for_server(0.5)


def test_goals_of_the_graph_reach_the_server_and_the_other_way_round(
    rclpy: Any, rclpy_graph: VirtualDomain, executor: Any
) -> None:
    from rclpy.action import ActionServer

    from rwt_graph.api import GoalEvents
    from rwt_interfaces.payload import Payload

    Fibonacci = classes("example_interfaces/action/Fibonacci")
    it = node(rclpy, executor)

    def execute(goal: Any) -> Any:
        goal.publish_feedback(Fibonacci.Feedback(sequence=[1]))
        goal.succeed()
        return Fibonacci.Result(sequence=[goal.request.order])

    ActionServer(it, Fibonacci, "/fibonacci", execute)
    kind = rclpy_graph.graph.registry.action("example_interfaces/Fibonacci")
    heard: list[object] = []
    events = GoalEvents(
        lambda status, outcome: heard.append(
            (status.name, outcome.plain() if isinstance(outcome, Payload) else outcome)
        ),
        lambda feedback: heard.append(feedback.plain()),
        lambda: heard.append("accepted"),
    )
    participant = rclpy_graph.graph.participant("/browser")
    participant.send_goal("/fibonacci", Payload.from_value(kind.goal, {"order": 8}), events)
    spin_some(executor)
    assert heard == ["accepted", {"sequence": [1]}, ("SUCCEEDED", {"sequence": [8]})]


def test_a_client_sends_goals_to_a_server_that_is_no_rclpy_node(
    rclpy: Any, rclpy_graph: VirtualDomain, executor: Any
) -> None:
    from rclpy.action import ActionClient

    from rwt_graph.api import ServerGoal
    from rwt_interfaces.payload import Payload
    from rwt_participant.goals import GoalStatus

    Fibonacci = classes("example_interfaces/action/Fibonacci")
    kind = rclpy_graph.graph.registry.action("example_interfaces/Fibonacci")

    def on_goal(goal: ServerGoal) -> None:
        goal.accept()
        goal.feedback(Payload.from_value(kind.feedback, {"sequence": [3]}))
        goal.finish(GoalStatus.SUCCEEDED, Payload.from_value(kind.result, {"sequence": [4]}))

    rclpy_graph.graph.participant("/robot").advertise_action("/fibonacci", kind, on_goal)
    client = ActionClient(node(rclpy, executor), Fibonacci, "fibonacci")
    told: list[Any] = []
    sending = client.send_goal_async(Fibonacci.Goal(order=1), told.append)
    executor.spin_until_future_complete(sending, 1.0)
    getting = sending.result().get_result_async()
    executor.spin_until_future_complete(getting, 1.0)
    assert list(getting.result().result.sequence) == [4] and list(told[0].feedback.sequence) == [3]


def test_lifecycle_nodes_change_their_state_from_outside(rclpy: Any, executor: Any) -> None:
    from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

    Int32 = classes("std_msgs/msg/Int32")
    ChangeState = classes("lifecycle_msgs/srv/ChangeState")
    Transition = classes("lifecycle_msgs/msg/Transition")
    heard: list[int] = []

    class Lamp(LifecycleNode):  # type: ignore[misc]  # the base class is made at run time
        def on_configure(self, state: Any) -> Any:
            self.lamp = self.create_lifecycle_publisher(Int32, "lamp", 10)
            return TransitionCallbackReturn.SUCCESS

    lamp = Lamp("lamp")
    executor.add_node(lamp)
    lamp.create_subscription(Int32, "lamp", lambda message: heard.append(message.data), 10)
    client = lamp.create_client(ChangeState, "lamp/change_state")
    for label in ("configure", "activate"):
        future = client.call_async(ChangeState.Request(transition=Transition(label=label)))
        executor.spin_until_future_complete(future, 1.0)
        assert future.result().success
        lamp.lamp.publish(Int32(data=len(label)))
    spin_some(executor)
    assert heard == [len("activate")]
    with pytest.raises(Exception, match=r"not possible in state active"):
        lamp.trigger_configure()


def test_remapping_and_parameters_of_the_command_line(rclpy: Any, executor: Any) -> None:
    it = node(
        rclpy,
        executor,
        "given",
        cli_args=[
            "-r",
            "__node:=named",
            "-r",
            "__ns:=/home",
            "-r",
            "a:=b",
            "-p",
            "rate:=2.5",
            "-p",
            "other:x:=1",
        ],
    )
    assert it.get_fully_qualified_name() == "/home/named"
    assert (
        it.resolve_topic_name("a") == "/home/b" and it.resolve_topic_name("a", only_expand=True) == "/home/a"
    )
    assert it.declare_parameter("rate", 1.0).value == 2.5
    assert it.declare_parameter("x", 7).value == 7


def test_what_a_node_knows_of_the_graph(rclpy: Any, executor: Any) -> None:
    Int32 = classes("std_msgs/msg/Int32")
    it = node(rclpy, executor, "one", namespace="/home")
    it.create_publisher(Int32, "numbers", 5)
    assert ("/home/numbers", ["std_msgs/msg/Int32"]) in it.get_topic_names_and_types()
    assert ("one", "/home") in it.get_node_names_and_namespaces()
    info = it.get_publishers_info_by_topic("numbers")[0]
    assert (info.node_name, info.node_namespace, info.qos_profile.depth) == ("one", "/home", 0)
    assert str(info.topic_type_hash).startswith("RIHS01_")
    assert (
        "/home/one/get_parameters",
        ["rcl_interfaces/srv/GetParameters"],
    ) in it.get_service_names_and_types()
    it.destroy_node()
    assert ("one", "/home") not in node(rclpy, executor, "two").get_node_names_and_namespaces()


def test_a_destroyed_entity_says_so(rclpy: Any, executor: Any) -> None:
    from rclpy.exceptions import InvalidHandle

    Int32 = classes("std_msgs/msg/Int32")
    it = node(rclpy, executor)
    publisher = it.create_publisher(Int32, "a", 1)
    assert it.destroy_publisher(publisher) and not it.destroy_publisher(publisher)
    with pytest.raises(InvalidHandle):
        publisher.publish(Int32())


def test_several_threads_and_groups(rclpy: Any) -> None:
    from rclpy.callback_groups import MutuallyExclusiveCallbackGroup

    executor = rclpy.executors.MultiThreadedExecutor(num_threads=3)
    it = node(rclpy, executor)
    exclusive = MutuallyExclusiveCallbackGroup()
    running: list[int] = []
    most: list[int] = []
    done = rclpy.task.Future()

    def work() -> None:
        running.append(1)
        most.append(len(running))
        running.pop()
        if len(most) >= 20 and not done.done():
            done.set_result(None)

    for _ in range(3):
        it.create_timer(0.1, work, callback_group=exclusive)
    executor.spin_until_future_complete(done, 60.0)
    executor.shutdown()
    assert done.done() and set(most) == {1}


def test_an_exception_in_a_callback_ends_the_spin(rclpy: Any, executor: Any) -> None:
    def fail() -> None:
        raise RuntimeError("on purpose")

    node(rclpy, executor).create_timer(0.1, fail)
    with pytest.raises(RuntimeError, match="on purpose"):
        spin_some(executor)


def test_the_wait_for_one_message(rclpy: Any, executor: Any) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from rclpy.wait_for_message import wait_for_message

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    Int32 = classes("std_msgs/msg/Int32")
    it = node(rclpy, executor)
    assert wait_for_message(Int32, it, "a", time_to_wait=2) == (False, None)
    it.create_publisher(Int32, "a", latched).publish(Int32(data=3))
    assert wait_for_message(Int32, it, "a", qos_profile=latched) == (True, Int32(data=3))


def test_a_goal_is_charged_to_who_sent_it_until_it_has_ended(
    rclpy: Any, rclpy_graph: VirtualDomain, executor: Any
) -> None:
    from rclpy.action import ActionServer

    from rwt_graph.accounts import WORK_ACCOUNT
    from rwt_interfaces.payload import Payload

    held: list[str] = []

    def hold(size: int) -> Any:
        held.append("held")
        return lambda: held.append("released")

    Fibonacci = classes("example_interfaces/action/Fibonacci")
    it = node(rclpy, executor)
    goals: list[Any] = []
    ActionServer(it, Fibonacci, "/f", lambda goal: None, handle_accepted_callback=goals.append)
    graph = rclpy_graph.graph
    browser = graph.participant("/browser")

    def call(short: str, name: str, request: dict[str, Any]) -> list[str]:
        before = WORK_ACCOUNT.set(hold)
        try:
            kind = graph.registry.service(name)
            payload = Payload.from_value(kind.request, request)
            browser.call_service(f"/f/_action/{short}", payload, lambda outcome: held.append("answered"))
        finally:
            WORK_ACCOUNT.reset(before)
        spin_some(executor)
        said, held[:] = list(held), []
        return said

    goal_id = {"uuid": list(range(16))}
    sent = {"goal_id": goal_id, "goal": {"order": 3}}
    assert call("send_goal", "example_interfaces/Fibonacci_SendGoal", sent) == ["held", "answered"]
    assert call("cancel_goal", "action_msgs/CancelGoal", {}) == ["held", "answered", "released"]
    asked = call("get_result", "example_interfaces/Fibonacci_GetResult", {"goal_id": goal_id})
    assert asked == ["held"]
    goals[0].execute(lambda goal: (goal.succeed(), Fibonacci.Result())[1])
    spin_some(executor)
    assert sorted(held) == ["answered", "released", "released"]


def test_pixels_are_shared_from_publisher_to_subscription(rclpy: Any, executor: Any) -> None:
    import numpy as np

    import rwt_rclpy

    Image = classes("sensor_msgs/msg/Image")
    it = node(rclpy, executor)
    heard: list[Any] = []
    publisher = it.create_publisher(Image, "/image", 1)
    it.create_subscription(Image, "/image", heard.append, 1)
    pixels = np.arange(640 * 480 * 3, dtype=np.uint8).tobytes()
    sent = Image(height=480, width=640, step=1920, encoding="rgb8", data=pixels)
    publisher.publish(sent)
    spin_some(executor)
    (received,) = heard
    seen = rwt_rclpy.octets_of(received, "data")
    assert np.shares_memory(seen, np.frombuffer(pixels, np.uint8)) and not seen.flags.writeable
    # Who asks for the field gets rosidl's array, which is its own.
    received.data[0] = 77
    assert pixels[0] == 0 and sent.data[0] == 0
    assert rwt_rclpy.octets_of(received, "data")[0] == 77 and received != sent
    received.data[0] = 0
    assert received == sent
    with pytest.raises(TypeError, match="no field 'encoding' of type uint8"):
        rwt_rclpy.octets_of(received, "encoding")
