from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

from rwt_graph.api import ServerGoal
from rwt_interfaces.payload import Payload
from rwt_participant.goals import GoalStatus
from tests.contract.graph.harness import GoalDiary
from tests.waiting import until

if TYPE_CHECKING:
    from rwt.extensions.ros2 import Ros2Graph
    from rwt_graph.api import ClientGoal, Participant
    from tests.statements import Program

pytestmark = pytest.mark.anyio

_SERVER = """
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from test_msgs.action import Fibonacci
import time
ended = []
def accept(goal):
    return GoalResponse.REJECT if goal.order < 0 else GoalResponse.ACCEPT
def execute(handle):
    order, sequence = handle.request.order, []
    # 1000: until it is cancelled; 500: aborted.
    for number in range(3 if order == 500 else order):
        if handle.is_cancel_requested:
            handle.canceled()
            ended.append('canceled')
            return Fibonacci.Result(sequence=sequence)
        sequence.append(number)
        handle.publish_feedback(Fibonacci.Feedback(sequence=sequence))
        if order == 1000: time.sleep(0.01)
    handle.abort() if order == 500 else handle.succeed()
    return Fibonacci.Result(sequence=sequence)
server = ActionServer(node, Fibonacci, '/fib', execute, goal_callback=accept,
    cancel_callback=lambda _: CancelResponse.ACCEPT, callback_group=ReentrantCallbackGroup())
"""

_CLIENT = """
from rclpy.action import ActionClient
from test_msgs.action import Fibonacci
client = ActionClient(node, Fibonacci, '/ours')
feedback, goals, results = [], [], []
def send(order):
    future = client.send_goal_async(
        Fibonacci.Goal(order=order), lambda message: feedback.append(list(message.feedback.sequence)))
    future.add_done_callback(answered)
def answered(future):
    goals.append(future.result())
    if goals[-1].accepted:
        goals[-1].get_result_async().add_done_callback(
            lambda done: results.append([done.result().status, list(done.result().result.sequence)]))
"""


def send(graph: Ros2Graph, client: Participant, order: int) -> tuple[ClientGoal, GoalDiary]:
    diary = GoalDiary()
    goal = Payload.from_value(graph.registry.action("test_msgs/Fibonacci").goal, {"order": order})
    return client.send_goal("/fib", goal, diary.events), diary


def prefixes(length: int) -> list[list[int]]:
    return [list(range(end)) for end in range(1, length + 1)]


def is_over(*diaries: GoalDiary) -> bool:
    """Return True if all goals have ended."""
    return all(isinstance(last, tuple) for diary in diaries for last in diary.heard[-1:] or [""])


def feedback_of(diary: GoalDiary) -> list[list[int]]:
    return [each for each in diary.heard if isinstance(each, list)]


async def test_goals_of_a_server_of_ros_2(graph: Ros2Graph, program: Program) -> None:
    program.run(_SERVER)
    ours = graph.participant("/ours")
    await until(lambda: graph.action("/fib"))
    for _ in range(3):
        _, diary = send(graph, ours, 5)
        await until(partial(is_over, diary))
        assert diary.heard[-1] == (GoalStatus.SUCCEEDED, [0, 1, 2, 3, 4])
        assert feedback_of(diary) == prefixes(5)
        assert diary.heard.count("accepted") == 1
    _, diary = send(graph, ours, 500)
    await until(lambda: is_over(diary))
    assert diary.heard[-1] == (GoalStatus.ABORTED, [0, 1, 2])
    _, rejected = send(graph, ours, -1)
    await until(lambda: is_over(rejected))
    assert rejected.heard[-1][1].startswith("GoalRejected: ")


async def test_a_goal_of_a_server_of_ros_2_is_cancelled(graph: Ros2Graph, program: Program) -> None:
    program.run(_SERVER)
    ours = graph.participant("/ours")
    await until(lambda: graph.action("/fib"))
    goal, diary = send(graph, ours, 1000)
    await until(lambda: feedback_of(diary))
    goal.cancel()
    await until(lambda: is_over(diary))
    status, sequence = diary.heard[-1]
    last = feedback_of(diary)[-1]  # DDS keeps no order between feedback and result, which may overtake it.
    assert (status, sequence[: len(last)]) == (GoalStatus.CANCELED, last)
    others = [send(graph, ours, 1000)[1] for _ in range(3)]
    await until(lambda: all(map(feedback_of, others)))
    for _ in ours.cancel_every_goal("/fib"):
        pass
    await until(lambda: is_over(*others))
    assert program.run("result = ended") == ["canceled"] * 4


