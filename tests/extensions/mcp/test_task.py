"""A task solved through the tools alone, by a program instead of a model: drive to the red object, read the
battery, begin something else and cancel it."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.extensions.mcp.agents import OPEN, agent_at, done, picture_of, served, url_of, value

if TYPE_CHECKING:
    from mcp.client import Client

pytestmark = [pytest.mark.anyio, pytest.mark.timeout(120)]

#: How near is at the object, metres from the middle of the robot.
_NEAR = 0.7


async def _sees_red(agent: Client) -> float | None:
    """The column of the middle of what is red in the camera's picture."""
    picture = picture_of(await agent.call_tool("read_topic", {"topic": "/camera/image_raw"}))
    pixels = np.asarray(picture.convert("RGB"), np.int16)
    red, green, blue = (pixels[:, :, each] for each in range(3))
    columns = np.nonzero((red > 1.7 * green) & (red > 1.7 * blue) & (red > 50))[1]
    return float(np.median(columns)) if len(columns) > 200 else None


async def _where_is_red(agent: Client) -> tuple[float, float] | None:
    """The place of what is red, in the map: the direction from the picture, the distance from the scan."""
    column = await _sees_red(agent)
    if column is None:
        return None
    lens = await value(agent, "read_topic", topic="/camera/camera_info", fields=["k[0]", "k[2]"])
    bearing = -math.atan2(column - lens["k[2]"], lens["k[0]"])
    scan = await value(agent, "read_topic", topic="/scan", fields=["angle_min", "angle_increment"])
    index = round((bearing - scan["angle_min"]) / scan["angle_increment"])
    distance = (await value(agent, "read_topic", topic="/scan", fields=[f"ranges[{index}]"]))[
        f"ranges[{index}]"
    ]
    ahead = (distance * math.cos(bearing), distance * math.sin(bearing), 0.0)
    found = await value(agent, "look_up_transform", target="map", source="laser", point=ahead)
    x, y, _ = found["point"]
    return x, y


async def _place(agent: Client) -> tuple[float, float]:
    at = await value(agent, "look_up_transform", target="map", source="base_link")
    return at["transform"]["translation"]["x"], at["transform"]["translation"]["y"]


def _goal(x: float, y: float) -> dict[str, object]:
    pose = {"position": {"x": x, "y": y}, "orientation": {"w": 1.0}}
    return {"pose": {"header": {"frame_id": "map"}, "pose": pose}}


async def test_a_task_is_solved_through_the_tools() -> None:
    async with served(demo=True, **OPEN) as server, agent_at(url_of(server)) as agent:
        assert "/navigate_to_pose [nav2_msgs/action/NavigateToPose]" in await done(agent, "list_robot")
        assert await _where_is_red(agent) is None  # It is in the hall, behind the wall.
        ended = await done(agent, "send_goal", action="/navigate_to_pose", goal=_goal(-0.5, -2.4))
        assert ended.startswith("the goal succeeded")
        for _ in range(12):
            red = await _where_is_red(agent)
            if red is not None:
                break
            turn = {"angular": {"z": 1.0}}
            await done(agent, "publish", topic="/cmd_vel", message=turn, seconds=0.5)
        assert red is not None
        x, y = await _place(agent)
        short = 1 - (_NEAR - 0.1) / math.dist(red, (x, y))
        goal = _goal(x + (red[0] - x) * short, y + (red[1] - y) * short)
        ended = await done(agent, "send_goal", action="/navigate_to_pose", goal=goal)
        assert ended.startswith("the goal succeeded")
        assert math.dist(await _place(agent), (0.6, -0.6)) < _NEAR + 0.15  # Where the red pillar stands.

        battery = await value(agent, "read_topic", topic="/battery_state", fields=["percentage"])
        assert 0.5 < battery["percentage"] <= 1.0

        left = await done(agent, "send_goal", action="/navigate_to_pose", goal=_goal(-3, 2), timeout=0.2)
        found = re.search(r"goal_id: ([0-9a-f]{32})", left)
        assert found and "and continues" in left
        assert "the goal canceled" in await done(agent, "cancel_goal", goal_id=found[1])
        speed = await value(
            agent, "watch_numbers", topic="/odom", seconds=0.6, fields=["twist.twist.linear.x"]
        )
        assert abs(speed["fields"]["twist.twist.linear.x"]["last"]) < 0.2
