"""Fake of `lerobot.teleoperators`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from lerobot.utils.registry import Device, DeviceConfig, make_device


@dataclass(kw_only=True)
class TeleoperatorConfig(DeviceConfig, ABC):
    """Configuration of a teleoperator."""


class Teleoperator(Device):
    """Teleoperator."""

    @property
    @abstractmethod
    def feedback_features(self) -> dict[str, Any]: ...

    @abstractmethod
    def get_action(self) -> dict[str, Any]: ...

    @abstractmethod
    def send_feedback(self, feedback: dict[str, Any]) -> None: ...


def make_teleoperator_from_config(config: TeleoperatorConfig) -> Teleoperator:
    """Return the teleoperator of a configuration."""
    teleoperator: Teleoperator = make_device(config)
    return teleoperator
