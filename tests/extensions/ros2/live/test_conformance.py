"""The conformance suite against `rwt serve` on the graph of ROS 2."""

from __future__ import annotations

import pytest

from rosbridge_conformance.command import main
from tests.extensions.ros2.live.test_server import serving


@pytest.mark.timeout(500)
@pytest.mark.usefixtures("domain")
def test_every_case_as_in_memory() -> None:
    with serving() as (_, url):
        assert main([url, "--target", "rwt-jazzy", "--jobs", "4"]) == 0
