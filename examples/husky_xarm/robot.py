"""The robot: every part of it, joined on one node."""

from __future__ import annotations

from husky_xarm.arm import Arm
from husky_xarm.camera_topics import CameraPublisher
from husky_xarm.description import describe
from husky_xarm.simulation import Simulation
from husky_xarm.state import StatePublisher
from rwt.extensions.demo.drive import STANDSTILL, Teleop
from rwt.extensions.demo.world.lens import Lens
from rwt_graph import Graph, Node

CONTROL_PERIOD = 1 / 30
"""Seconds from one control step, and one publication of the state, to the next."""
#: The longest time that one step makes up for when the program was held up, seconds.
_LONGEST_STEP = 0.2


class HuskyXArm:
    """A simulated Husky with an xArm 6 on it.

    It drives by `/cmd_vel`, moves its arm by :data:`husky_xarm.arm.ACTION`, and publishes what `state` and
    `camera_topics` say.

    Args:
        graph: where it lives; all its timing is the graph's clock.
        lens: of the camera.
        camera_rate: pictures a second, at most.
    """

    def __init__(self, graph: Graph, lens: Lens, camera_rate: float) -> None:
        self._node = Node(graph, "husky_xarm")
        self._simulation = Simulation()
        self._teleop = Teleop(self._node)
        self._arm = Arm(self._node, self._simulation)
        self._state = StatePublisher(self._node, self._simulation, describe())
        self._camera = CameraPublisher(self._node, self._simulation, lens, camera_rate)
        self._stepped = self._node.clock.monotonic()
        self._node.create_timer(CONTROL_PERIOD, self._step)

    def close(self) -> None:
        """Leave the graph."""
        self._node.close()
        self._camera.close()
        self._simulation.close()

    def _step(self) -> None:
        """Run one control step: commands, elapsed time, and state to publish."""
        now = self._node.clock.monotonic()
        seconds = min(now - self._stepped, _LONGEST_STEP)
        self._stepped = now
        self._simulation.drive(self._teleop.velocity or STANDSTILL)
        self._arm.step()
        self._simulation.advance(seconds)
        self._state.publish()
