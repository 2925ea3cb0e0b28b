"""Five minutes of the scene that runs for an hour by `make ros2-scene`, with more frequent restarts."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.processes import ROOT


@pytest.mark.extended
@pytest.mark.timeout(900)
def test_a_robot_with_every_kind_of_client_whose_programs_restart(domain: int) -> None:
    command = [sys.executable, "-m", "bench.ros2_scene", "--seconds", "300", "--restart", "20"]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
    with subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True) as scene:
        try:
            output, _ = scene.communicate(timeout=800)
        finally:
            scene.terminate()
    assert scene.returncode == 0, output
