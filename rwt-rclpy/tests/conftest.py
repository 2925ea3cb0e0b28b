"""`import rclpy` in every test of this folder, without a trace in the others; an executor in virtual time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

import rwt_rclpy

if TYPE_CHECKING:
    from rwt_rclpy.middleware.link import VirtualDomain

# As in `tests/conftest.py`, which these tests do not load.
settings.register_profile("any speed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any speed")


@pytest.fixture(autouse=True, scope="module")
def installed() -> Iterator[None]:
    assert rwt_rclpy.install() == "rwt_rclpy"
    yield
    rwt_rclpy.uninstall()


@pytest.fixture
def rclpy(rclpy_graph: VirtualDomain) -> Any:
    import rclpy

    return rclpy


@pytest.fixture
def executor(rclpy: Any) -> Iterator[Any]:
    with rclpy.executors.SingleThreadedExecutor() as executor:
        yield executor
