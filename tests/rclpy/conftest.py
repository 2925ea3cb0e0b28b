"""`import rclpy` in every test of this folder, without a trace in the others."""

from collections.abc import Iterator

import pytest

import rwt_rclpy


@pytest.fixture(autouse=True, scope="module")
def installed() -> Iterator[None]:
    assert rwt_rclpy.install() == "rwt_rclpy"
    yield
    rwt_rclpy.uninstall()
