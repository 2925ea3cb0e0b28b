"""One who teaches: watches the camera and the robot's joints and frames, drives it, records waypoints."""

from __future__ import annotations

import itertools
import signal
import time
from multiprocessing.connection import Connection
from typing import Any

import anyio
import anyio.to_thread

from rwt_client import Robot, connect
from teaching.camera_stream import CameraStream
from teaching.plan import COMMAND_PERIOD, LEG, LEGS, TF_RATE, Velocity
from teaching.report import Teaching

_FRAMES = ("base_link", "laser", "camera_link", "left_wheel_link", "right_wheel_link")
#: Metres per second: more than nothing, and less than one control step of the robot makes of a command.
_EFFECT = 0.005


def demonstrate(pipe: Connection[str | Teaching, str], url: str, robot: str, seconds: float) -> None:
    """The process: says that it is ready, waits for a word, teaches for so long, and says what it saw.

    Ctrl-C is for the process that started it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    anyio.run(_demonstrate, pipe, url, robot, seconds)


async def _demonstrate(pipe: Connection[str | Teaching, str], url: str, name: str, seconds: float) -> None:
    async with connect(url) as robot:
        demonstrator = Demonstrator(robot, name)
        await demonstrator.watch()
        camera = await anyio.to_thread.run_sync(CameraStream, url, f"/{name}/camera/image_raw")
        pipe.send("ready")
        await anyio.to_thread.run_sync(pipe.recv)
        camera.clear()
        teaching = await demonstrator.teach(seconds, camera)
        pipe.send(teaching)
        await anyio.to_thread.run_sync(camera.close)


class Demonstrator:
    """Teaches one robot.

    Args:
        robot: the server.
        name: the robot's namespace.
    """

    def __init__(self, robot: Robot, name: str) -> None:
        self._robot = robot
        self._name = name
        self._joint_states = 0
        self._transforms = 0
        self._place: tuple[float, float] | None = None
        self._waypoints: list[tuple[float, float]] = []
        self._speed = 0.0
        self._turned_at: float | None = None
        self._turned_from = 0.0
        self._direction = 0.0
        self._latencies: list[float] = []

    async def watch(self) -> None:
        """Subscribe to what a page of a teacher shows."""
        await self._robot.subscribe(
            f"/{self._name}/joint_states", self._on_joint_states, "sensor_msgs/JointState"
        )
        await self._robot.subscribe(f"/{self._name}/odom", self._on_odometry, "nav_msgs/Odometry")
        answer = await self._robot.call(
            "/republish_tfs",
            {
                "source_frames": [f"{self._name}/{frame}" for frame in _FRAMES],
                "target_frame": f"{self._name}/map",
                "angular_thres": 0.01,
                "trans_thres": 0.01,
                "rate": TF_RATE,
            },
            "tf2_web_republisher/RepublishTFs",
        )
        await self._robot.subscribe(answer.topic_name, self._on_transforms, "tf2_web_republisher/TFArray")

    async def teach(self, seconds: float, camera: CameraStream) -> Teaching:
        """Drive by hand for so long, and record a waypoint after each leg."""
        stick = await self._robot.advertise(f"/{self._name}/cmd_vel", "geometry_msgs/Twist")
        self._joint_states = self._transforms = commands = 0
        computed, began = time.process_time(), time.monotonic()
        for leg in itertools.cycle(LEGS):
            self._turn_to(leg)
            for _ in range(round(LEG / COMMAND_PERIOD)):
                stick.publish({"linear": {"x": leg.linear}, "angular": {"z": leg.angular}})
                commands += 1
                await anyio.sleep(max(0.0, began + commands * COMMAND_PERIOD - time.monotonic()))
            self._record()
            if time.monotonic() - began >= seconds:
                break
        took, computed = time.monotonic() - began, time.process_time() - computed
        ages = tuple(camera.ages)
        return Teaching(
            self._name,
            took,
            len(ages),
            ages,
            self._transforms,
            self._joint_states,
            commands,
            tuple(self._latencies),
            len(self._waypoints),
            computed,
        )

    def _turn_to(self, leg: Velocity) -> None:
        """The next command is one whose effect is waited for."""
        self._turned_at, self._turned_from = time.monotonic(), self._speed
        self._direction = 1.0 if leg.linear > self._speed else -1.0

    def _record(self) -> None:
        """Record the robot's position, as its transforms report it."""
        if self._place is not None:
            self._waypoints.append(self._place)

    def _on_joint_states(self, message: Any) -> None:
        self._joint_states += 1

    def _on_transforms(self, message: Any) -> None:
        self._transforms += 1
        for transform in message.transforms:
            if transform.child_frame_id == f"{self._name}/base_link":
                place = transform.transform.translation
                self._place = (place.x, place.y)

    def _on_odometry(self, message: Any) -> None:
        self._speed = message.twist.twist.linear.x
        if self._turned_at is None:
            return
        if (self._speed - self._turned_from) * self._direction > _EFFECT:
            self._latencies.append(time.monotonic() - self._turned_at)
            self._turned_at = None
