"""Pytest plugin with a fixture for tests of nodes in virtual time.

pytest imports this module at the start of every run, so the fixture imports its dependencies on
first use.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rwt_rclpy.middleware.link import VirtualDomain


@pytest.fixture
def rclpy_graph() -> Iterator[VirtualDomain]:
    """Return a graph of the test in virtual time, with `import rclpy` and `rclpy.init()` done: a timer of ten
    minutes is due at once, and always in the same order.

    The test is skipped if ROS is installed, because ROS's own rclpy would run.
    """
    import rwt_rclpy
    from rwt_rclpy import client_library
    from rwt_rclpy.execution.signals import SignalHandlerOptions
    from rwt_rclpy.middleware.link import VirtualDomain

    if rwt_rclpy.install() == "ros":
        pytest.skip("ROS is installed, and its own rclpy would run")
    with VirtualDomain() as domain:
        client_library.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        try:
            yield domain
        finally:
            client_library.try_shutdown()
