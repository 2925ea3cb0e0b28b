"""The simulated Husky with its arm, in one process on a simulated clock."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import anyio
import anyio.lowlevel
import numpy as np
import pytest

from rwt.extensions.demo.world.lens import Lens
from rwt.extensions.meshes.mesh_files import MeshFiles
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_participant.errors import GoalRejected
from rwt_participant.goals import Goal, GoalStatus
from rwt_tf2 import Buffer, read_transform

pytest.importorskip("pybullet", reason="PyBullet has wheels for Linux only")

from husky_xarm.arm import ACTION
from husky_xarm.camera import Renderer, RendererGone, draw
from husky_xarm.description import ARM_JOINTS, OPTICAL, PACKAGE_FOLDERS, ROOT, describe
from husky_xarm.film import keep
from husky_xarm.robot import HuskyXArm
from husky_xarm.scene import HOME, Scene

pytestmark = pytest.mark.anyio

LENS = Lens(160, 120)
#: Of a goal that the arm reaches in a second.
REACH = (0.4, -0.6, -0.9, 0.2, 1.3, 0.5)


@dataclass
class Lab:
    """The robot's surroundings; messages are what ROS payloads are, so they are not typed."""

    graph: MemoryGraph
    clock: SimulatedClock
    user: Node

    def watch(self, topic: str) -> list[Any]:
        heard: list[Any] = []
        self.user.subscribe(topic, heard.append)
        return heard

    async def drive(self, linear: float, angular: float, seconds: float) -> None:
        stick = self.user.advertise("/cmd_vel", "geometry_msgs/Twist")
        for _ in range(round(seconds * 10)):
            stick.publish({"linear": {"x": linear}, "angular": {"z": angular}})
            await self.pass_time(0.1)
        stick.close()

    async def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            self.clock.advance(0.05)
            for _ in range(10):
                await anyio.lowlevel.checkpoint()

    async def result(self, goal: Goal, within: float = 5.0) -> tuple[GoalStatus, Any]:
        """Let time pass until the goal has ended."""
        for _ in range(round(within * 20)):
            await self.pass_time(0.05)
            if goal.status >= GoalStatus.SUCCEEDED:
                return await goal.result()
        raise AssertionError(f"the goal is {goal.status!r} after {within} s")


@pytest.fixture
async def lab() -> AsyncIterator[Lab]:
    clock = SimulatedClock(1_767_225_600_000_000_000)
    async with MemoryGraph(clock=clock) as graph:
        robot = HuskyXArm(graph, LENS, camera_rate=10)
        yield Lab(graph, clock, Node(graph, "user"))
        robot.close()


