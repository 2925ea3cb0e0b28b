"""A server with a small robot, and a client of HTTP that nobody here wrote."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any, Final

import pytest

from rwt import LATCHED, GoalCanceled, Message, Node, ReceivedGoal, Server, ServiceFailed
from rwt_graph.api import Graph

ROLES: Final = {
    "auth": {
        "tokens": {
            "guest": {"token": "guest-guest-guest-1", "role": "guest"},
            "root": {"token": "admin-admin-admin-1", "role": "admin"},
        }
    },
    "roles": {
        "guest": {
            act: ["*open*"] for act in ("publish", "subscribe", "call", "goals", "get_param", "set_param")
        }
    },
}
GUEST: Final = {"Authorization": "Bearer guest-guest-guest-1"}
ROOT: Final = {"Authorization": "Bearer admin-admin-admin-1"}


class Robot:
    """A robot with one open and one secret thing of each kind."""

    def __init__(self, graph: Graph) -> None:
        self.heard: list[object] = []
        for name in ("open", "secret"):
            node = Node(graph, f"{name}_node")
            node.advertise(f"/{name}/label", "std_msgs/String", qos=LATCHED).publish({"data": f"the {name}"})
            node.subscribe(f"/{name}/heard", self.heard.append, "geometry_msgs/Twist")
            node.advertise_service(f"/{name}/add", "example_interfaces/AddTwoInts", _add)
            node.advertise_action(f"/{name}/count", "example_interfaces/Fibonacci", _count, accept=_check)
            node.parameters.declare(f"{name}_speed", 1.5)
        self.node = Node(graph, "open_talker")
        self.talker = self.node.advertise("/open/talk", "std_msgs/String")

    def close(self) -> None:
        self.node.close()


def _add(request: Message) -> dict[str, int]:
    if request.a < 0:
        raise ServiceFailed("no negative numbers")
    return {"sum": request.a + request.b}


def _check(goal: Message) -> bool | str:
    return goal.order >= 0 or "no negative order"


async def _count(goal: ReceivedGoal) -> dict[str, list[int]]:
    """Count to `order`; beyond 100 wait for the cancel."""
    sequence = []
    for number in range(min(goal.request.order, 3)):
        sequence.append(number)
        goal.publish_feedback({"sequence": sequence})
    if goal.request.order > 100:
        await goal.cancel_event.wait()
        raise GoalCanceled({"sequence": sequence})
    return {"sequence": sequence}


@pytest.fixture
def settings() -> dict[str, Any]:
    """Of the server."""
    return {}


@pytest.fixture
async def robot_and_server(settings: dict[str, Any]) -> AsyncIterator[tuple[Robot, Server]]:
    robots: list[Robot] = []

    def make(graph: Graph) -> Robot:
        robots.append(Robot(graph))
        return robots[0]

    async with Server("ws://127.0.0.1:0", extra_nodes=[make], web={"enabled": False}, **settings) as server:
        yield robots[0], server


@pytest.fixture
def robot(robot_and_server: tuple[Robot, Server]) -> Robot:
    return robot_and_server[0]


@pytest.fixture
def server(robot_and_server: tuple[Robot, Server]) -> Server:
    return robot_and_server[1]
