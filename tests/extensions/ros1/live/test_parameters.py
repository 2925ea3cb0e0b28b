from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import anyio.to_thread
import pytest

from rwt_participant.errors import ParameterRejected
from tests.waiting import until

if TYPE_CHECKING:
    from rwt.extensions.ros1 import Ros1Graph
    from tests.extensions.ros1.live.conftest import Ros

pytestmark = pytest.mark.anyio


async def test_parameters_are_the_same_both_ways(ros: Ros, graph: Ros1Graph) -> None:
    program = ros.program()
    program.run("rospy.set_param('/robot', {'speed': 1.5, 'names': ['a', 'b'], 'inner': {'on': True}})")
    tree = graph.parameters
    await until(lambda: tree.has("/robot/inner/on"))
    assert tree.get("/robot") == {"speed": 1.5, "names": ["a", "b"], "inner": {"on": True}}
    tree.set("/robot/speed", 2)
    tree.set("/mine/text", "é\n<&>")
    await until(lambda: program.run("result = rospy.get_param('/robot/speed')") == 2)
    await until(lambda: program.run("result = rospy.get_param('/mine', None)") == {"text": "é\n<&>"})
    tree.delete("/mine")
    await until(lambda: program.run("result = rospy.has_param('/mine')") is False)
    program.run("rospy.delete_param('/robot/inner')")
    await until(lambda: not tree.has("/robot/inner"))
    program.run("for number in range(50): rospy.set_param('/count', number)")
    await until(lambda: tree.has("/count") and tree.get("/count") == 49)
    ros.tool("rosparam", "set", "/from_tool", "[1, two]")
    await until(lambda: tree.has("/from_tool") and tree.get("/from_tool") == [1, "two"])


async def test_values_that_ros_1_lacks_are_rejected(graph: Ros1Graph) -> None:
    for value in (None, 2**31, "\0"):
        with pytest.raises(ParameterRejected):
            graph.parameters.set("/bad", value)
    assert not graph.parameters.has("/bad")


async def test_a_restarted_master_gets_the_parameters_of_this_process(
    ros: Ros, graph: Ros1Graph, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    ros.tool("rosparam", "set", "/of_another", "1")
    graph.parameters.set("/of_this", 2)
    await until(lambda: graph.parameters.has("/of_another"))
    ros.stop_master()
    await until(lambda: "is tried again until it answers" in caplog.text)
    await anyio.to_thread.run_sync(ros.start_master)
    await until(lambda: not graph.parameters.has("/of_another"))
    await ros.shows({"2"}, "rosparam", "get", "/of_this")
