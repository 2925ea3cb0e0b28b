"""Behaviour and expectations of a scripted robot."""

from __future__ import annotations

import anyio
import pytest

from rwt.extensions.testing import BlockingWait, ObservedGraph, ScriptedRobot, ScriptError
from rwt.extensions.testing.virtual_time import advance, settle
from rwt_graph import Node, SimulatedClock
from rwt_participant.errors import CallTimeout, GoalRejected, ServiceFailed
from rwt_participant.goals import GoalStatus

ADD = "example_interfaces/AddTwoInts"
FIBONACCI = "example_interfaces/Fibonacci"
pytestmark = pytest.mark.anyio


async def test_answers_in_turn_and_the_last_for_ever(graph: ObservedGraph) -> None:
    async with graph:
        robot, caller = ScriptedRobot(graph), Node(graph, "caller")
        service = robot.on_service("/add", ADD).returns({"sum": 1}, {"sum": 2})
        sums = [(await caller.call("/add", {"a": n})).sum for n in range(3)]
        assert sums == [1, 2, 2]
        assert [request.a for request in service.requests] == [0, 1, 2]
        assert len(await robot.until_called("/add", {"a": 1})) == 1


async def test_cases_come_before_the_answer_to_everything_else(graph: ObservedGraph) -> None:
    async with graph:
        robot, caller = ScriptedRobot(graph), Node(graph, "caller")
        service = robot.on_service("/add", ADD).returns({"sum": -1})
        service.when({"a": 2}).returns({"sum": 2}).when(lambda request: request.b > 9).raises("too much")
        assert (await caller.call("/add", {"a": 1})).sum == -1
        assert (await caller.call("/add", {"a": 2})).sum == 2
        with pytest.raises(ServiceFailed, match="too much"):
            await caller.call("/add", {"b": 10})
        service.returns({"sum": -2})
        assert (await caller.call("/add", {"a": 1})).sum == -2
        assert (await caller.call("/add", {"a": 2})).sum == 2


async def test_a_function_or_a_coroutine_answers(graph: ObservedGraph) -> None:
    async with graph:
        robot, caller = ScriptedRobot(graph), Node(graph, "caller")
        robot.on_service("/add", ADD).calls(lambda request: {"sum": request.a + request.b})
        assert (await caller.call("/add", {"a": 1, "b": 2})).sum == 3

        async def add(request: object) -> dict[str, object]:
            await anyio.lowlevel.checkpoint()
            return {"sum": 7}

        robot.on_service("/add", ADD).calls(add)
        assert (await caller.call("/add")).sum == 7


async def test_slow_and_silent_services_follow_the_robots_clock(
    graph: ObservedGraph, clock: SimulatedClock
) -> None:
    async with graph:
        robot, caller = ScriptedRobot(graph), Node(graph, "caller")
        robot.on_service("/slow", ADD).returns({"sum": 1}, after=3.0)
        robot.on_service("/silent", ADD).never_answers()
        outcomes: list[object] = []

        async def call(service: str) -> None:
            try:
                outcomes.append((await caller.call(service, timeout=5.0)).sum)
            except CallTimeout:
                outcomes.append("timeout")

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(call, "/slow")
            tasks.start_soon(call, "/silent")
            await advance(clock, 2.9)
            assert outcomes == []
            await advance(clock, 0.2)
            assert outcomes == [1]
            await advance(clock, 2.0)
            assert outcomes == [1, "timeout"]


async def test_a_service_without_a_script_says_so(graph: ObservedGraph) -> None:
    async with graph:
        robot, caller = ScriptedRobot(graph), Node(graph, "caller")
        robot.on_service("/add", ADD)
        with pytest.raises(ServiceFailed, match="nothing was scripted"):
            await caller.call("/add")
        robot.on_service("/add", ADD).when({"a": 1}).returns({"sum": 1})
        with pytest.raises(ServiceFailed, match="none of its cases"):
            await caller.call("/add")


def test_what_does_not_fit_is_refused_where_it_is_written(graph: ObservedGraph) -> None:
    robot = ScriptedRobot(graph)
    with pytest.raises(ScriptError, match=r"/add .*: sum: expected int64"):
        robot.on_service("/add", ADD).returns({"sum": "five"})
    with pytest.raises(ScriptError, match="did you mean `a`"):
        robot.on_service("/add", ADD).when({"aa": 1})
    with pytest.raises(ScriptError, match=r"/x .*data: expected"):
        robot.publishes("/x", "std_msgs/Int32", {"data": "1"})
    with pytest.raises(ScriptError, match=r"sequence"):
        robot.on_action("/fib", FIBONACCI).feedback({"sequence": "no"})
    with pytest.raises(ScriptError, match="need a `rate`"):
        robot.publishes("/y", "std_msgs/Int32", messages=[{"data": 1}])
    with pytest.raises(ScriptError, match="greater than 0"):
        robot.publishes("/z", "std_msgs/Int32", rate=0)


