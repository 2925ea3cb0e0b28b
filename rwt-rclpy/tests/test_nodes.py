"""Nodes in one process, in virtual time: what `differential` and the contract of the graphs do not test."""

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
