"""Fake of `lerobot.robots`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from lerobot.utils.registry import ChoiceRegistry, make_device


@dataclass(kw_only=True)
class RobotConfig(ChoiceRegistry, ABC):
    """Configuration of a robot."""

    id: str | None = None
    calibration_dir: Path | None = None


class Robot(ABC):
    """Robot."""

    config_class: ClassVar[type[Any]]
    name: ClassVar[str]

    def __init__(self, config: RobotConfig) -> None:
        self.robot_type = self.name
        self.id = config.id
        self.calibration: dict[str, Any] = {}

    @property
    @abstractmethod
    def observation_features(self) -> dict[str, Any]: ...

    @property
    @abstractmethod
    def action_features(self) -> dict[str, Any]: ...

    @property
    @abstractmethod
    def is_connected(self) -> bool: ...

    @abstractmethod
    def connect(self, calibrate: bool = True) -> None: ...

    @property
    @abstractmethod
    def is_calibrated(self) -> bool: ...

    @abstractmethod
    def calibrate(self) -> None: ...

    @abstractmethod
    def configure(self) -> None: ...

    @abstractmethod
    def get_observation(self) -> dict[str, Any]: ...

    @abstractmethod
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]: ...

    @abstractmethod
    def disconnect(self) -> None: ...


def make_robot_from_config(config: RobotConfig) -> Robot:
    """Return the robot of a configuration."""
    robot: Robot = make_device(config)
    return robot
