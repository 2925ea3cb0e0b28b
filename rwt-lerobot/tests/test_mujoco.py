"""The simulated arm. Needs MuJoCo, which the default tests have not: `make test-lerobot`."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import anyio.lowlevel
import pytest

from rwt import Server, connect
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_lerobot.joints.limits import urdf_limits
from rwt_participant.errors import RobotError
from rwt_participant.goals import GoalStatus
from rwt_participant.images import image_to_numpy

if find_spec("mujoco") is None:  # Not imported here: it reads MUJOCO_GL, which the model sets.
    pytest.skip("MuJoCo is not installed", allow_module_level=True)

from rwt_lerobot.simulation.cameras import Lens
from rwt_lerobot.simulation.model import ARM, Model, ModelError
from rwt_lerobot.simulation.robot import MujocoRobot

ACTION = "/arm_controller/follow_joint_trajectory"
JOINTS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
HOME = [0, -0.5, 1.3, 0.8, 0, 0.2]


def _goal(*positions: float, names: list[str] = JOINTS, sec: int = 1) -> dict[str, Any]:
    points = [{"positions": positions, "time_from_start": {"sec": sec}}]
    return {"trajectory": {"joint_names": names, "points": points}}


class Lab:
    """Simulated arm on a clock that the test moves."""

    def __init__(self, graph: MemoryGraph, clock: SimulatedClock, **options: Any) -> None:
        self.clock = clock
        self.robot = MujocoRobot(graph, **options)
        self.user = Node(graph, "user")

    async def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.02)):
            self.clock.advance(0.02)
            await anyio.lowlevel.checkpoint()

    @property
    def positions(self) -> list[float]:
        return [float(self.robot.data.qpos[joint.position]) for joint in self.robot.model.joints]


@pytest.fixture
async def lab() -> AsyncIterator[Lab]:
    clock = SimulatedClock(1_700_000_000 * 10**9)
    async with MemoryGraph(clock=clock) as graph:
        lab = Lab(graph, clock)
        yield lab
        lab.robot.close()


@pytest.mark.anyio
async def test_the_arm_holds_its_position_at_the_start(lab: Lab) -> None:
    await lab.run(2.0)
    assert lab.positions == pytest.approx(HOME, abs=math.radians(0.5))


@pytest.mark.anyio
async def test_a_goal_moves_it_within_half_a_degree(lab: Lab) -> None:
    there = [0.8, -0.2, 0.9, 0.6, 0.5, 0.8]
    goal = await lab.user.send_goal(ACTION, _goal(*there))
    await lab.run(1.5)
    assert (await goal.result()).status is GoalStatus.SUCCEEDED
    assert lab.positions == pytest.approx(there, abs=math.radians(0.5))


@pytest.mark.anyio
async def test_a_stop_holds_and_does_not_drop_it(lab: Lab) -> None:
    goal = await lab.user.send_goal(ACTION, _goal(1.0, names=["shoulder_pan"]))
    await lab.run(0.5)
    for _ in range(20):
        lab.user.publish("/arm_controller/joint_trajectory", {}, "trajectory_msgs/JointTrajectory")
        await lab.run(0.1)
    assert (await goal.result()).status is GoalStatus.ABORTED
    assert 0.4 < lab.positions[0] < 0.7
    assert lab.positions[1:] == pytest.approx(HOME[1:], abs=math.radians(1))


@pytest.mark.anyio
async def test_limits_of_each_joint(lab: Lab) -> None:
    limits = {each.limit.name: each.limit for each in lab.robot.model.joints}
    assert limits["shoulder_pan"].speed == 2.5
    assert limits["gripper"].upper == pytest.approx(1.2)
    goal = await lab.user.send_goal(ACTION, _goal(2.0, names=["shoulder_pan"]))
    assert "shoulder_pan moves from -1.92 to 1.92 rad, not to 2" in (await goal.result()).result.error_string


@pytest.mark.anyio
async def test_pause_step_reset_clock_and_sensors(lab: Lab) -> None:
    states: list[Any] = []
    clocks: list[Any] = []
    lab.user.subscribe("/joint_states", states.append, "sensor_msgs/JointState")
    lab.user.subscribe("/clock", clocks.append, "rosgraph_msgs/Clock")
    await lab.run(0.2)
    assert [*states[-1].name] == JOINTS
    assert states[-1].header.stamp == clocks[-1].clock
    assert (await lab.user.call("/simulation/step")).message == "the simulation is running: pause it first"
    assert (await lab.user.call("/simulation/pause", {"data": True})).success
    seen = len(states)
    await lab.run(0.5)
    assert len(states) == seen
    before = lab.robot.time_ns
    assert (await lab.user.call("/simulation/step")).success
    assert lab.robot.time_ns - before == 20_000_000
    await lab.user.call("/simulation/pause", {"data": False})
    await lab.user.send_goal(ACTION, _goal(0.5, names=["shoulder_pan"]))
    await lab.run(0.3)
    assert lab.positions[0] > 0.05
    values: list[Any] = []
    lab.user.subscribe("/sensors/grip_position", values.append, "std_msgs/Float64MultiArray")
    assert (await lab.user.call("/simulation/reset")).success
    assert lab.positions == pytest.approx(HOME)
    await lab.run(0.1)
    assert len(values[-1].data) == 3


@pytest.mark.anyio
async def test_the_description_agrees_with_the_transforms(lab: Lab) -> None:
    text = (await lab.user.once("/robot_description")).data
    assert urdf_limits(text)["elbow_flex"].upper == pytest.approx(1.7)
    links = {link.get("name") for link in ET.fromstring(text).iter("link")}
    found: list[Any] = []
    lab.user.subscribe("/tf", found.append, "tf2_msgs/TFMessage")
    await lab.run(0.1)
    frames = {each.child_frame_id for each in found[-1].transforms}
    assert frames >= {"shoulder", "hand", "cube", "front_optical_frame"}
    assert frames | {"world"} >= links
    assert len(list(ET.fromstring(text).iter("visual"))) > 8


def test_models_that_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "model.xml").write_text("<mujoco><worldbody><bdy/></worldbody></mujoco>")
    with pytest.raises(ModelError, match=r"model\.xml: "):
        Model(tmp_path / "model.xml")
    assert Model(ARM).cameras.keys() == {"front", "wrist_camera"}


@pytest.mark.anyio
async def test_an_actuator_without_a_joint_position_has_a_topic(tmp_path: Path) -> None:
    (tmp_path / "motor.xml").write_text(
        "<mujoco><worldbody><body><joint name='wheel' axis='0 1 0'/><geom size='.1'/></body></worldbody>"
        "<actuator><motor name='drive' joint='wheel' ctrlrange='-1 1' ctrllimited='true'/>"
        "</actuator></mujoco>"
    )
    clock = SimulatedClock()
    async with MemoryGraph(clock=clock) as graph:
        lab = Lab(graph, clock, path=tmp_path / "motor.xml")
        lab.user.publish("/actuators/drive", {"data": 0.5}, "std_msgs/Float64")
        await lab.run(0.5)
        assert lab.positions[0] > 0
        lab.user.publish("/actuators/drive", {"data": 5.0}, "std_msgs/Float64")
        assert lab.robot.data.ctrl[0] == 0.5
        lab.robot.close()


@pytest.mark.anyio
async def test_cameras() -> None:
    robot = partial(MujocoRobot, lens=Lens(160, 120, 20))
    async with Server("ws://127.0.0.1:0", extra_nodes=[robot]) as server, connect(server.urls[0]) as user:
        for camera in ("front", "wrist_camera"):
            image = await user.once(
                f"/{camera}/image_raw/compressed", "sensor_msgs/CompressedImage", timeout=20
            )
            pixels = image_to_numpy(image)
            assert pixels.shape == (120, 160, 3)
            assert pixels.std() > 10  # It shows something.
            info = await user.once(f"/{camera}/camera_info", "sensor_msgs/CameraInfo", timeout=60)
            assert (info.width, info.height, info.k[2]) == (160, 120, 80)


@pytest.mark.anyio
async def test_a_viewer_cannot_pause_or_reset_the_simulation() -> None:
    server = Server("ws://127.0.0.1:0", extra_nodes=[MujocoRobot], auth={"default_role": "viewer"})
    async with server, connect(server.urls[0]) as viewer:
        for verb in ("pause", "step", "reset"):
            kind = "std_srvs/SetBool" if verb == "pause" else "std_srvs/Trigger"
            with pytest.raises(RobotError, match=rf"role 'viewer' may not call /simulation/{verb}"):
                await viewer.call(f"/simulation/{verb}", {}, kind, timeout=20)
        await viewer.once("/joint_states", "sensor_msgs/JointState", timeout=60)
