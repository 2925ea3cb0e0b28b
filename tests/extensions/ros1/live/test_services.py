from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import anyio.to_thread
import pytest

from rwt_participant.errors import ProviderGone, ServiceFailed
from tests.waiting import until

if TYPE_CHECKING:
    from rwt.extensions.ros1 import Ros1Graph
    from tests.extensions.ros1.live.conftest import Ros

pytestmark = pytest.mark.anyio

OFFER = """
from std_srvs.srv import SetBool, SetBoolResponse, Trigger
def switch(request):
    if not request.data:
        raise rospy.ServiceException('off is not allowed')
    return SetBoolResponse(True, 'switched')
service = rospy.Service('/switch', SetBool, switch)
import time
slow = rospy.Service('/slow', Trigger, lambda request: time.sleep(60))
"""

CALL = """
from std_srvs.srv import SetBool
switch = rospy.ServiceProxy('/switch', SetBool)
persistent = rospy.ServiceProxy('/switch', SetBool, persistent=True)
def ask(value, call=switch):
    try:
        return plain(call(value))
    except rospy.ServiceException as error:
        return str(error)
"""


async def test_a_service_of_rospy_is_called(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    program.run(OFFER)
    await until(lambda: graph.service("/switch") is not None)
    node = graph.node("caller")

    response = await node.call("/switch", {"data": True})
    assert (response.success, response.message) == (True, "switched")
    with pytest.raises(ServiceFailed, match="off is not allowed"):
        await node.call("/switch", {"data": False})
    info = graph.service("/robot/program/get_loggers")
    assert info is not None
    assert info.type.name == "roscpp/GetLoggers"


async def test_a_call_ends_when_its_service_is_killed(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    program.run(OFFER)
    await until(lambda: graph.service("/slow") is not None)
    failures: list[Exception] = []

    async def call() -> None:
        try:
            await graph.node("caller").call("/slow", {}, timeout=None)
        except ProviderGone as error:
            failures.append(error)

    async with anyio.create_task_group() as group:
        group.start_soon(call)
        await anyio.sleep(0.5)
        program.kill()
    assert "went away without an answer" in str(failures[0])


async def test_rospy_calls_a_service_of_this_process(ros: Ros, graph: Ros1Graph) -> None:
    def switch(request: Any) -> dict[str, object]:
        if not request.data:
            raise ServiceFailed("off is not allowed")
        return {"success": True, "message": "switched"}

    graph.node("server").advertise_service("/switch", "std_srvs/SetBool", switch)
    program = ros.program()
    await ros.shows({"/switch"}, "rosservice", "list")

    async def ask(statement: str) -> Any:
        return await anyio.to_thread.run_sync(program.run, f"{CALL}\nresult = {statement}")

    assert await ask("ask(True)") == {"success": True, "message": "switched"}
    assert "off is not allowed" in await ask("ask(False)")
    answers = await ask("[ask(each, persistent) for each in (True, True)]")
    assert answers == [{"success": True, "message": "switched"}] * 2


async def test_a_living_service_of_the_same_name_is_not_replaced(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    program.run(OFFER)
    node = graph.node("server")
    node.advertise_service("/switch", "std_srvs/SetBool", lambda _: {"success": False, "message": "ours"})
    node.advertise_service("/mark", "std_srvs/Trigger", lambda _: {})
    await ros.shows({"/mark"}, "rosservice", "list")
    assert "/robot/program" in ros.tool("rosservice", "node", "/switch")


async def test_a_living_node_of_the_same_name_is_not_shut_down(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    node = graph.node("program", "/robot")
    node.advertise("/chatter", "std_msgs/String")
    await ros.shows({"/chatter"}, "rostopic", "list")
    assert program.run("result = rospy.is_shutdown()") is False


async def test_a_newer_node_takes_the_name_and_this_one_continues_under_another(
    ros: Ros, graph: Ros1Graph, caplog: pytest.LogCaptureFixture
) -> None:
    texts: list[str] = []
    node = graph.node("program", "/robot")
    node.subscribe("/chatter", lambda each: texts.append(each.data), "std_msgs/String")
    await ros.shows({"/robot/program"}, "rosnode", "list")
    program = await anyio.to_thread.run_sync(ros.program)
    await until(lambda: "another node /robot/program was started" in caplog.text)
    await ros.shows({f"/robot/program_{os.getpid()}"}, "rosnode", "list")
    program.run(
        "from std_msgs.msg import String; p = rospy.Publisher('/chatter', String, latch=True, queue_size=1)"
    )
    program.run("p.publish('hi')")
    await until(lambda: texts == ["hi"])
    assert program.run("result = rospy.is_shutdown()") is False


async def test_dynamic_reconfigure(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    program.run(
        """
from dynamic_reconfigure.server import Server
from dynamic_reconfigure.cfg import TestConfig
changes = []
def changed(config, level):
    changes.append(config['double_'])
    return config
server = Server(TestConfig, changed)
"""
    )
    service = "/robot/program/set_parameters"
    await until(lambda: graph.service(service) is not None)
    node = graph.node("client")
    seen: list[Any] = []
    node.subscribe("/robot/program/parameter_updates", seen.append)
    config = {"config": {"doubles": [{"name": "double_", "value": 2.5}]}}
    response = await node.call(service, config)
    assert {each.name: each.value for each in response.config.doubles}["double_"] == 2.5
    assert program.run("result = changes")[-1] == 2.5
    await until(lambda: seen and {each.name: each.value for each in seen[-1].doubles}["double_"] == 2.5)
    await until(lambda: graph.parameters.has("/robot/program/double_"))
