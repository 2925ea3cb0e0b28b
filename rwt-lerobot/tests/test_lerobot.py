"""LeRobot's own programs record and replay the simulated arm. Needs LeRobot and MuJoCo."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import threading
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import pytest

from rwt import Server
from rwt_client.blocking import connect

if find_spec("lerobot.scripts") is None or find_spec("mujoco") is None:
    pytest.skip("LeRobot and MuJoCo are not installed", allow_module_level=True)

from rwt_lerobot.simulation.robot import MujocoRobot

RADIANS: Final = 0.6
"""Position of the first joint that the operator commands."""


def _run(program: str, url: str, folder: Path, *options: str) -> str:
    command = [
        str(Path(sys.executable).with_name(program)),
        "--robot.type=rosbridge",
        f"--robot.url={url}",
        f"--robot.calibration_dir={folder}",
        "--play_sounds=false",
        "--dataset.repo_id=me/arm",
        f"--dataset.root={folder / 'data'}",
        *options,
    ]
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_LEROBOT_HOME": str(folder)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stderr


def _operate(url: str, ended: threading.Event) -> None:
    """Move a slider, as the page does, until the recording ends."""
    with connect(url) as page:
        while not ended.wait(0.05):
            points = [{"positions": [RADIANS]}]
            page.publish(
                "/teleop/joint_trajectory",
                {"joint_names": ["shoulder_pan"], "points": points},
                "trajectory_msgs/JointTrajectory",
            )


def _columns(folder: Path) -> tuple[Any, Any]:
    import numpy as np
    import pandas

    frames = [pandas.read_parquet(file) for file in sorted((folder / "data" / "data").rglob("*.parquet"))]
    table = pandas.concat(frames)
    return np.stack(table["action"]), np.stack(table["observation.state"])


@pytest.mark.slow
def test_record_replay_and_read_back(tmp_path: Path) -> None:
    with Server("ws://127.0.0.1:0", extra_nodes=[MujocoRobot]) as server:
        url, ended = server.server.urls[0], threading.Event()
        operator = threading.Thread(target=_operate, args=(url, ended))
        operator.start()
        camera = f'type: rosbridge, url: "{url}", width: 320, height: 240, fps: 30'
        cameras = (
            f"{{front: {{{camera}, topic: /front/image_raw/compressed}},"
            f" wrist: {{{camera}, topic: /wrist_camera/image_raw/compressed}}}}"
        )
        try:
            log = _run(
                "lerobot-record", url, tmp_path,
                f"--robot.cameras={cameras}",
                "--teleop.type=rosbridge", f"--teleop.url={url}", f"--teleop.calibration_dir={tmp_path}",
                "--dataset.single_task=turn", "--dataset.push_to_hub=false", "--dataset.vcodec=h264",
                "--dataset.num_episodes=3", "--dataset.episode_time_s=2", "--dataset.reset_time_s=0.2",
            )  # fmt: skip
        finally:
            ended.set()
            operator.join()
        assert "frames were late" in log
        actions, states = _columns(tmp_path)
        assert len(actions) > 60  # 180 on an idle machine.
        assert actions[-1][0] == pytest.approx(math.degrees(RADIANS), abs=0.01)
        assert states[-1][0] == pytest.approx(actions[-1][0], abs=0.5)
        server.call("/simulation/reset")
        _run("lerobot-replay", url, tmp_path, "--dataset.episode=2")
        time.sleep(1.0)
        state = server.once("/joint_states", "sensor_msgs/JointState", timeout=10)
        replayed = [math.degrees(position) for position in state.position]
        assert replayed == pytest.approx([*actions[-1]], abs=0.5)
