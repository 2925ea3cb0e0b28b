"""ROS time of `/clock`, where the parameter `/use_sim_time` asks for it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import anyio.to_thread
import pytest

from rwt.extensions.ros1 import Ros1Graph
from rwt_interfaces.times import NANOSECONDS
from tests.waiting import until

if TYPE_CHECKING:
    from tests.extensions.ros1.live.conftest import Ros

pytestmark = pytest.mark.anyio

SIMULATOR = """
from rosgraph_msgs.msg import Clock
clock = rospy.Publisher('/clock', Clock, queue_size=1, latch=True)
clock.publish(rospy.Time(100, 250000000))
"""


async def test_time_follows_the_clock_while_the_parameter_is_set(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    ros.tool("rosparam", "set", "/use_sim_time", "true")
    async with Ros1Graph(master=ros.uri) as graph:
        clock = graph.clock
        assert (clock.is_real, clock.time_ns()) == (False, 0)
        program = ros.program("simulator")
        program.run(SIMULATOR)
        await until(lambda: clock.time_ns() == 100 * NANOSECONDS + 250_000_000)
        program.run("clock.publish(rospy.Time(90))")  # As after a reset of the simulation.
        await until(lambda: clock.time_ns() == 90 * NANOSECONDS)
        await clock.sleep(0.01)  # By real time: the simulation stands still.
        publisher = graph.node("talker").advertise("/stamped", "std_msgs/Header", latch=True)
        publisher.publish({"stamp": graph.distro.time(clock.time_ns()), "frame_id": "map"})
        echo = partial(ros.tool, "rostopic", "echo", "-n", "1", "/stamped")
        assert "secs: 90" in await anyio.to_thread.run_sync(echo)
        assert "rwt_clock" not in str(graph.nodes())
        ros.tool("rosparam", "set", "/use_sim_time", "false")
        await until(lambda: clock.is_real and clock.time_ns() > 10**18)
        ros.tool("rosparam", "set", "/use_sim_time", "true")
        await until(lambda: clock.time_ns() == 90 * NANOSECONDS)
    assert "rwt_clock" not in ros.tool("rosnode", "list")