def trajectory(
    *points: tuple[float, tuple[float, ...]], names: tuple[str, ...] = ARM_JOINTS
) -> dict[str, Any]:
    return {
        "trajectory": {
            "joint_names": names,
            "points": [
                {
                    "positions": positions,
                    "time_from_start": {"sec": int(at // 1), "nanosec": round(at % 1 * 1e9)},
                }
                for at, positions in points
            ],
        }
    }


async def test_it_drives_as_fast_as_it_is_told_and_stops_in_the_silence(lab: Lab) -> None:
    odometry = lab.watch("/odom")
    await lab.drive(0.5, 0.0, 2.0)
    gone = odometry[-1].pose.pose.position.x
    assert gone == pytest.approx(1.0 - 0.5 * 0.5 / 1.5 / 2, abs=0.08)  # less the time to get up to speed
    assert odometry[-1].twist.twist.linear.x == pytest.approx(0.5, abs=0.03)
    await lab.pass_time(1.5)
    assert odometry[-1].twist.twist.linear.x == pytest.approx(0.0, abs=0.01)
    assert odometry[-1].pose.pose.position.x < gone + 0.6


@pytest.mark.parametrize("rate", [0.5, -1.0])
async def test_it_turns_about_as_fast_as_it_is_told(lab: Lab, rate: float) -> None:
    odometry = lab.watch("/odom")
    await lab.drive(0.0, rate, 1.0)
    before = len(odometry)
    await lab.drive(0.0, rate, 1.0)
    rates = [message.twist.twist.angular.z for message in odometry[before:]]
    assert np.mean(rates) == pytest.approx(rate, rel=0.25)


async def test_the_frames_are_one_tree_with_odometrys_pose(lab: Lab) -> None:
    moving, odometry = lab.watch("/tf"), lab.watch("/odom")
    fixed = lab.watch("/tf_static")
    await lab.drive(0.4, 0.3, 0.5)
    buffer = Buffer()
    for transform in fixed[-1].transforms:
        buffer.set_transform(read_transform(transform), static=True)
    for transform in moving[-1].transforms:
        buffer.set_transform(read_transform(transform))
    links = {link.get("name", "") for link in ET.fromstring(describe().urdf).iter("link")}
    for link in links:
        buffer.lookup_transform("odom", link)
    children = [t.child_frame_id for t in (*fixed[-1].transforms, *moving[-1].transforms)]
    assert sorted(children) == sorted(links)
    position = odometry[-1].pose.pose.position
    found = buffer.lookup_transform("odom", ROOT).transform.translation
    assert found == pytest.approx((position.x, position.y, position.z))


async def test_transforms_are_where_bullet_has_the_links(lab: Lab, scene: Scene) -> None:
    """The arm's pose by the joint angles that are told, against what Bullet says of the same angles."""
    moving, joints = lab.watch("/tf"), lab.watch("/joint_states")
    fixed = lab.watch("/tf_static")
    await lab.pass_time(0.2)
    buffer = Buffer()
    for transform in (*fixed[-1].transforms, *moving[-1].transforms):
        buffer.set_transform(read_transform(transform), static=True)
    for name, angle in zip(joints[-1].name, joints[-1].position, strict=True):
        scene.bullet.resetJointState(scene.robot, scene.joint_numbers[name], angle)
    scene.bullet.resetBasePositionAndOrientation(scene.robot, (0, 0, 0), (0, 0, 0, 1))
    for link in ("link6", OPTICAL, "rear_right_wheel_link"):
        state = scene.bullet.getLinkState(
            scene.robot, scene.link_numbers[link], computeForwardKinematics=True
        )
        found = buffer.lookup_transform(ROOT, link).transform
        assert found.translation == pytest.approx(state[4], abs=1e-4)
        assert abs(np.dot(found.rotation, state[5])) == pytest.approx(1.0, abs=1e-5)


async def test_the_arm_follows_a_trajectory(lab: Lab) -> None:
    joints = lab.watch("/joint_states")
    feedback: list[Any] = []
    names = tuple(reversed(ARM_JOINTS))  # in any order
    goal = await lab.user.send_goal(
        ACTION,
        trajectory((0.0, tuple(reversed(HOME.values()))), (1.5, tuple(reversed(REACH))), names=names),
        on_feedback=feedback.append,
    )
    status, result = await lab.result(goal)
    assert (status, result.error_code) == (GoalStatus.SUCCEEDED, 0)
    positions = dict(zip(joints[-1].name, joints[-1].position, strict=True))
    assert [positions[name] for name in ARM_JOINTS] == pytest.approx(REACH, abs=0.02)
    assert len(feedback) >= 10
    assert list(feedback[-1].joint_names) == list(ARM_JOINTS)
    errors = np.array(feedback[-1].desired.positions) - np.array(feedback[-1].actual.positions)
    assert feedback[-1].error.positions == pytest.approx(errors)


async def test_a_cancelled_arm_stands_still(lab: Lab) -> None:
    joints = lab.watch("/joint_states")
    goal = await lab.user.send_goal(ACTION, trajectory((3.0, REACH)))
    await lab.pass_time(1.0)
    goal.cancel()
    status, _ = await lab.result(goal)
    assert status is GoalStatus.CANCELED
    await lab.pass_time(0.5)
    stopped = list(joints[-1].position)
    await lab.pass_time(1.0)
    assert joints[-1].position == pytest.approx(stopped, abs=5e-3)


async def test_a_newer_goal_takes_the_place_of_the_one_before(lab: Lab) -> None:
    first = await lab.user.send_goal(ACTION, trajectory((3.0, REACH)))
    await lab.pass_time(0.5)
    second = await lab.user.send_goal(ACTION, trajectory((1.0, tuple(HOME.values()))))
    status, result = await lab.result(first)
    assert (status, result.error_string) == (GoalStatus.ABORTED, "a newer goal took its place")
    assert (await lab.result(second))[0] is GoalStatus.SUCCEEDED


async def test_an_arm_that_does_not_get_there_says_where_it_is(lab: Lab) -> None:
    request = trajectory((0.3, REACH))
    request["goal_tolerance"] = [{"name": "joint2", "position": 1e-12}]
    request["goal_time_tolerance"] = {"sec": 0, "nanosec": 200_000_000}
    goal = await lab.user.send_goal(ACTION, request)
    status, result = await lab.result(goal)
    assert (status, result.error_code) == (GoalStatus.ABORTED, -5)
    assert "joint2 is at " in result.error_string and "was to be at -0.600" in result.error_string


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        (trajectory((1.0, REACH), names=("joint1",)), "it must be of joint1, joint2"),
        (trajectory(), "the trajectory has no points"),
        (trajectory((0.0, REACH)), "point 1 is at 0 s and the arm is elsewhere; give it time to get there"),
        (trajectory((1.0, REACH), (1.0, REACH)), "point 2 is at 1 s; it must be later than 1 s"),
        (trajectory((1.0, REACH[:5])), "point 1: 5 positions for 6 joints"),
        (
            trajectory((1.0, (0.0, 3.0, 0.0, 0.0, 0.0, 0.0))),
            "joint2 cannot be at 3 rad, only from -2.059 to 2.094",
        ),
        (trajectory((1.0, (math.nan, 0.0, 0.0, 0.0, 0.0, 0.0))), "joint1 cannot be at nan rad"),
    ],
)
async def test_goals_that_the_arm_cannot_do_are_rejected(
    lab: Lab, request_: dict[str, Any], reason: str
) -> None:
    with pytest.raises(GoalRejected, match=reason):
        await lab.user.send_goal(ACTION, request_)


