"""A robot whose packages the owner has not installed: `python -m tools.ros2_owner.robot`.

Diagnostics, markers and messages of `test_msgs`, in place of the owner's own package, are published by rclpy
with the real packages. Transforms and a Nav2 action come from a participant that has their definitions.
"""

from __future__ import annotations

import threading
from importlib import import_module
from typing import Any

import anyio
import rclpy
from rclpy.signals import SignalHandlerOptions

from rwt.extensions.ros2 import Ros2Graph
from rwt_graph.api import ServerGoal
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_participant.goals import GoalStatus

_INTERVAL_SECONDS = 0.2
_TRANSFORM = {"header": {"frame_id": "odom"}, "child_frame_id": "base_link"}


async def _run() -> None:
    # Only the robot's environment has them.
    diagnostic: Any = import_module("diagnostic_msgs.msg")
    tests: Any = import_module("test_msgs.msg")
    visualization: Any = import_module("visualization_msgs.msg")
    registry = Registry()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # SIGTERM ends the process at once.
    node = rclpy.create_node("monitor")
    # It answers who asks for the definitions of its messages.
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    diagnostics = node.create_publisher(diagnostic.DiagnosticArray, "/diagnostics", 10)
    own = node.create_publisher(tests.BasicTypes, "/own", 10)
    markers = node.create_publisher(visualization.MarkerArray, "/markers", 10)
    async with Ros2Graph(registry) as graph:
        robot = graph.participant("/robot")

        def navigate(goal: ServerGoal) -> None:
            goal.accept()
            result = Payload.from_value(registry.message("nav2_msgs/NavigateToPose_Result"), {})
            graph.clock.call_later(0.2, lambda: goal.finish(GoalStatus.SUCCEEDED, result))

        robot.advertise_action("/navigate_to_pose", registry.action("nav2_msgs/NavigateToPose"), navigate)
        values = {
            ("/tf", "tf2_msgs/TFMessage"): {"transforms": [_TRANSFORM]},
        }
        publishers = [
            (
                robot.advertise(topic, registry.message(type)),
                Payload.from_value(registry.message(type), value),
            )
            for (topic, type), value in values.items()
        ]
        battery = diagnostic.DiagnosticArray(
            status=[diagnostic.DiagnosticStatus(name="battery", message="full")]
        )
        plants = visualization.MarkerArray(markers=[visualization.Marker(ns="garden", id=7)])
        print("ready", flush=True)
        while True:
            diagnostics.publish(battery)
            own.publish(tests.BasicTypes(int32_value=7))
            markers.publish(plants)
            for publisher, payload in publishers:
                publisher.publish(payload)
            await anyio.sleep(_INTERVAL_SECONDS)


if __name__ == "__main__":
    anyio.run(_run)
