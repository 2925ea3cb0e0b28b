"""The battery."""

from __future__ import annotations

import pytest

from rwt.extensions.demo.drive import STANDSTILL, Velocity
from rwt.extensions.demo.state import EMPTY_VOLTAGE, FULL_VOLTAGE, Battery


def test_it_drains_faster_while_driving() -> None:
    idle, driving = Battery(), Battery()
    idle.drain(STANDSTILL, 600)
    driving.drain(Velocity(0.5, 0.5), 600)
    assert driving.level < idle.level < 1.0


def test_it_ends_empty_and_a_fresh_one_is_full() -> None:
    battery = Battery()
    assert battery.voltage == pytest.approx(FULL_VOLTAGE)
    battery.drain(Velocity(1.0, 0.0), 1e6)
    assert battery.level == 0.0
    assert battery.voltage == pytest.approx(EMPTY_VOLTAGE)
    battery.swap()
    assert battery.level == 1.0
