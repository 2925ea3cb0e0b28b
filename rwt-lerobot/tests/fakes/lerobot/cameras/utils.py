"""Fake of `lerobot.cameras.utils`."""

from __future__ import annotations

from collections.abc import Mapping

from lerobot.cameras import Camera, CameraConfig
from lerobot.utils.registry import make_device


def make_cameras_from_configs(configs: Mapping[str, CameraConfig]) -> dict[str, Camera]:
    """Return the cameras of configurations."""
    return {name: make_device(config) for name, config in configs.items()}
