from __future__ import annotations

import os
import re
import sys
import time
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallTimeout, ProviderGone
from tests.extensions.ros2.live.program import NODE
from tests.extensions.ros2.live.values import comparable
from tests.statements import Program
from tests.waiting import until

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rwt.extensions.ros2 import Ros2Graph
    from rwt_graph.api import Participant, ServiceCall

pytestmark = pytest.mark.anyio

_SLOW = """
from std_srvs.srv import Trigger
from rclpy.callback_groups import ReentrantCallbackGroup
import threading, time
asked = threading.Semaphore(0)
def serve(request, response):
    asked.release()
    time.sleep({seconds})
    response.message = 'done'
    return response
service = node.create_service(Trigger, '/slow', serve, callback_group=ReentrantCallbackGroup())
"""


_PROGRAM = "tests.extensions.ros2.live.program"


@pytest.fixture
def lease(domain: int, tmp_path: Path) -> Mapping[str, str]:
    """Environment of a program with the profile of docs/how-to/ros2.md."""
    page = (Path(__file__).parents[4] / "docs" / "how-to" / "ros2.md").read_text("utf-8")
    found = re.search(r"```xml\n(.*?)```", page, re.DOTALL)
    assert found is not None
    (tmp_path / "profile.xml").write_text(found[1], "utf-8")
    profile = str(tmp_path / "profile.xml")
    return {**os.environ, "ROS_DOMAIN_ID": str(domain), "FASTDDS_DEFAULT_PROFILES_FILE": profile}


class Answers(list[Any]):
    """Answers of calls, in the order of their arrival; those of ROS 2 as values."""

    def __call__(self, answer: Any) -> None:
        self.append(answer.value() if isinstance(answer, Payload) else answer)


def call(
    graph: Ros2Graph, client: Participant, name: str, request: object, timeout: float | None = None
) -> Answers:
    info = graph.service(name)
    assert info is not None
    answers = Answers()
    client.call_service(name, Payload.from_value(info.type.request, request), answers, timeout)
    return answers


@pytest.mark.parametrize("name", ["Arrays", "BasicTypes", "Empty"])
async def test_every_service_type_in_both_roles(graph: Ros2Graph, program: Program, name: str) -> None:
    type = graph.registry.service(f"test_msgs/{name}")
    ours = graph.participant("/ours")
    sent = program.run(
        f"""
from test_msgs.srv import {name} as Type
from test_msgs import service_fixtures
import re
pairs = getattr(service_fixtures, 'get_msg_' + re.sub('(?<=[a-z])(?=[A-Z])', '_', {name!r}).lower())()
requests = []
def serve(request, response):
    requests.append(request)
    return pairs[len(requests) - 1][1]
service = node.create_service(Type, '/theirs', serve)
client = node.create_client(Type, '/from_us')
result = [[plain(each) for each in pair] for pair in pairs]
"""
    )
    await until(lambda: graph.service("/theirs"))
    for request, response in sent:
        answers = call(graph, ours, "/theirs", request)
        await until(partial(bool, answers))
        assert [comparable(answer) for answer in answers] == [response]
    assert program.run("result = [plain(each) for each in requests]") == [request for request, _ in sent]

    received: list[Any] = []

    def serve(asked: ServiceCall) -> None:
        asked.reply(Payload.from_value(type.response, sent[len(received)][1]))
        received.append(comparable(asked.request.value()))

    ours.advertise_service("/from_us", type, serve)
    await until(lambda: program.run("result = client.service_is_ready()"))
    for number in range(len(sent)):
        program.run(f"future = client.call_async(pairs[{number}][0])")
        await until(lambda: program.run("result = future.done()"))
        assert program.run("result = plain(future.result())") == sent[number][1]
    assert received == [request for request, _ in sent]


async def test_a_hundred_concurrent_calls_in_both_roles(graph: Ros2Graph, program: Program) -> None:
    ours, type = graph.participant("/ours"), graph.registry.service("test_msgs/BasicTypes")
    program.run(
        """
from test_msgs.srv import BasicTypes as Type
import time
def serve(request, response):
    time.sleep(0.002)
    response.int32_value = 2 * request.int32_value
    return response
service = node.create_service(Type, '/theirs', serve)
# ROS 2's default depth of 10 loses answers that arrive at once.
client = node.create_client(Type, '/from_us', qos_profile=qos.QoSProfile(depth=100))
"""
    )
    await until(lambda: graph.service("/theirs"))
    calls = [call(graph, ours, "/theirs", {"int32_value": number}) for number in range(100)]
    await until(lambda: all(calls))
    assert [answer.int32_value for (answer,) in calls] == [2 * number for number in range(100)]

    waiting: list[ServiceCall] = []
    ours.advertise_service("/from_us", type, waiting.append)
    await until(lambda: program.run("result = client.service_is_ready()"))
    program.run("futures = [client.call_async(Type.Request(int32_value=number)) for number in range(100)]")
    await until(lambda: len(waiting) == 100)
    for each in reversed(waiting):
        request: Any = each.request.value()
        each.reply(Payload.from_value(type.response, {"int32_value": 3 * request.int32_value}))
    await until(lambda: program.run("result = all(future.done() for future in futures)"))
    answers = program.run("result = [future.result().int32_value for future in futures]")
    assert answers == [3 * number for number in range(100)]


