"""The conformance suite against `rwt serve` on the graph of a ROS 1 master."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from rosbridge_conformance.command import main
from tests.extensions.ros1.live.test_server import server

if TYPE_CHECKING:
    from tests.extensions.ros1.live.conftest import Ros


@pytest.mark.timeout(400)
def test_every_case_as_in_memory(ros: Ros) -> None:
    with server(ros) as url:
        assert main([url, "--target", "rwt-noetic", "--jobs", "8"]) == 0
