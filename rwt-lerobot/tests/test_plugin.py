"""Devices for LeRobot, on its base classes or their fakes, against a server with an arm behind a gate."""

from __future__ import annotations

import inspect
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lerobot.cameras import Camera, CameraConfig
from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.robots import Robot, RobotConfig, make_robot_from_config
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig, make_teleoperator_from_config

import lerobot_robot_rosbridge
from rwt import Server
from rwt_lerobot import LeRobotNode
from rwt_lerobot.plugin.connection import CommandRejected, DeviceError, DoesNotFollow, StaleData
from rwt_lerobot.plugin.robot import Following, FrameCount
from rwt_participant.images import compressed_image
from rwt_participant.qos import LATCHED

JOINTS = {"joints": ["pan", "lift", "gripper"]}
RULE: dict[str, Any] = {
    "topics": ["/arm_controller/joint_trajectory"],
    "emergency": True,
    "lease": {"seconds": 0.5},
    "stop": {},
    "fields": {"points[].positions[]": {"max": 1.6}},
}


class Bench:
    """Server with a fake arm, in a thread."""

    def __init__(self, robot: Any, arm: Any, tmp_path: Path) -> None:
        self.robot = robot
        self.url = robot.server.urls[0]
        self.arm = arm
        self.node = LeRobotNode(robot.node, arm, rate=100.0)
        self._folder = tmp_path

    def device(self, **changes: Any) -> Any:
        # Unless a test is about old messages, none is too old for a busy machine.
        return robot_at(self.url, self._folder, **{"max_age": 30.0, **changes})

    @contextmanager
    def connected(self, **changes: Any) -> Iterator[Any]:
        device = self.device(**changes)
        device.connect()
        yield device
        device.disconnect()

    def camera(self, topic: str, **changes: Any) -> Any:
        """Return the configuration of a camera."""
        return CameraConfig.get_choice_class("rosbridge")(topic=topic, url=self.url, **changes)


def robot_at(url: str, folder: Path, **changes: Any) -> Any:
    config = RobotConfig.get_choice_class("rosbridge")
    return make_robot_from_config(config(url=url, calibration_dir=folder, **JOINTS, **changes))


@pytest.fixture
def bench(arm: Any, tmp_path: Path) -> Iterator[Bench]:
    with Server("ws://127.0.0.1:0", gate={"rules": {"arm": RULE}}) as robot:
        bench = Bench(robot, arm, tmp_path)
        yield bench
        bench.node.close()


def _rest(device: Any) -> dict[str, Any]:
    """Return the action that holds the device where it is."""
    observed = device.get_observation()
    return {name: observed[name] for name in device.action_features}


def _until(condition: Callable[[], bool], step: Callable[[], object]) -> None:
    """Repeat a step until a condition holds."""
    end = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < end, "the condition does not become true"
        step()
        time.sleep(0.02)


def _has_action(teleoperator: Any, degrees: Any) -> bool:
    return bool(teleoperator.get_action()["pan.pos"] == degrees)


def _error(device: Any, action: dict[str, Any] | None = None) -> Exception:
    """Run a loop like LeRobot's until it raises, and return the error."""
    end = time.monotonic() + 20
    while time.monotonic() < end:
        try:
            observed = device.get_observation()
            device.send_action(action or {name: observed[name] for name in device.action_features})
        except (DeviceError, TimeoutError) as error:
            return error
        time.sleep(0.02)
    raise AssertionError("the loop did not raise")


def _stream(device: Any, action: dict[str, Any], period: float = 0.03) -> None:
    """Command as LeRobot's loop does, long enough for the gate to know the pace."""
    for _ in range(6):
        device.get_observation()
        device.send_action(action)
        time.sleep(period)


COMMON = "action_features is_connected connect is_calibrated calibrate configure disconnect"


@pytest.mark.parametrize(
    ("base", "methods"),
    [
        (Robot, f"{COMMON} observation_features get_observation send_action"),
        (Teleoperator, f"{COMMON} feedback_features get_action send_feedback"),
        (Camera, "is_connected find_cameras connect read async_read disconnect"),
    ],
)
def test_the_base_classes_ask_for_these_methods(base: Any, methods: str) -> None:
    assert base.__abstractmethods__ == {*methods.split()}


def test_signatures_are_those_of_the_base_classes() -> None:
    pairs = (
        (Robot, lerobot_robot_rosbridge.RosbridgeRobot),
        (Teleoperator, lerobot_robot_rosbridge.RosbridgeTeleoperator),
        (Camera, lerobot_robot_rosbridge.RosbridgeCamera),
    )
    for base, device in pairs:
        for name in (*base.__abstractmethods__, "read_latest"):
            method = getattr(base, name, None)
            if callable(method):
                ours = inspect.signature(getattr(device, name)).parameters
                assert [*ours] == [*inspect.signature(method).parameters]


