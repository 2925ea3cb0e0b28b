"""Drive the demo robot along a square, in one process and without a server.

The program and the robot share a graph in memory; on a simulated clock the half minute passes at once.
"""

import anyio

from rwt.extensions.demo import DemoRobot
from rwt_graph import MemoryGraph, Node, SimulatedClock

SIDE = 1.0  # metres
SPEED = 0.5  # metres per second
TURN_RATE = 1.0  # radians per second


async def main() -> None:
    """Drive, and say where each corner is."""
    clock = SimulatedClock()
    async with MemoryGraph(clock=clock) as graph:
        robot = DemoRobot(graph)
        pilot = Node(graph, "pilot")
        cmd_vel = pilot.advertise("/cmd_vel", "geometry_msgs/Twist")
        places = []
        pilot.subscribe("/odom", lambda odometry: places.append(odometry.pose.pose.position))

        def drive(linear: float, angular: float, seconds: float) -> None:
            for _ in range(round(seconds * 10)):
                cmd_vel.publish({"linear": {"x": linear}, "angular": {"z": angular}})
                clock.advance(0.1)

        for corner in range(1, 5):
            drive(SPEED, 0.0, SIDE / SPEED)
            drive(0.0, TURN_RATE, 1.5708 / TURN_RATE)
            print(f"corner {corner}: x={places[-1].x:.2f} y={places[-1].y:.2f}")
        robot.close()


anyio.run(main)
