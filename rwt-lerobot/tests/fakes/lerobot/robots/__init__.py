"""Fake of `lerobot.robots`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from lerobot.utils.registry import Device, DeviceConfig, make_device


@dataclass(kw_only=True)
class RobotConfig(DeviceConfig, ABC):
    """Configuration of a robot."""


class Robot(Device):
    """Robot."""

    @property
    @abstractmethod
    def observation_features(self) -> dict[str, Any]: ...

    @abstractmethod
    def get_observation(self) -> dict[str, Any]: ...

    @abstractmethod
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]: ...


def make_robot_from_config(config: RobotConfig) -> Robot:
    """Return the robot of a configuration."""
    robot: Robot = make_device(config)
    return robot