async def test_a_rate_that_nothing_can_keep_up_with_leaves_others_their_turn() -> None:
    async with ObservedGraph() as graph:
        robot, caller = ScriptedRobot(graph), Node(graph, "caller")
        robot.on_service("/add", ADD).returns({"sum": 1})
        topic = robot.publishes("/fast", "std_msgs/Int32", rate=1e12)
        with anyio.fail_after(20):
            assert (await caller.call("/add")).sum == 1
        topic.stop()


async def test_messages_come_at_their_rate_and_again(graph: ObservedGraph, clock: SimulatedClock) -> None:
    async with graph:
        robot, listener = ScriptedRobot(graph), Node(graph, "listener")
        seen: list[tuple[float, int]] = []
        listener.subscribe("/count", lambda m: seen.append((clock.monotonic(), m.data)), "std_msgs/Int32")
        topic = robot.publishes("/count", "std_msgs/Int32", messages=[{"data": 1}, {"data": 2}], rate=4)
        await advance(clock, 0.75)
        assert seen == [(0.0, 1), (0.25, 2), (0.5, 1), (0.75, 2)]
        topic.stop()
        await advance(clock, 1.0)
        assert len(seen) == 4


async def test_recorded_messages_keep_their_times(graph: ObservedGraph, clock: SimulatedClock) -> None:
    async with graph:
        robot, listener = ScriptedRobot(graph), Node(graph, "listener")
        seen: list[tuple[float, int]] = []
        listener.subscribe("/count", lambda m: seen.append((clock.monotonic(), m.data)), "std_msgs/Int32")
        topic = robot.publishes("/count", "std_msgs/Int32")
        topic.play([(0.5, {"data": 1}), (2.0, {"data": 2})])
        await advance(clock, 10.0)
        assert seen == [(0.5, 1), (2.0, 2)]
        seen.clear()
        topic.play([(0.0, {"data": 1}), (1.0, {"data": 2})], repeat=True, length=2.0)
        await advance(clock, 3.0)
        assert seen == [(10.0, 1), (11.0, 2), (12.0, 1), (13.0, 2)]
        with pytest.raises(ScriptError, match="go back"):
            topic.play([(1.0, {}), (0.5, {})])
        with pytest.raises(ScriptError, match="length"):
            topic.play([(0.0, {})], repeat=True)


async def test_a_goal_gets_its_feedback_and_its_end(graph: ObservedGraph, clock: SimulatedClock) -> None:
    async with graph:
        robot, client = ScriptedRobot(graph), Node(graph, "client")
        action = robot.on_action("/fib", FIBONACCI)
        action.feedback({"sequence": [0]}, {"sequence": [0, 1]}, every=1.0).succeeds({"sequence": [0, 1, 1]})
        feedback: list[tuple[float, int]] = []
        goal = await client.send_goal(
            "/fib",
            {"order": 3},
            on_feedback=lambda message: feedback.append((clock.monotonic(), len(message.sequence))),
        )
        await advance(clock, 5.0)
        assert feedback == [(1.0, 1), (2.0, 2)]
        status, result = await goal.result()
        assert (status, list(result.sequence)) == (GoalStatus.SUCCEEDED, [0, 1, 1])
        assert [each.order for each in action.goals] == [3]
        assert (await robot.until_goal("/fib", {"order": 3}))[0].order == 3


async def test_goals_abort_are_rejected_canceled_or_stubborn(
    graph: ObservedGraph, clock: SimulatedClock
) -> None:
    async with graph:
        robot, client = ScriptedRobot(graph), Node(graph, "client")
        action = robot.on_action("/fib", FIBONACCI).aborts({"sequence": [9]}, "stuck")
        status, result = await (await client.send_goal("/fib")).result()
        assert (status, list(result.sequence)) == (GoalStatus.ABORTED, [9])

        action.rejects("not today")
        with pytest.raises(GoalRejected, match="not today"):
            await client.send_goal("/fib")

        action.never_ends()
        goal = await client.send_goal("/fib")
        await settle()
        goal.cancel()
        assert (await goal.result())[0] is GoalStatus.CANCELED

        action.feedback({"sequence": [1]}, every=2.0).succeeds().ignores_cancel()
        goal = await client.send_goal("/fib")
        await settle()
        goal.cancel()
        await advance(clock, 2.0)
        assert (await goal.result())[0] is GoalStatus.SUCCEEDED


async def test_a_cancel_ends_the_wait_for_feedback(graph: ObservedGraph, clock: SimulatedClock) -> None:
    async with graph:
        robot, client = ScriptedRobot(graph), Node(graph, "client")
        robot.on_action("/fib", FIBONACCI).feedback({"sequence": [1]}, every=60.0)
        goal = await client.send_goal("/fib")
        await settle()
        goal.cancel()
        assert (await goal.result())[0] is GoalStatus.CANCELED
        assert clock.monotonic() == 0.0


