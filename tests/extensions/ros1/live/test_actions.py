from __future__ import annotations

from typing import TYPE_CHECKING

import anyio.to_thread
import pytest

from rwt_participant.errors import GoalRejected, ProviderGone
from rwt_participant.goals import GoalStatus, ReceivedGoal
from tests.waiting import until

if TYPE_CHECKING:
    from rwt.extensions.ros1 import Ros1Graph
    from tests.extensions.ros1.live.conftest import Ros

pytestmark = pytest.mark.anyio

SERVER = """
import actionlib
from actionlib.msg import TestAction, TestFeedback, TestResult
import time
def execute(goal):
    server.publish_feedback(TestFeedback(goal.goal + 1))
    if goal.goal < 0:
        while not server.is_preempt_requested():
            time.sleep(0.01)
        server.set_preempted(TestResult(-1), 'stopped')
    elif goal.goal == 13:
        server.set_aborted(TestResult(0), 'unlucky')
    else:
        server.set_succeeded(TestResult(2 * goal.goal), 'done')
server = actionlib.SimpleActionServer('/double', TestAction, execute, auto_start=False)
server.start()
"""

CLIENT = """
import actionlib
from actionlib.msg import TestAction, TestGoal
client = actionlib.SimpleActionClient('/double', TestAction)
result = client.wait_for_server(rospy.Duration(20))
heard = []
client.send_goal(TestGoal({goal}), feedback_cb=lambda feedback: heard.append(feedback.feedback))
"""


async def test_goals_of_an_actionlib_server(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    program.run(SERVER)
    await until(lambda: graph.action("/double") is not None)
    node = graph.node("client")
    heard: list[int] = []
    goal = await node.send_goal("/double", {"goal": 21}, on_feedback=lambda each: heard.append(each.feedback))
    outcome = await goal.result()
    assert (outcome.status, outcome.result.result, goal.reason) == (GoalStatus.SUCCEEDED, 42, "done")
    assert heard == [22]
    goal = await node.send_goal("/double", {"goal": 13})
    outcome = await goal.result()
    assert (outcome.status, goal.reason) == (GoalStatus.ABORTED, "unlucky")
    goal = await node.send_goal("/double", {"goal": -5})
    await until(lambda: goal.status is GoalStatus.EXECUTING)
    goal.cancel()
    outcome = await goal.result()
    assert (outcome.status, outcome.result.result) == (GoalStatus.CANCELED, -1)


async def test_goals_end_when_their_server_leaves(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    program.run(SERVER)
    await until(lambda: graph.action("/double") is not None)
    goal = await graph.node("client").send_goal("/double", {"goal": -5})
    await until(lambda: goal.status is GoalStatus.EXECUTING)
    program.run("rospy.signal_shutdown('over')")
    with pytest.raises((ProviderGone, GoalRejected)):
        await goal.result()


async def test_an_actionlib_client_of_this_process(ros: Ros, graph: Ros1Graph) -> None:
    sent, heard = anyio.Event(), anyio.Event()

    async def execute(goal: ReceivedGoal) -> dict[str, object]:
        await sent.wait()  # Clients in Python lose what comes before `send_goal` has returned,
        goal.publish_feedback({"feedback": 7})
        await heard.wait()  # and feedback that the result overtakes on its own connection.
        return {"result": 2 * goal.request.goal}

    graph.node("server").advertise_action("/double", "actionlib/Test", execute)
    program = ros.program()
    assert await anyio.to_thread.run_sync(program.run, CLIENT.format(goal=21)) is True
    sent.set()
    await until(lambda: program.run("result = heard") == [7])
    heard.set()
    await anyio.to_thread.run_sync(program.run, "client.wait_for_result(rospy.Duration(20))")
    assert program.run("result = [client.get_state(), client.get_result().result, heard]") == [3, 42, [7]]
