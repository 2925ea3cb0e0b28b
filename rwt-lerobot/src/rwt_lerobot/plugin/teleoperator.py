"""Teleoperator of LeRobot whose actions arrive on a topic of a rosbridge server."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

from lerobot.teleoperators import Teleoperator

from rwt_lerobot.joints.controller import GOAL_TOLERANCE, TOPIC_TYPE
from rwt_lerobot.joints.features import FeatureMap
from rwt_lerobot.plugin.config import RosbridgeTeleoperatorConfig
from rwt_lerobot.plugin.connection import Device, DeviceError, Latest


class RosbridgeTeleoperator(Device, Teleoperator):
    """Teleoperator whose commands arrive as trajectories: from sliders in a browser, a phone or a program.

    A command may name some joints; the others keep their last command, and before it their position at the
    start. A trajectory without points, from a gate or at the end of a page's motion, holds the joints where
    they are. A topic that falls silent holds the last command.
    """

    config_class = RosbridgeTeleoperatorConfig
    name = "rosbridge"
    noun = "teleoperator"

    def __init__(self, config: RosbridgeTeleoperatorConfig) -> None:
        super().__init__(config)
        self.config = config
        self._map = FeatureMap(config.joints, config.units, config.ranges)
        self._states = Latest(config.states)
        self._wanted: dict[str, float] = {}

    @cached_property
    def action_features(self) -> dict[str, Any]:
        """Features of the joints."""
        return dict(self._map.features)

    @property
    def feedback_features(self) -> dict[str, Any]:
        """Empty: there is no feedback."""
        return {}

    def connect(self, calibrate: bool = True) -> None:
        """Connect to the server, and begin with the positions of the joints.

        Raises:
            DeviceError: the server cannot be reached, or no joint states arrive.
        """
        config = self.config
        connection = self._connect(config)
        try:
            self._states = states = connection.first_states(config.states)
            message = states.get(config.max_age)
            self._map.read(message.name, message.position)
            self._wanted = dict.fromkeys(config.joints, math.nan)
            self._hold(message)
            connection.robot.subscribe(config.commands, self._take, TOPIC_TYPE)
        except ValueError as error:
            connection.close()
            raise DeviceError(f"{config.states}: {error}") from error
        except BaseException:
            connection.close()
            raise
        self._connection = connection

    def get_action(self) -> dict[str, Any]:
        """Return the last command."""
        self._connected().check()
        wanted = self._wanted
        return dict(self._map.read(list(wanted), list(wanted.values())))

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """No-op: there is no feedback."""

    def _take(self, message: Any) -> None:
        # Runs in the thread of the connection: the dictionary is replaced, never changed.
        if message.points:
            given = dict(zip(message.joint_names, message.points[-1].positions, strict=False))
            self._wanted = {name: given.get(name, before) for name, before in self._wanted.items()}
        else:
            self._hold(self._states.get(math.inf))

    def _hold(self, state: Any) -> None:
        # Joints that are at their command keep it: an arm that sags a little would sink with each stop.
        given = dict(zip(state.name, state.position, strict=False))
        self._wanted = {
            name: before if abs(before - (here := given.get(name, before))) <= GOAL_TOLERANCE else here
            for name, before in self._wanted.items()
        }