@pytest.mark.parametrize("graph", ["jazzy", "noetic"], indirect=True)
async def test_parameters_are_those_of_any_node(graph: ObservedGraph) -> None:
    async with graph:
        robot, other = ScriptedRobot(graph), Node(graph, "other")
        robot.has_parameter("max_speed", 0.5)
        name = "/robot:max_speed" if graph.distro.parameters_belong_to_nodes else "/robot/max_speed"
        assert await other.params.get(name) == 0.5
        await other.params.set(name, 0.7)
        assert robot.parameters.get("max_speed") == 0.7
        robot.has_parameter("max_speed", 0.5)
        assert await other.params.get(name) == 0.5


def test_what_came_before_counts_and_what_the_robot_says_does_not(graph: ObservedGraph) -> None:
    robot, app = ScriptedRobot(graph), Node(graph, "app")
    robot.publishes("/cmd_vel", "geometry_msgs/Twist", {"linear": {"x": 9.0}})
    commands = app.advertise("/cmd_vel", "geometry_msgs/Twist")
    commands.publish({"linear": {"x": 0.5}})
    commands.publish({"linear": {"x": 0.6}})
    assert [each.linear.x for each in robot.expect_published("/cmd_vel", count=2)] == [0.5, 0.6]
    assert [each.linear.x for each in robot.expect_published("cmd_vel", {"linear": {"x": 0.6}})] == [0.6]
    robot.expect_published("/other", count=0, within=0.0)
    robot.forget()
    robot.expect_published("/cmd_vel", count=0, within=0.0)


def test_an_expectation_that_fails_shows_what_came_instead(graph: ObservedGraph) -> None:
    robot, app = ScriptedRobot(graph), Node(graph, "app")
    app.advertise("/cmd_vel", "geometry_msgs/Twist").publish({"linear": {"x": 0.2}})
    app.advertise("/speak", "std_msgs/String").publish({"data": "hello"})
    with pytest.raises(AssertionError) as failed:
        robot.expect_published("/cmd_vel", {"linear": {"x": 0.5}}, within=0.0)
    assert str(failed.value).splitlines() == [
        "expected a message on /cmd_vel matching {'linear': {'x': 0.5}}, at least 1 within 0 s, and got 0",
        "Published on /cmd_vel:",
        '  /app: {"linear":{"x":0.2,"y":0.0,"z":0.0},"angular":{"x":0.0,"y":0.0,"z":0.0}}',
        "    linear.x is 0.2, not 0.5",
    ]
    with pytest.raises(AssertionError) as failed:
        robot.expect_published("/cmd_vell", within=0.0)
    assert str(failed.value).splitlines()[1] == "Published instead: /cmd_vel (1), /speak (1)"
    with pytest.raises(AssertionError, match="exactly 2 within 0 s, and got 1"):
        robot.expect_published("/cmd_vel", count=2, within=0.0)
    with pytest.raises(AssertionError, match="exactly 0 within 5 s, and got 1"):
        robot.expect_published("/cmd_vel", count=0, within=5.0)
    with pytest.raises(AssertionError, match=r"a call of /add, .* got 0\nCalled instead: nothing at all"):
        robot.expect_called("/add", within=0.0)
    with pytest.raises(AssertionError, match="a goal of /fib"):
        robot.expect_goal("/fib", within=0.0)


async def test_blocking_in_a_coroutine_is_refused_and_the_other_way_named(graph: ObservedGraph) -> None:
    async with graph:
        robot = ScriptedRobot(graph)
        with pytest.raises(BlockingWait, match="until_published"):
            robot.expect_published("/cmd_vel")
        with pytest.raises(BlockingWait, match="until_subscribed"):
            robot.publishes("/x", "std_msgs/Int32").wait_for_subscriber()
        with pytest.raises(AssertionError, match="/x has no subscriber within"):
            await robot.publishes("/x", "std_msgs/Int32").until_subscribed(within=0.0)


async def test_a_closed_robot_is_gone_with_all_it_did(graph: ObservedGraph, clock: SimulatedClock) -> None:
    async with graph:
        robot, listener = ScriptedRobot(graph), Node(graph, "listener")
        seen: list[int] = []
        listener.subscribe("/count", lambda message: seen.append(message.data), "std_msgs/Int32")
        robot.publishes("/count", "std_msgs/Int32", {"data": 1}, rate=10)
        robot.on_service("/add", ADD).returns({"sum": 1})
        robot.close()
        await advance(clock, 1.0)
        assert seen == [1]
        assert graph.service("/add") is None
        count = graph.topic("/count")
        assert count is not None and count.publishers == ()
