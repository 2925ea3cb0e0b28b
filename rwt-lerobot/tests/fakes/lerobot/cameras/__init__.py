"""Fake of `lerobot.cameras`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from lerobot.utils.registry import ChoiceRegistry


@dataclass(kw_only=True)
class CameraConfig(ChoiceRegistry, ABC):
    """Configuration of a camera."""

    fps: int | None = None
    width: int | None = None
    height: int | None = None


class Camera(ABC):
    """Camera."""

    def __init__(self, config: CameraConfig) -> None:
        self.fps = config.fps
        self.width = config.width
        self.height = config.height

    @property
    @abstractmethod
    def is_connected(self) -> bool: ...

    @staticmethod
    @abstractmethod
    def find_cameras() -> list[dict[str, Any]]: ...

    @abstractmethod
    def connect(self, warmup: bool = True) -> None: ...

    @abstractmethod
    def read(self) -> NDArray[Any]: ...

    @abstractmethod
    def async_read(self, timeout_ms: float = ...) -> NDArray[Any]: ...

    def read_latest(self, max_age_ms: int = 500) -> NDArray[Any]:
        """Return the newest image."""
        return self.async_read()

    @abstractmethod
    def disconnect(self) -> None: ...
