"""Registry of configurations like draccus's, and the factory of LeRobot's plugins."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeVar

T = TypeVar("T")


class ChoiceRegistry:
    """Base class of configurations; each kind of device has a table of its own."""

    choices: ClassVar[dict[str, type]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if ABC in cls.__bases__:
            cls.choices = {}

    @classmethod
    def register_subclass(cls, name: str) -> Callable[[type[T]], type[T]]:
        """Return a decorator that registers a configuration."""

        def register(subclass: type[T]) -> type[T]:
            cls.choices[name] = subclass
            return subclass

        return register

    @classmethod
    def get_choice_class(cls, name: str) -> type:
        """Return the configuration of a name."""
        return cls.choices[name]

    @property
    def type(self) -> str:
        """Name of the configuration."""
        return next(name for name, each in self.choices.items() if each is self.__class__)


@dataclass(kw_only=True)
class DeviceConfig(ChoiceRegistry):
    """Common part of the configurations of robots and teleoperators."""

    id: str | None = None
    calibration_dir: Path | None = None


class Device(ABC):
    """Common part of robots and teleoperators."""

    config_class: ClassVar[type[Any]]
    name: ClassVar[str]

    def __init__(self, config: DeviceConfig) -> None:
        self.id = config.id
        self.calibration: dict[str, Any] = {}

    @property
    @abstractmethod
    def action_features(self) -> dict[str, Any]: ...

    @property
    @abstractmethod
    def is_connected(self) -> bool: ...

    @property
    @abstractmethod
    def is_calibrated(self) -> bool: ...

    @abstractmethod
    def connect(self, calibrate: bool = True) -> None: ...

    @abstractmethod
    def calibrate(self) -> None: ...

    @abstractmethod
    def configure(self) -> None: ...

    @abstractmethod
    def disconnect(self) -> None: ...


def make_device(config: ChoiceRegistry) -> Any:
    """Return the device of a configuration: its class name without `Config`, in the parent package."""
    parent = importlib.import_module(config.__class__.__module__.rpartition(".")[0])
    return getattr(parent, config.__class__.__name__.removesuffix("Config"))(config)
