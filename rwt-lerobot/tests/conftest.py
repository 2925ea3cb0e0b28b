"""A fake of LeRobot in place of the real one, if that is not installed, and an arm without hardware."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

FAKES: Final = Path(__file__).parent / "fakes"
TESTS: Final = Path(__file__).parents[2] / "tests"

if find_spec("lerobot") is None:
    sys.path.append(str(FAKES))

if find_spec("tests.browser") is None:
    # One of LeRobot's dependencies installs a package `tests`, which hides the folder of this project.
    sys.modules["tests"].__path__.append(str(TESTS))


class Motor:
    """Motor of a bus.

    Attributes:
        model: model of the motor.
        norm_mode: its unit, like LeRobot's `MotorNormMode`.
    """

    def __init__(self, unit: str) -> None:
        self.model = "sts3215"
        self.norm_mode = type("MotorNormMode", (), {"value": unit})()


class Bus:
    """Bus of an arm."""

    model_resolution_table = {"sts3215": 4096}  # noqa: RUF012 - an attribute of the class, as in LeRobot

    def __init__(self, units: dict[str, str]) -> None:
        self.motors = {name: Motor(unit) for name, unit in units.items()}


class Calibration:
    """Calibration of a motor, like LeRobot's `MotorCalibration`."""

    def __init__(self, range_min: int, range_max: int) -> None:
        self.range_min = range_min
        self.range_max = range_max


class FakeArm:
    """Arm of LeRobot without hardware: it is where it was commanded.

    Attributes:
        positions: values of the motors.
        actions: all actions.
        is_stuck: True if the motors do not move.
        error: raised by each access, as by an unplugged bus.
    """

    def __init__(self) -> None:
        units = {"pan": "degrees", "lift": "range_m100_100", "gripper": "range_0_100"}
        self.bus = Bus(units)
        self.calibration = {name: Calibration(1024, 3072) for name in units}
        self.positions = {"pan.pos": 10.0, "lift.pos": 0.0, "gripper.pos": 50.0}
        self.actions: list[dict[str, Any]] = []
        self.is_stuck = False
        self.error: Exception | None = None

    @property
    def observation_features(self) -> dict[str, Any]:
        return {**dict.fromkeys(self.positions, float), "front": (24, 32, 3)}

    @property
    def action_features(self) -> dict[str, Any]:
        return dict.fromkeys(self.positions, float)

    def get_observation(self) -> dict[str, Any]:
        if self.error is not None:
            raise self.error
        return {**self.positions, "front": np.full((24, 32, 3), 128, np.uint8)}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        if self.error is not None:
            raise self.error
        self.actions.append(action)
        if not self.is_stuck:
            self.positions.update(action)
        return action


@pytest.fixture
def arm() -> FakeArm:
    return FakeArm()
