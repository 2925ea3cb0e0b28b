"""Services, parameters and actions of roslibpy, through the server, beside programs of rospy."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import closing
from typing import TYPE_CHECKING, Any

import pytest

from tests.extensions.ros1.live.test_actions import SERVER
from tests.extensions.ros1.live.test_server import server
from tests.extensions.ros1.live.test_services import OFFER
from tests.statements import Program
from tests.waiting import wait_until

if TYPE_CHECKING:
    from tests.extensions.ros1.live.conftest import Ros


@pytest.fixture
def client(ros: Ros) -> Iterator[Program]:
    """A client of a server on the graph of the master."""
    pytest.importorskip("roslibpy")
    with (
        server(ros) as url,
        closing(
            Program(
                sys.executable,
                "tests.extensions.ros1.live.roslibpy_program",
                url,
                environment=dict(os.environ),
            )
        ) as program,
    ):
        yield program


def test_services_parameters_and_actions_of_rospy(ros: Ros, client: Program) -> None:
    robot = ros.program()
    robot.run(OFFER + SERVER)
    robot.run("rospy.set_param('/speed', 1.5)")

    def ask(statement: str) -> Any:
        return client.run(f"import json\nresult = json.loads(json.dumps({statement}))")

    wait_until(lambda: "/switch" in ask("ros.get_services()"))
    call = "dict(roslibpy.Service(ros, '/switch', 'std_srvs/SetBool').call({'data': True}, timeout=30))"
    assert ask(call) == {"success": True, "message": "switched"}
    assert ask("ros.get_service_type('/switch')") == "std_srvs/SetBool"
    wait_until(lambda: ask("ros.get_param('/speed')") == 1.5)
    client.run("ros.set_param('/limit', 2)")
    wait_until(lambda: robot.run("result = rospy.get_param('/limit', None)") == 2)
    assert "/robot/program" in ask("ros.get_nodes()")
    client.run(
        """
import roslibpy.ros1.actionlib
actions = roslibpy.ros1.actionlib.ActionClient(ros, '/double', 'actionlib/TestAction')
"""
    )
    ends = "(server.action_server.result_pub, server.action_server.goal_sub)"
    wait_until(lambda: all(robot.run(f"result = [each.get_num_connections() for each in {ends}]")))
    client.run(
        """
goal = roslibpy.ros1.actionlib.Goal(actions, {'goal': 21})
goal.send()
"""
    )
    assert ask("goal.wait(30)") == {"result": 42}


def test_rospy_calls_a_service_of_the_client(ros: Ros, client: Program) -> None:
    client.run(
        """
def switch(request, response):
    response['success'], response['message'] = request['data'], 'by the client'
    return True
service = roslibpy.Service(ros, '/client/switch', 'std_srvs/SetBool')
service.advertise(switch)
"""
    )
    wait_until(lambda: "/client/switch" in ros.tool("rosservice", "list"))
    called = ros.tool("rosservice", "call", "/client/switch", "true")
    assert "by the client" in called
    assert json.loads(json.dumps(client.run("result = ros.is_connected"))) is True