async def test_pictures_come_with_their_camera_infos_while_somebody_listens(lab: Lab) -> None:
    await lab.pass_time(1.0)
    colours, depths = lab.watch("/camera/image_raw"), lab.watch("/camera/depth/image_raw")
    infos = lab.watch("/camera/camera_info")
    with anyio.fail_after(25):
        while not (colours and depths):
            await lab.pass_time(0.1)
            await anyio.sleep(0.01)  # the renderer lives in real time
    assert (colours[0].width, colours[0].height, colours[0].encoding) == (160, 120, "rgb8")
    assert (depths[0].step, depths[0].encoding, len(depths[0].data)) == (320, "16UC1", 160 * 120 * 2)
    assert colours[0].header == depths[0].header
    assert colours[0].header.frame_id == infos[0].header.frame_id == OPTICAL
    assert infos[0].k[0] == pytest.approx(LENS.focal)


def test_colour_and_depth_show_the_same_things_where_they_are(scene: Scene) -> None:
    # Out of the picture with the arm: it stands before the red block.
    scene.bullet.resetJointState(scene.robot, scene.joint_numbers["joint1"], math.pi)
    place = scene.bullet.getLinkState(scene.robot, scene.link_numbers[OPTICAL], computeForwardKinematics=True)
    picture = draw(scene, LENS)
    red, green, blue = (picture.colours[:, :, channel].astype(int) for channel in range(3))
    columns = {}
    for name, (mask, (x, y, z)) in {
        "green": ((green > 2 * red) & (green > 2 * blue), (3.0 - 0.35, 1.2, 0.35)),
        "red": ((red > 2 * green) & (red > 2 * blue) & (picture.depths > 1500), (2.2 - 0.25, 0.0, 0.25)),
        "blue": ((blue > 1.5 * green) & (blue > 2 * red) & (picture.depths > 1500), (2.8 - 0.2, -1.3, 0.2)),
    }.items():
        assert mask.sum() > 30, name
        columns[name] = np.nonzero(mask)[1].mean()
        # Along the optical axis, from the camera to the middle of the block's front.
        axis = np.array(scene.bullet.getMatrixFromQuaternion(place[5])).reshape(3, 3)[:, 2]
        expected = float(np.dot(np.array((x, y, z)) - place[4], axis))
        assert np.median(picture.depths[mask]) / 1000 == pytest.approx(expected, abs=0.2), name
    assert columns["green"] < columns["red"] < columns["blue"]
    assert (picture.depths[0] == 0).all()  # the sky