async def test_a_slow_service_delays_nobody(graph: Ros2Graph, program: Program) -> None:
    program.run(_SLOW.format(seconds=1))
    await until(lambda: graph.service("/slow"))
    ours = graph.participant("/ours")
    began = time.monotonic()
    slow = call(graph, ours, "/slow", {})
    assert time.monotonic() - began < 0.5
    await until(lambda: program.run("result = asked.acquire(blocking=False)"))
    parameters = call(graph, ours, f"{NODE}/list_parameters", {})
    await until(lambda: parameters)
    assert not slow
    await until(lambda: slow)
    assert slow[0].message == "done"


async def test_a_call_ends_when_its_service_leaves(graph: Ros2Graph, program: Program) -> None:
    program.run(_SLOW.format(seconds=0) + "client = node.create_client(Trigger, '/held')")
    ours, trigger = graph.participant("/ours"), graph.registry.service("std_srvs/Trigger")
    await until(lambda: graph.service("/slow"))
    program.run("executor.shutdown(0)")
    answers = call(graph, ours, "/slow", {})
    more = [call(graph, ours, "/slow", {}) for _ in range(20)]
    program.run("node.destroy_service(service)")
    await until(lambda: answers and all(more))
    assert isinstance(answers[0], ProviderGone)
    assert str(answers[0]) == "Service /slow was unadvertised"
    assert graph.service("/slow") is None
    # A service of this process that leaves with open calls sends no answer.
    held: list[ServiceCall] = []
    service = ours.advertise_service("/held", trigger, held.append)
    await until(lambda: program.run("result = client.service_is_ready()"))
    program.run("future = client.call_async(Trigger.Request())")
    await until(lambda: held)
    service.close()
    held[0].reply(Payload.from_value(trigger.response, {}))
    await until(lambda: not program.run("result = client.service_is_ready()"))


async def test_a_call_of_a_killed_program_ends_in_time(graph: Ros2Graph, program: Program) -> None:
    program.run(_SLOW.format(seconds=100))
    await until(lambda: graph.service("/slow"))
    ours = graph.participant("/ours")
    limited = call(graph, ours, "/slow", {}, timeout=1)
    unlimited = call(graph, ours, "/slow", {})
    await until(lambda: program.run("result = asked.acquire(blocking=False)"))
    program.kill()
    await until(lambda: limited)
    assert isinstance(limited[0], CallTimeout)
    # DDS notices within its lease of 20 seconds.
    await until(lambda: unlimited)
    assert str(unlimited[0]) == "Service /slow was unadvertised: its node /robot/program left"


async def test_the_robot_decides_when_the_calls_of_a_killed_program_end(
    graph: Ros2Graph, program: Program, lease: Mapping[str, str]
) -> None:
    """The lease of the how-to page's profile is shorter than the usual one, which the other program has."""
    program.run(_SLOW.format(seconds=100))
    with closing(Program(sys.executable, _PROGRAM, environment=lease)) as short:
        short.run("executor.remove_node(node); node.destroy_node()")
        short.run("node = rclpy.create_node('short'); executor.add_node(node)")
        short.run(_SLOW.format(seconds=100).replace("/slow", "/short"))
        await until(lambda: graph.service("/slow") and graph.service("/short"))
        ours = graph.participant("/ours")
        usual, soon = call(graph, ours, "/slow", {}), call(graph, ours, "/short", {})
        await until(lambda: program.run("result = asked.acquire(blocking=False)"))
        await until(lambda: short.run("result = asked.acquire(blocking=False)"))
        program.kill()
        short.kill()
        await until(lambda: soon)
        assert isinstance(soon[0], ProviderGone)
        assert usual == []


async def test_calls_end_if_their_program_is_killed_and_started_again(
    graph: Ros2Graph, lease: Mapping[str, str]
) -> None:
    """The new program has the same names, and does not know the calls of the one before."""
    ours = graph.participant("/ours")
    opened: list[Answers] = []

    def was_lost_or_is_beside() -> bool:
        return not opened or bool(opened[-1]) or graph.remote_nodes == 2

    for _ in range(3):
        with closing(Program(sys.executable, _PROGRAM, environment=lease)) as robot:
            robot.run(_SLOW.format(seconds=100))
            await until(was_lost_or_is_beside)
            await until(lambda: graph.service("/slow"))
            newest = call(graph, ours, "/slow", {})
            await until(partial(robot.run, "result = asked.acquire(blocking=False)"))
            if opened:
                await until(partial(bool, opened[-1]))
                assert isinstance(opened[-1][0], ProviderGone)
            assert newest == []
            opened.append(newest)
            robot.kill()


async def test_a_service_that_lost_requests_is_called_again(graph: Ros2Graph, program: Program) -> None:
    program.run(_SLOW.format(seconds=0))
    await until(lambda: graph.service("/slow"))
    ours = graph.participant("/ours")
    program.run("executor.remove_node(node)")
    lost = [call(graph, ours, "/slow", {}, timeout=0.2) for _ in range(30)]
    await until(lambda: all(lost))
    # The executor may still answer what its present wait has taken.
    assert sum(isinstance(answer, CallTimeout) for (answer,) in lost) > 20
    program.run("executor.add_node(node)")
    answers = call(graph, ours, "/slow", {})
    await until(lambda: answers)
    assert answers[0].message == "done"


async def test_a_client_that_leaves_during_a_call(graph: Ros2Graph, program: Program) -> None:
    program.run(_SLOW.format(seconds=0.3))
    await until(lambda: graph.service("/slow"))
    client = graph.participant("/client")
    answers = call(graph, client, "/slow", {})
    await until(lambda: program.run("result = asked.acquire(blocking=False)"))
    client.close()
    assert len(answers) == 1
    assert "closed" in str(answers[0])
    other = call(graph, graph.participant("/other"), "/slow", {})
    await until(lambda: other)
    assert other[0].message == "done"
    assert len(answers) == 1
