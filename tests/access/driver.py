"""A client that drives until it is told anything: `python -m tests.access.driver URL SPEED PERIOD`."""

from __future__ import annotations

import sys

import anyio
import anyio.to_thread

from rwt_client import Robot, connect


async def drive(robot: Robot, speed: float, period: float) -> None:
    """Publish a speed again and again; what the server refuses is its matter."""
    topic = robot.advertise("/cmd_vel", "geometry_msgs/Twist")
    while True:
        for _ in range(1 if period else 50):
            topic.publish({"linear": {"x": speed}})
        await anyio.sleep(period)


async def main(url: str, speed: float, period: float) -> None:
    """Drive until a line comes on standard input, and then keep the connection until that ends."""
    async with connect(url) as robot, anyio.create_task_group() as tasks:
        tasks.start_soon(drive, robot, speed, period)
        await anyio.to_thread.run_sync(sys.stdin.readline)
        tasks.cancel_scope.cancel()
        with anyio.CancelScope(shield=True):
            await anyio.to_thread.run_sync(sys.stdin.readline)


if __name__ == "__main__":
    anyio.run(main, sys.argv[1], float(sys.argv[2]), float(sys.argv[3]))
