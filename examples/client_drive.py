"""Drive a robot 30 cm forward by its odometry, then let it count. Start `rwt serve --demo` first.

python examples/client_drive.py [ws://127.0.0.1:9090]
"""

from __future__ import annotations

import math
import sys

import anyio

from rwt_client import Robot, connect

DISTANCE = 0.3


async def drive(robot: Robot) -> None:
    """Say how fast to go with each message of odometry, until it has gone far enough."""
    wheels = await robot.advertise("/cmd_vel", "geometry_msgs/Twist")
    start = None
    async with robot.topic("/odom", "nav_msgs/Odometry", throttle=0.05) as odometry:
        async for message in odometry:
            here = message.pose.pose.position
            start = start or (here.x, here.y)
            gone = math.dist(start, (here.x, here.y))
            if gone >= DISTANCE:
                break
            wheels.publish({"linear": {"x": 0.5}})
    wheels.publish({})
    print(f"gone {gone:.2f} m, {odometry.dropped} messages dropped")


async def count(robot: Robot) -> None:
    """Send a goal and follow it."""
    goal = await robot.send_goal("/fibonacci", {"order": 4})
    async for feedback in goal:
        print("so far", *feedback.sequence)
    outcome = await goal.result()
    print(outcome.status.name.lower(), *outcome.result.sequence)


async def main(url: str) -> None:
    """Do both."""
    async with connect(url) as robot:
        robot.on_event(lambda event: print(event))
        await drive(robot)
        await count(robot)


if __name__ == "__main__":
    anyio.run(main, sys.argv[1] if len(sys.argv) > 1 else "ws://127.0.0.1:9090")