def test_every_mesh_is_in_a_package_that_is_served() -> None:
    packages = MeshFiles(PACKAGE_FOLDERS)
    meshes = {mesh.get("filename", "") for mesh in ET.fromstring(describe().urdf).iter("mesh")}
    assert len(meshes) > 10
    for mesh in meshes:
        package, _, _ = mesh.removeprefix("package://").partition("/")
        assert mesh.startswith("package://") and package in packages.names
    assert "package://" not in describe().with_paths()


def test_colours_have_names_of_their_own() -> None:
    """Viewers take two materials of one name for the same."""
    colours: dict[str, str] = {}
    for material in ET.fromstring(describe().urdf).iter("material"):
        colour = material.find("color")
        assert colour is not None
        name, rgba = material.get("name", ""), colour.get("rgba", "")
        assert colours.setdefault(name, rgba) == rgba
        assert len(rgba.split(" ")) == 4
    assert len(set(colours.values())) >= 6


@pytest.fixture
def scene() -> Iterator[Scene]:
    scene = Scene()
    yield scene
    scene.close()


@pytest.fixture
def renderer() -> Iterator[Renderer]:
    renderer = Renderer(LENS)
    yield renderer
    renderer.close()


def test_a_renderer_that_was_killed_says_so(renderer: Renderer, scene: Scene) -> None:
    snapshot = scene.snapshot()
    assert renderer.draw(snapshot).colours.shape == (120, 160, 3)
    os.kill(renderer.pid, signal.SIGKILL)
    with pytest.raises(RendererGone, match="has ended"):
        for _ in range(100):
            renderer.draw(snapshot)
            time.sleep(0.05)


def test_a_film_is_drawn_once_and_moves(tmp_path: Path) -> None:
    drawn: list[int] = []
    film = keep(tmp_path, Lens(80, 60), pictures=4, rate=2.0, on_picture=drawn.append)
    assert (film.colours.shape, film.depths.shape) == ((4, 60, 80, 3), (4, 60, 80))
    assert drawn == [1, 2, 3, 4]
    for before, after in zip(film.depths, film.depths[1:], strict=False):
        assert (before != after).mean() > 0.2
    again = keep(tmp_path, Lens(80, 60), pictures=4, rate=2.0, on_picture=drawn.append)
    assert len(drawn) == 4 and (again.colours == film.colours).all()
    keep(tmp_path, Lens(80, 60), pictures=1, rate=2.0, on_picture=drawn.append)
    assert len(drawn) == 5


def test_a_film_that_was_broken_off_is_drawn_anew(tmp_path: Path) -> None:
    def break_off(number: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        keep(tmp_path, Lens(40, 30), pictures=2, on_picture=break_off)
    film = keep(tmp_path, Lens(40, 30), pictures=2)
    assert film.colours[1].any()


def test_a_snapshot_puts_everything_back(scene: Scene) -> None:
    before = scene.snapshot()
    scene.bullet.resetJointState(scene.robot, scene.joint_numbers["joint3"], -1.0)
    scene.bullet.resetBasePositionAndOrientation(scene.robot, (1.0, 2.0, 0.5), (0, 0, 1, 0))
    assert scene.snapshot() != before
    scene.restore(before)
    after = scene.snapshot()
    assert after.joints == pytest.approx(before.joints)
    for (position, orientation), (was_at, was_turned) in zip(after.bodies, before.bodies, strict=True):
        assert position == pytest.approx(was_at) and orientation == pytest.approx(was_turned)
