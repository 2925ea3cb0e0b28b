"""Robot of LeRobot that is anything with joint states and trajectories on a rosbridge server."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import cached_property
from itertools import accumulate
from typing import Any, Final

from lerobot.cameras.utils import make_cameras_from_configs
from lerobot.robots import Robot

from rwt_lerobot.joints.controller import TOPIC_TYPE
from rwt_lerobot.joints.features import FeatureMap
from rwt_lerobot.plugin.config import RosbridgeRobotConfig
from rwt_lerobot.plugin.connection import Connection, Device, DeviceError, DoesNotFollow, Latest
from rwt_lerobot.reports import logger
from rwt_participant.blocking import BlockingPublisher

#: Periods after which a frame is late, and seconds after which the loop has paused between episodes.
_LATE_PERIODS: Final = 1.5
_PAUSE_SECONDS: Final = 1.0
#: Periods without an action after which the next one is a new grip of the control.
_GRIP_PERIODS: Final = 3
#: Movement that counts as progress towards a command, radians.
_PROGRESS: Final = 0.02


class FrameCount:
    """Frames of a control loop, and those that came late.

    LeRobot's datasets state `frame_index / fps` as the time of a frame. A late frame makes recorded time
    shorter than real time.

    Attributes:
        frames: number of frames.
        late: number of those that came later than 1.5 periods after the one before.
    """

    def __init__(self, fps: float) -> None:
        self._period = 1.0 / fps
        self._last: float | None = None
        #: Number of intervals by their length in milliseconds, without pauses.
        self._intervals = [0] * (round(_PAUSE_SECONDS * 1000) + 1)
        self.frames = 0
        self.late = 0

    def note(self, now: float) -> None:
        """Count a frame at a time in seconds; after a pause of more than a second counting begins anew."""
        before, self._last = self._last, now
        self.frames += 1
        if before is None or now - before >= _PAUSE_SECONDS:
            return
        self._intervals[round((now - before) * 1000)] += 1
        if now - before > self._period * _LATE_PERIODS:
            self.late += 1

    def __str__(self) -> str:
        share = 100 * self.late / max(1, self.frames)
        text = f"{self.late} of {self.frames} frames were late ({share:.1f} %)"
        count = sum(self._intervals)
        if not count:
            return text
        seconds = sum(length * number for length, number in enumerate(self._intervals)) / 1000
        below = accumulate(self._intervals)
        most = next(length for length, number in enumerate(below) if number >= 0.99 * count)
        over = max(0.0, most - self._period * 1000)
        rate = count / max(seconds, 0.001)
        return f"{text}; {rate:.1f} frames per second, 99 % of them at most {over:.0f} ms late"


class Following:
    """Check that the state of a robot follows its commands.

    Args:
        tolerance: distance, in radians, that is no error.
        seconds: time without progress that is an error.
    """

    def __init__(self, tolerance: float, seconds: float) -> None:
        self._tolerance = tolerance
        self._seconds = seconds
        self._behind: dict[str, tuple[float, float]] = {}

    def check(self, wanted: Mapping[str, float], actual: Mapping[str, float], now: float) -> None:
        """Compare command and state.

        Raises:
            DoesNotFollow: a joint is away from its command, and has not moved for too long.
        """
        for name, there in wanted.items():
            here = actual[name]
            since, start = self._behind.get(name, (now, here))
            if abs(there - here) <= self._tolerance:
                self._behind.pop(name, None)
            elif abs(here - start) > _PROGRESS:
                self._behind[name] = now, here
            elif now - since <= self._seconds:
                self._behind[name] = since, start
            else:
                raise DoesNotFollow(
                    f"{name} is at {here:.3g} rad, was commanded to {there:.3g} rad,"
                    f" and has not moved for {now - since:.1f} s"
                )


class RosbridgeRobot(Device, Robot):
    """Robot on a rosbridge server.

    Every method that LeRobot's loops call raises :exc:`DeviceError` with the cause if a command was rejected,
    the robot does not follow, its state is too old, or the connection was lost.
    """

    config_class = RosbridgeRobotConfig
    name = "rosbridge"
    noun = "robot"

    def __init__(self, config: RosbridgeRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        self.cameras = make_cameras_from_configs(config.cameras)
        self.frames = FrameCount(config.fps)
        self._map = FeatureMap(config.joints, config.units, config.ranges)
        self._states: Latest | None = None
        self._publisher: BlockingPublisher | None = None
        self._wanted: Mapping[str, float] = {}
        self._sent_at = 0.0
        self._following = Following(config.follow_tolerance, config.follow_seconds)

    @cached_property
    def observation_features(self) -> dict[str, Any]:
        """Features of the joints and of the cameras."""
        shapes = {name: (camera.height, camera.width, 3) for name, camera in self.config.cameras.items()}
        return {**self._map.features, **shapes}

    @cached_property
    def action_features(self) -> dict[str, Any]:
        """Features of the joints."""
        return dict(self._map.features)

    def connect(self, calibrate: bool = True) -> None:
        """Connect to the server, and wait for the first joint states.

        Raises:
            DeviceError: the server cannot be reached, or no joint states arrive.
        """
        config = self.config
        connection = self._connect(config, config.commands)
        try:
            publisher = connection.robot.advertise(config.commands, TOPIC_TYPE)
            states = connection.first_states(config.states)
            for camera in self.cameras.values():
                camera.connect()
        except BaseException:
            connection.close()
            raise
        self._connection, self._states, self._publisher = connection, states, publisher
        self._wanted = {}
        self._following = Following(config.follow_tolerance, config.follow_seconds)

    def get_observation(self) -> dict[str, Any]:
        """Return the joints' positions and the images."""
        connection, states, _ = self._parts()
        connection.check()
        now = time.monotonic()
        self.frames.note(now)
        message = states.get(self.config.max_age)
        observation: dict[str, Any] = dict(self._read(message))
        actual = dict(zip(message.name, message.position, strict=False))
        self._following.check(self._wanted, actual, now)
        for name, camera in self.cameras.items():
            observation[name] = camera.read_latest(int(getattr(camera, "max_age_ms", 500)))
        return observation

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Publish a trajectory with one point; returns the action.

        After a pause of the loop, as between episodes, an empty trajectory precedes it: for a gate with a
        lease, what follows a pause without it would be commands that waited in a stalled connection.
        """
        connection, states, publisher = self._parts()
        connection.check()
        states.get(self.config.max_age)
        now = time.monotonic()
        if self._wanted and now - self._sent_at > _GRIP_PERIODS / self.config.fps:
            publisher.publish({})
        self._sent_at = now
        wanted = self._map.radians(action)
        seconds, rest = divmod(round(self.config.seconds * 1e9), 10**9)
        point = {
            "positions": list(wanted.values()),
            "time_from_start": {"sec": seconds, "nanosec": rest},
        }
        publisher.publish({"joint_names": list(wanted), "points": [point]})
        self._wanted = wanted
        return action

    def disconnect(self) -> None:
        """Close the connection, and report late frames. The robot holds its last position."""
        super().disconnect()
        if self.frames.late:
            logger.warning("%s: recorded time is shorter than real time", self.frames)
        else:
            logger.info("%s", self.frames)
        for camera in self.cameras.values():
            if camera.is_connected:
                camera.disconnect()

    def _parts(self) -> tuple[Connection, Latest, BlockingPublisher]:
        connection = self._connected()
        assert self._states is not None and self._publisher is not None  # Set with the connection.
        return connection, self._states, self._publisher

    def _read(self, message: Any) -> dict[str, float]:
        try:
            return self._map.read(message.name, message.position)
        except ValueError as error:
            raise DeviceError(f"{self.config.states}: {error}") from error
