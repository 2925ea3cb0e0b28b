"""A small robot for tests of tools, and a server in front of it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import anyio

from rwt import Server
from rwt_participant.errors import GoalCanceled, ServiceFailed
from rwt_participant.goals import ReceivedGoal
from tests.extensions.mcp.agents import served


class SmallRobot:
    """Small robot.

    Attributes:
        heard: velocities that came, forward.
        begun: set when a goal has begun.
        canceled: set when a goal was asked to end.
    """

    def __init__(self, server: Server) -> None:
        self.heard: list[float] = []
        self.stopped = anyio.Event()
        self.begun = anyio.Event()
        self.canceled = anyio.Event()
        self.node = node = server.node("small_robot")
        node.publish("/battery", {"percentage": 0.75}, "sensor_msgs/BatteryState", latch=True)
        node.publish("/status", {"data": "ready"}, "std_msgs/String", latch=True)
        node.publish("/camera", _picture(), "sensor_msgs/Image", latch=True)
        node.publish("/scan", _scan(), "sensor_msgs/LaserScan", latch=True)
        node.publish("/map", _map(), "nav_msgs/OccupancyGrid", latch=True)
        node.subscribe("/cmd_vel", self._drive, "geometry_msgs/Twist")
        node.advertise_service("/fail", "std_srvs/Trigger", self._fail)
        node.advertise_service("/add", "example_interfaces/AddTwoInts", _add)
        node.advertise_action("/count", "example_interfaces/Fibonacci", self._count)
        node.parameters.declare("speed", 0.5)
        self._number = node.advertise("/number", "std_msgs/Float64")
        self._next = 0.0
        node.create_timer(0.02, self._tick)

    def _tick(self) -> None:
        self._next += 1.0
        self._number.publish({"data": self._next})

    def _drive(self, message: Any) -> None:
        self.heard.append(message.linear.x)
        if message.linear.x == 0.0:
            self.stopped.set()

    def _fail(self, _: object) -> None:
        raise ServiceFailed("the arm is not calibrated")

    async def _count(self, goal: ReceivedGoal) -> dict[str, list[int]]:
        """Count to the order; an order of 0 goes on until it is cancelled."""
        self.begun.set()
        sequence: list[int] = []
        while not goal.request.order or len(sequence) < goal.request.order:
            if goal.cancel_requested:
                self.canceled.set()
                raise GoalCanceled({"sequence": sequence}, "as was asked")
            sequence.append(len(sequence))
            goal.publish_feedback({"sequence": sequence})
            await anyio.sleep(0.01)
        return {"sequence": sequence}


def _add(asked: Any) -> dict[str, int]:
    return {"sum": asked.a + asked.b}


def _picture() -> dict[str, object]:
    """Red above, blue below."""
    rows = [bytes((255, 0, 0)) * 40] * 15 + [bytes((0, 0, 255)) * 40] * 15
    return {"height": 30, "width": 40, "encoding": "rgb8", "step": 120, "data": b"".join(rows)}


def _scan() -> dict[str, object]:
    """A wall 2 m ahead, nothing elsewhere."""
    ranges = [2.0 if abs(index - 180) < 20 else float("inf") for index in range(360)]
    return {
        "header": {"frame_id": "laser"},
        "angle_min": -3.14159,
        "angle_increment": 0.0174533,
        "range_min": 0.1,
        "range_max": 10.0,
        "ranges": ranges,
    }


def _map() -> dict[str, object]:
    """Occupied in the south, unknown in the north."""
    info = {"resolution": 0.5, "width": 20, "height": 10, "origin": {"position": {"x": -5.0, "y": -2.5}}}
    return {"header": {"frame_id": "map"}, "info": info, "data": [100] * 100 + [-1] * 100}


@asynccontextmanager
async def small_robot(settings: Any = None, **changes: Any) -> AsyncIterator[tuple[Server, SmallRobot]]:
    """A server with a small robot behind it; arguments as of `served`."""
    async with served(settings, **changes) as server:
        robot = SmallRobot(server)
        try:
            yield server, robot
        finally:
            robot.node.close()