def test_lerobots_factories_find_the_devices(bench: Bench, tmp_path: Path) -> None:
    assert isinstance(bench.device(), lerobot_robot_rosbridge.RosbridgeRobot)
    config = TeleoperatorConfig.get_choice_class("rosbridge")(calibration_dir=tmp_path)
    assert config.type == "rosbridge"
    teleoperator = make_teleoperator_from_config(config)
    assert isinstance(teleoperator, lerobot_robot_rosbridge.RosbridgeTeleoperator)
    camera = CameraConfig.get_choice_class("rosbridge")(topic="/front")
    assert isinstance(
        make_cameras_from_configs({"front": camera})["front"], lerobot_robot_rosbridge.RosbridgeCamera
    )


def test_observations_and_actions(bench: Bench) -> None:
    camera = bench.camera("/front/image_raw/compressed", width=32, height=24, fps=30)
    device = bench.device(cameras={"front": camera})
    assert device.observation_features == {
        **dict.fromkeys(("pan.pos", "lift.pos", "gripper.pos"), float),
        "front": (24, 32, 3),
    }
    device.connect()
    observed = device.get_observation()
    assert observed.keys() == device.observation_features.keys()
    assert observed["front"].shape == (24, 32, 3)
    assert observed["front"].dtype == "uint8"
    assert observed["pan.pos"] == pytest.approx(10.0)
    wanted = {"pan.pos": 20.0, "lift.pos": 5.0, "gripper.pos": 40.0}
    assert device.send_action(wanted) == wanted
    _until(lambda: abs(device.get_observation()["pan.pos"] - 20.0) < 0.1, lambda: device.send_action(wanted))
    assert bench.arm.positions["pan.pos"] == pytest.approx(20.0, abs=0.1)
    device.disconnect()
    assert not device.is_connected


def _beyond(bench: Bench) -> dict[str, float]:
    return {"pan.pos": 92.0, "lift.pos": 0.0, "gripper.pos": 0.0}  # 1.605 rad: the gate allows 1.6.


def _too_far(bench: Bench) -> dict[str, float]:
    return {"pan.pos": 80.0, "lift.pos": 0.0, "gripper.pos": 0.0}  # More than 1 rad at once.


def _stopped(bench: Bench) -> None:
    bench.robot.call("/gate/stop", {"reason": "somebody is near"}, "rwt_gate_msgs/Stop")


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (_beyond, "points\\[0\\].positions\\[0\\]: expected at most 1.6, got 1.60"),
        (_too_far, "pan is 1.22 rad away from 1.4 rad; a command without a time"),
        (_stopped, "emergency stop"),
    ],
)
def test_rejections_by_gate_and_robot_raise(bench: Bench, make: Callable[[Bench], Any], text: str) -> None:
    with bench.connected() as device, pytest.raises(CommandRejected, match=text):
        raise _error(device, make(bench))


@pytest.mark.parametrize("is_silent", [False, True], ids=["is commanding", "fell silent"])
def test_one_of_two_clients_holds_the_lease(bench: Bench, is_silent: bool) -> None:
    with bench.connected() as first, bench.connected() as second:
        rest = _rest(first)
        first.send_action(rest)
        if is_silent:
            time.sleep(0.8)  # The lease ends after 0.5 s of silence, and the other client takes it.
        holder, other = (second, first) if is_silent else (first, second)
        holder.send_action(rest)
        time.sleep(0.2)  # So that it arrives before the first of the other, also on a busy machine.

        def both() -> None:
            holder.send_action(rest)
            time.sleep(0.02)
            other.get_observation()
            other.send_action(rest)

        with pytest.raises(CommandRejected, match="is held by"):
            _until(lambda: False, both)
        holder.get_observation()


def test_an_unplugged_bus_raises_its_cause(bench: Bench) -> None:
    with bench.connected() as device:
        device.send_action(_rest(device))
        bench.arm.error = ConnectionError("no status packet")
        text = "the robot does not answer: ConnectionError: no status packet"
        with pytest.raises(CommandRejected, match=text):
            raise _error(device)


def test_commands_that_waited_in_a_stalled_connection_raise(bench: Bench) -> None:
    with bench.connected() as device:
        rest = _rest(device)
        _stream(device, rest)
        time.sleep(0.8)  # The connection stalls, and delivers all at once afterwards.
        end = time.monotonic() + 20
        with pytest.raises(CommandRejected, match=r"waited in a stalled connection for more than 0\.5 s"):
            while time.monotonic() < end:
                device.send_action(rest)


def test_a_pause_between_episodes_is_no_stall(bench: Bench) -> None:
    # Slow, so that a busy machine does not deliver three commands within a quarter of their time.
    with bench.connected(fps=10) as device:
        rest = _rest(device)
        for _ in range(3):
            _stream(device, rest, period=0.1)
            time.sleep(0.8)  # Longer than the lease lasts, as when an episode is saved.
        device.get_observation()


def test_a_state_that_does_not_follow_raises(bench: Bench) -> None:
    bench.arm.is_stuck = True
    text = r"pan is at 0.175 rad, was commanded to 0.698 rad"
    with bench.connected(follow_seconds=0.3) as device, pytest.raises(DoesNotFollow, match=text):
        raise _error(device, {"pan.pos": 40.0, "lift.pos": 0.0, "gripper.pos": 50.0})