async def test_a_goal_ends_when_its_server_leaves(graph: Ros2Graph, program: Program) -> None:
    program.run(_SERVER)
    ours = graph.participant("/ours")
    await until(lambda: graph.action("/fib"))
    _, diary = send(graph, ours, 1000)
    await until(lambda: feedback_of(diary))
    program.run("server.destroy()")
    await until(lambda: is_over(diary))
    assert diary.heard[-1] == (GoalStatus.ABORTED, "ProviderGone: Action /fib was unadvertised")
    await until(lambda: graph.action("/fib") is None)
    program.kill()  # Its goal is still running.


async def test_an_action_is_known_with_all_its_services(graph: Ros2Graph, program: Program) -> None:
    program.run(
        """
from test_msgs.action import Fibonacci
from action_msgs.srv import CancelGoal
impl = Fibonacci.Impl
node.create_service(impl.SendGoalService, '/part/_action/send_goal', lambda request, response: response)
node.create_service(impl.GetResultService, '/part/_action/get_result', lambda request, response: response)
"""
    )
    await until(lambda: graph.service("/part/_action/send_goal"))
    await until(lambda: graph.service("/part/_action/get_result"))
    assert graph.action("/part") is None
    assert "/part" not in [each.name for each in graph.actions()]
    program.run("node.create_service(CancelGoal, '/part/_action/cancel_goal', lambda _, response: response)")
    await until(lambda: graph.action("/part"))
    assert "/part" in [each.name for each in graph.actions()]


async def test_many_goals_at_once(graph: Ros2Graph, program: Program) -> None:
    program.run(_SERVER)
    ours = graph.participant("/ours")
    await until(lambda: graph.action("/fib"))
    diaries = [send(graph, ours, 2)[1] for _ in range(100)]
    await until(lambda: is_over(*diaries))
    assert [each.heard[-1] for each in diaries] == [(GoalStatus.SUCCEEDED, [0, 1])] * 100


async def test_a_client_of_ros_2_sends_goals(graph: Ros2Graph, program: Program) -> None:
    type = graph.registry.action("test_msgs/Fibonacci")
    goals: list[ServerGoal] = []
    cancelled: list[str] = []

    def take(goal: ServerGoal) -> None:
        message: Any = goal.goal.value()
        if message.order < 0:
            goal.reject("negative")
            return
        goal.accept()
        goal.on_cancel = lambda: cancelled.append(goal.id)
        goals.append(goal)

    def sequence(numbers: list[int], part: Any) -> Payload:
        return Payload.from_value(part, {"sequence": numbers})

    async def shows(expression: str, value: object) -> None:
        await until(lambda: program.run(f"result = {expression}") == value)

    program.run(_CLIENT)
    server = graph.participant("/arm").advertise_action("/ours", type, take)
    await until(lambda: program.run("result = client.server_is_ready()"))
    endings = [GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.CANCELED]
    for number, status in enumerate(endings):
        program.run(f"send({number})")
        await shows("len(goals)", number + 1)
        goals[-1].feedback(sequence([number], type.feedback))
        await shows("feedback[-1:]", [[number]])
        if status is GoalStatus.CANCELED:
            program.run("goals[-1].cancel_goal_async()")
            await until(lambda: cancelled == [goals[-1].id])
        goals[-1].finish(status, sequence([number, 7], type.result))
        await shows("len(results)", number + 1)
    assert program.run("result = results") == [[int(s), [n, 7]] for n, s in enumerate(endings)]
    program.run("send(-1)")
    await until(lambda: program.run("result = [goal.accepted for goal in goals]") == [True] * 3 + [False])
    server.close()
    await until(lambda: not program.run("result = client.server_is_ready()"))
