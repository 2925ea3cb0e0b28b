"""One server as a bridge between real ROS 1 programs and real ROS 2 programs."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import anyio.to_thread
import pytest
from websockets.sync.client import connect

from tests.extensions.ros1.live.conftest import HAS_ROS, Ros
from tests.extensions.ros2.live.test_server import serving
from tests.waiting import until

if TYPE_CHECKING:
    from tests.statements import Program

pytestmark = pytest.mark.anyio

ROS_1 = """
from std_msgs.msg import String
from geometry_msgs.msg import Twist
from std_srvs.srv import SetBool, SetBoolResponse
driven, heard = [], []
rospy.Subscriber('/drive_1', Twist, lambda twist: driven.append([twist.linear.x, twist.angular.z]))
rospy.Subscriber('/kept_2', String, lambda message: heard.append(message.data))
kept = rospy.Publisher('/kept_1', String, latch=True, queue_size=1)
kept.publish('of ROS 1')
drive = rospy.Publisher('/drive_2', Twist, queue_size=10)
def switch(request):
    return SetBoolResponse(request.data, 'by ROS 1')
service = rospy.Service('/switch_1', SetBool, switch)
"""

ROS_2 = """
from std_msgs.msg import String
from geometry_msgs.msg import Twist
from std_srvs.srv import SetBool
driven, heard = [], []
take = lambda twist: driven.append([twist.linear.x, twist.angular.z])
node.create_subscription(Twist, '/drive_2', take, 10)
retained = qos.QoSProfile(depth=1, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(String, '/kept_1', lambda message: heard.append(message.data), retained)
kept = node.create_publisher(String, '/kept_2', retained)
kept.publish(String(data='of ROS 2'))
drive = node.create_publisher(Twist, '/drive_1', 10)
def switch(request, response):
    response.success, response.message = request.data, 'by ROS 2'
    return response
service = node.create_service(SetBool, '/switch_2', switch)
client = node.create_client(SetBool, '/switch_1')
"""

CALL_FROM_2 = """
import time
future = client.call_async(SetBool.Request(data=True))
while not future.done():
    time.sleep(0.01)
result = [future.result().success, future.result().message]
"""


@pytest.mark.timeout(180)
@pytest.mark.parametrize("order", [("ros1", "ros2"), ("ros2", "ros1")])
async def test_programs_of_ros_1_and_ros_2_meet(
    program: Program, tmp_path: Path, order: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if not HAS_ROS:
        pytest.skip("needs ROS 1: run `make test-ros1`, which installs Debian's packages of it")
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    with closing(Ros(tmp_path)) as ros:
        await anyio.to_thread.run_sync(ros.start_master)
        old = await anyio.to_thread.run_sync(ros.program, "old")
        old.run(ROS_1)
        program.run(ROS_2)
        names = {"ros1": ros.uri, "ros2": "ros2"}
        graphs = [word for kind in order for word in ("--graph", names[kind])]
        with serving("serve", *graphs, "ws://127.0.0.1:0") as (_, url):
            await until(lambda: old.run("result = heard") == ["of ROS 2"])
            await until(lambda: program.run("result = heard") == ["of ROS 1"])

            def driven() -> bool:
                old.run("twist = Twist(); twist.linear.x = 0.5; drive.publish(twist)")
                program.run("twist = Twist(); twist.angular.z = 0.25; drive.publish(twist)")
                return [0.0, 0.25] in old.run("result = driven") and [0.5, 0.0] in program.run(
                    "result = driven"
                )

            await until(driven)
            await ros.shows({"/switch_2"}, "rosservice", "list")
            called = await anyio.to_thread.run_sync(ros.tool, "rosservice", "call", "/switch_2", "true")
            assert called.split("\n")[:2] == ["success: True", 'message: "by ROS 2"']
            assert program.run("result = client.wait_for_service(30)") is True
            assert await anyio.to_thread.run_sync(program.run, CALL_FROM_2) == [True, "by ROS 1"]
            with connect(url) as client:
                for service, answer in (("/switch_1", "by ROS 1"), ("/switch_2", "by ROS 2")):
                    client.send(
                        json.dumps({"op": "call_service", "service": service, "args": {"data": True}})
                    )
                    assert json.loads(client.recv(30))["values"] == {"success": True, "message": answer}