def test_states_that_stop_raise(bench: Bench) -> None:
    with bench.connected(max_age=0.3) as device:
        bench.node.close()
        with pytest.raises(StaleData, match=r"the last message on /joint_states is 0.3"):
            raise _error(device)


def test_a_camera_that_stalls_raises(bench: Bench) -> None:
    camera = make_cameras_from_configs({"front": bench.camera("/front/image_raw/compressed")})["front"]
    camera.connect()
    assert camera.read().shape == camera.async_read(2000).shape == (24, 32, 3)
    bench.node.close()
    time.sleep(0.3)
    with pytest.raises(TimeoutError, match=r"old; the limit is 0.2 s"):
        camera.read_latest(200)
    with pytest.raises(TimeoutError, match="no new image"):
        camera.async_read(50)
    camera.disconnect()


def test_a_camera_that_stalls_ends_the_loop_of_its_robot(bench: Bench) -> None:
    camera = bench.camera("/wrist/compressed", width=32, height=24, fps=30, max_age=0.3)
    lens = bench.robot.advertise("/wrist/compressed", "sensor_msgs/CompressedImage", qos=LATCHED)
    lens.publish(compressed_image(np.zeros((24, 32, 3), np.uint8), frame_id="wrist"))
    text = r"the last message on /wrist/compressed is 0.3\d s old"
    with bench.connected(cameras={"wrist": camera}) as device, pytest.raises(TimeoutError, match=text):
        raise _error(device)


def test_a_teleoperator_repeats_the_last_command(bench: Bench, tmp_path: Path) -> None:
    config = TeleoperatorConfig.get_choice_class("rosbridge")(
        url=bench.url, calibration_dir=tmp_path, **JOINTS
    )
    teleoperator = make_teleoperator_from_config(config)
    teleoperator.connect()
    assert teleoperator.get_action()["pan.pos"] == pytest.approx(10.0)
    # The arm has not moved when it is to hold.
    for points, degrees in (([{"positions": [math.pi / 4]}], 45.0), ([], 10.0)):
        trajectory = {"joint_names": ["pan"], "points": points}
        # Again and again: the first ones may precede the subscription.
        command = partial(
            bench.robot.publish, "/teleop/joint_trajectory", trajectory, "trajectory_msgs/JointTrajectory"
        )
        wanted = pytest.approx(degrees)
        _until(partial(_has_action, teleoperator, wanted), command)
        assert teleoperator.get_action()["pan.pos"] == pytest.approx(degrees)
    assert teleoperator.get_action().keys() == teleoperator.action_features.keys()
    teleoperator.disconnect()


SERVER = """
import sys
sys.path.insert(0, {tests!r})
from conftest import FakeArm
from rwt import Server
from rwt_lerobot import LeRobotNode
with Server("ws://127.0.0.1:0") as robot:
    LeRobotNode(robot.node, FakeArm(), rate=100.0)
    print(robot.server.urls[0], flush=True)
    sys.stdin.read()
"""


def test_a_killed_server_raises_at_once(tmp_path: Path) -> None:
    program = [sys.executable, "-c", SERVER.format(tests=str(Path(__file__).parent))]
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        url = server.stdout.readline().strip()
        # No state is too old: the end of the connection raises. `python -m bench.lerobot` measures its time.
        device = robot_at(url, tmp_path, max_age=1000.0)
        device.connect()
        device.get_observation()
        os.kill(server.pid, signal.SIGKILL)
        with pytest.raises(DeviceError, match=f"the connection to {url} was lost: "):
            raise _error(device)
    device.disconnect()


def test_late_frames_are_counted() -> None:
    count = FrameCount(10)
    for at in (0.0, 0.1, 0.2, 0.36, 0.46, 8.0, 8.1):  # One late frame, and a pause between episodes.
        count.note(at)
    said = "1 of 7 frames were late (14.3 %); 8.9 frames per second, 99 % of them at most 60 ms late"
    assert str(count) == said


def test_late_frames_are_reported_at_the_end(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("WARNING", "rwt_lerobot"), bench.connected(fps=1000) as device:
        for _ in range(10):
            device.get_observation()
            time.sleep(0.01)
    assert "of 10 frames were late" in caplog.text
    assert "recorded time is shorter than real time" in caplog.text


def test_progress_towards_the_command_is_no_error() -> None:
    following = Following(tolerance=0.2, seconds=1.0)
    for number in range(40):
        following.check({"pan": 2.0}, {"pan": number * 0.03}, number * 0.5)
    following.check({"pan": 2.0}, {"pan": 1.17}, 20.4)
    with pytest.raises(DoesNotFollow, match="has not moved for"):
        following.check({"pan": 2.0}, {"pan": 1.17}, 21.0)


def test_a_server_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match=r"cannot connect to ws://127.0.0.1:1"):
        robot_at("ws://127.0.0.1:1", tmp_path).connect()
