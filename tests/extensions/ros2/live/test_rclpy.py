"""Nodes on `rwt_rclpy` beside nodes on the real rclpy, through `rwt serve --graph ros2`."""

from __future__ import annotations

import os
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from tests.extensions.ros2.live.test_server import serving
from tests.statements import Program

if TYPE_CHECKING:
    from collections.abc import Iterator

import pytest

_COMMON = """
import time
from std_msgs.msg import String
from std_srvs.srv import Trigger

def wait(condition):
    end = time.monotonic() + 20
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)
    assert condition()

def answer(request, response):
    response.success, response.message = True, NAME
    return response

received = []
publisher = node.create_publisher(String, f'/from_{NAME}', 10)
subscription = node.create_subscription(String, f'/from_{OTHER}', lambda m: received.append(m.data), 10)
service = node.create_service(Trigger, f'/served_by_{NAME}', answer)
client = node.create_client(Trigger, f'/served_by_{OTHER}')
"""
_PUBLISH = """
wait(publisher.get_subscription_count)
for number in range(3):
    publisher.publish(String(data=f'{NAME} {number}'))
"""
_RECEIVED = """
wait(lambda: len(received) == 3)
result = received
"""
_CALL = """
assert client.wait_for_service(20)
future = client.call_async(Trigger.Request())
wait(future.done)
result = [future.result().success, future.result().message]
"""
_ACTION_SERVER = """
import threading
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from test_msgs.action import Fibonacci

canceling = threading.Event()

def respond(goal):
    return GoalResponse.REJECT if goal.order < 0 else GoalResponse.ACCEPT

def cancel(handle):
    canceling.set()
    return CancelResponse.ACCEPT

def execute(handle):
    sequence = list(range(handle.request.order))
    handle.publish_feedback(Fibonacci.Feedback(sequence=sequence[:1]))
    if not sequence:  # Until it is canceled.
        canceling.wait(20)
        wait(lambda: handle.is_cancel_requested)
        handle.canceled()
    elif len(sequence) == 1:
        handle.abort()
    else:
        handle.succeed()
    return Fibonacci.Result(sequence=sequence)

server = ActionServer(node, Fibonacci, f'/done_by_{NAME}', execute, goal_callback=respond,
    cancel_callback=cancel, callback_group=ReentrantCallbackGroup())
"""
_ACTION_CLIENT = """
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
actions = ActionClient(node, Fibonacci, f'/done_by_{OTHER}')

def finish(future):
    wait(future.done)
    return future.result()

def send(order, then=lambda handle: None):
    feedback = []
    goal = Fibonacci.Goal(order=order)
    handle = finish(actions.send_goal_async(goal, lambda m: feedback.append(list(m.feedback.sequence))))
    assert handle.accepted
    if order >= 0:
        wait(lambda: feedback)
    then(handle)
    done = finish(handle.get_result_async())
    return [done.status, list(done.result.sequence), feedback]

assert actions.wait_for_server(20)
result = [
    send(3),
    send(1),
    send(0, lambda handle: finish(handle.cancel_goal_async())),
    send(-1),
    [GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_ABORTED, GoalStatus.STATUS_CANCELED],
]
"""


@pytest.fixture
def ours() -> Iterator[Program]:
    """The same program on `rwt_rclpy`, in an interpreter without ROS."""
    python = Path(sys.base_prefix, "bin", f"python{sys.version_info.major}.{sys.version_info.minor}")
    hidden = ("AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "ROS_DISTRO", "RMW_IMPLEMENTATION")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    options = ("--interfaces", "rwt-rclpy/differential/interfaces")
    node = ("tests/extensions/ros2/live/program.py", "--ros-args", "-r", "__node:=ours")
    with serving() as (_, url):
        command = ("rwt.cli", "run", "--graph", url, *options, *node)
        with closing(Program(str(python), *command, environment=environment)) as running:
            yield running


def test_topics_and_services_reach_the_other_rclpy(program: Program, ours: Program) -> None:
    for each, name, other in ((program, "real", "ours"), (ours, "ours", "real")):
        each.run(f"NAME, OTHER = '{name}', '{other}'\n{_COMMON}")
    assert ours.run("result = rclpy.__name__") == "rwt_rclpy.client_library"
    for sender, name, receiver in ((program, "real", ours), (ours, "ours", program)):
        sender.run(_PUBLISH)
        assert receiver.run(_RECEIVED) == [f"{name} {number}" for number in range(3)]
    assert program.run(_CALL) == [True, "ours"]
    assert ours.run(_CALL) == [True, "real"]


def test_goals_reach_the_other_rclpy(program: Program, ours: Program) -> None:
    for each, name, other in ((program, "real", "ours"), (ours, "ours", "real")):
        each.run(f"NAME, OTHER = '{name}', '{other}'\n{_COMMON}{_ACTION_SERVER}")
    for client in (program, ours):
        *results, (succeeded, aborted, canceled) = client.run(_ACTION_CLIENT)
        # The last goal is rejected, for which rosbridge has no message.
        assert results == [
            [succeeded, [0, 1, 2], [[0]]],
            [aborted, [0], [[0]]],
            [canceled, [], [[]]],
            [aborted, [], []],
        ]


def test_parameters_of_a_real_node_are_set(program: Program, ours: Program) -> None:
    program.run("node.declare_parameter('speed', 1.5)")
    answer = ours.run(
        """
import time
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
other = AsyncParameterClient(node, '/robot/program')
assert other.wait_for_services(20)
future = other.set_parameters([Parameter('speed', value=2.5)])
end = time.monotonic() + 20
while not future.done() and time.monotonic() < end:
    time.sleep(0.02)
result = future.result().results[0].successful
"""
    )
    assert answer
    assert program.run("result = node.get_parameter('speed').value") == 2.5
