"""Fake of `lerobot.teleoperators`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from lerobot.utils.registry import ChoiceRegistry, make_device


@dataclass(kw_only=True)
class TeleoperatorConfig(ChoiceRegistry, ABC):
    """Configuration of a teleoperator."""

    id: str | None = None
    calibration_dir: Path | None = None


class Teleoperator(ABC):
    """Teleoperator."""

    config_class: ClassVar[type[Any]]
    name: ClassVar[str]

    def __init__(self, config: TeleoperatorConfig) -> None:
        self.id = config.id
        self.calibration: dict[str, Any] = {}

    @property
    @abstractmethod
    def action_features(self) -> dict[str, Any]: ...

    @property
    @abstractmethod
    def feedback_features(self) -> dict[str, Any]: ...

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
    def get_action(self) -> dict[str, Any]: ...

    @abstractmethod
    def send_feedback(self, feedback: dict[str, Any]) -> None: ...

    @abstractmethod
    def disconnect(self) -> None: ...


def make_teleoperator_from_config(config: TeleoperatorConfig) -> Teleoperator:
    """Return the teleoperator of a configuration."""
    teleoperator: Teleoperator = make_device(config)
    return teleoperator
