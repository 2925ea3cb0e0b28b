"""LeRobot's own programs record and replay the simulated arm. Needs LeRobot, MuJoCo and Chromium."""

from __future__ import annotations

import logging
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from importlib.util import find_spec
from itertools import cycle
from pathlib import Path
from typing import Any, Final

import anyio
import pytest
from packaging.version import Version

from rwt import Server
from tests.browser.driver import find_browser, opened_browser
from tests.browser.test_joints import slide
from tests.browser.test_panels import open_panels

if find_spec("lerobot.scripts") is None or find_spec("mujoco") is None:
    pytest.skip("LeRobot and MuJoCo are not installed", allow_module_level=True)

from rwt_lerobot.simulation.robot import MujocoRobot

logger: Final = logging.getLogger("measured")
"""Figures for people to read: `make test-lerobot ARGS=--log-cli-level=INFO`."""

TOPIC: Final = "/teleop/joint_trajectory"
TOPIC_TYPE: Final = "trajectory_msgs/JointTrajectory"
#: Positions of the first joint that the operator commands in turn, radians.
POSITIONS: Final = (0.6, -0.3)
SECONDS: Final = 5
"""Length of an episode."""


RECORDER: Final = (
    ("--dataset.rgb_encoder.vcodec=h264", "--dataset.no_stamp=true")
    if Version(version("lerobot")) >= Version("0.6")
    else ("--dataset.vcodec=h264",)
)
"""Options of `lerobot-record` that differ by version: a fast encoder, and the dataset in its own folder."""


def _command(program: str, url: str, folder: Path, *options: str) -> list[str]:
    return [
        str(Path(sys.executable).with_name(program)),
        "--robot.type=rosbridge",
        f"--robot.url={url}",
        f"--robot.calibration_dir={folder}",
        *options,
    ]


def _with_dataset(program: str, url: str, folder: Path, *options: str) -> list[str]:
    dataset = ("--play_sounds=false", "--dataset.repo_id=me/arm", f"--dataset.root={folder / 'data'}")
    return _command(program, url, folder, *dataset, *options)


def _teleoperator(url: str, folder: Path) -> tuple[str, ...]:
    return "--teleop.type=rosbridge", f"--teleop.url={url}", f"--teleop.calibration_dir={folder}"


def _record(url: str, folder: Path, episodes: int) -> list[str]:
    camera = f'type: rosbridge, url: "{url}", width: 320, height: 240, fps: 30'
    cameras = (
        f"{{front: {{{camera}, topic: /front/image_raw/compressed}},"
        f" wrist: {{{camera}, topic: /wrist_camera/image_raw/compressed}}}}"
    )
    return _with_dataset(
        "lerobot-record", url, folder,
        f"--robot.cameras={cameras}",
        *_teleoperator(url, folder),
        "--dataset.single_task=turn", "--dataset.push_to_hub=false", *RECORDER,
        f"--dataset.num_episodes={episodes}",
        f"--dataset.episode_time_s={SECONDS}", "--dataset.reset_time_s=0.2",
    )  # fmt: skip


def _environment(folder: Path) -> dict[str, str]:
    return {**os.environ, "HF_HUB_OFFLINE": "1", "HF_LEROBOT_HOME": str(folder)}


def _run(command: list[str], folder: Path) -> str:
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=200, env=_environment(folder), check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stderr


@contextmanager
def _operator(url: str, folder: Path) -> Iterator[None]:
    """Move a slider of the dashboard to and fro, in a browser."""
    kind = find_browser()
    if kind is None:
        pytest.skip("Chromium is not installed")
    ended = threading.Event()

    async def operate() -> None:
        page_url = url.replace("ws", "http", 1) + "/"
        with opened_browser(kind, folder / "browser") as browser:
            async with browser.page(f"{page_url}healthz", 700, 600) as page:
                await open_panels(page, page_url, [("joints", {"topic": TOPIC, "share": 0.5})])
                for position in cycle(POSITIONS):
                    await slide(page, "shoulder_pan", position)
                    for _ in range(30):
                        await anyio.sleep(0.1)
                        if ended.is_set():
                            return

    (folder / "browser").mkdir()
    with ThreadPoolExecutor() as pool:
        operator = pool.submit(anyio.run, operate)
        try:
            yield
        finally:
            ended.set()
        operator.result()


def _frames(folder: Path) -> Any:
    import pandas

    files = sorted((folder / "data" / "data").rglob("*.parquet"))
    return pandas.concat([pandas.read_parquet(file) for file in files])


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_record_from_the_dashboard_replay_and_read_back(tmp_path: Path) -> None:
    with Server("ws://127.0.0.1:0", extra_nodes=[MujocoRobot]) as server:
        url = server.server.urls[0]
        with _operator(url, tmp_path):
            log = _run(_record(url, tmp_path, 3), tmp_path)
        # The rate and the delay depend on the machine, and are for people to read.
        found = re.search(r"\d+ of \d+ frames were late.* ms late", log)
        assert found is not None
        logger.info("%s", found[0])
        frames = _frames(tmp_path)
        assert set(frames["episode_index"]) == {0, 1, 2}
        assert len(frames) > 3 * SECONDS * 10  # 30 frames per second on an idle machine.
        pan = [math.radians(action[0]) for action in frames["action"]]
        assert max(pan) == pytest.approx(POSITIONS[0], abs=0.05)
        assert min(pan) == pytest.approx(POSITIONS[1], abs=0.05)
        # The sliders go on while an episode is saved, so the arm catches up in its first second.
        settled = frames[frames["frame_index"] >= 30]
        distances = [abs(row["action"] - row["observation.state"]).max() for _, row in settled.iterrows()]
        assert max(distances) < math.degrees(0.5)
        server.call("/simulation/reset")
        sent: list[Any] = []
        server.subscribe("/arm_controller/joint_trajectory", sent.append, TOPIC_TYPE)
        _run(_with_dataset("lerobot-replay", url, tmp_path, "--dataset.episode=2"), tmp_path)
        time.sleep(1.0)
        recorded = [[*action] for action in frames[frames["episode_index"] == 2]["action"]]
        commands = [command.points[0].positions for command in sent if command.points]
        assert [[math.degrees(angle) for angle in command] for command in commands] == [
            pytest.approx(action, abs=0.5) for action in recorded
        ]
        state = server.once("/joint_states", "sensor_msgs/JointState", timeout=60)
        assert [math.degrees(angle) for angle in state.position] == pytest.approx(recorded[-1], abs=0.5)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_killed_server_ends_the_recording_and_leaves_its_finished_episodes(tmp_path: Path) -> None:
    serve = [sys.executable, "-m", "rwt.cli", "lerobot", "mujoco", "ws://127.0.0.1:0"]
    data = tmp_path / "data"
    with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        url = server.stdout.readline().split()[-1]
        with subprocess.Popen(
            _record(url, tmp_path, 3), stderr=subprocess.PIPE, text=True, env=_environment(tmp_path)
        ) as recording:
            assert recording.stderr is not None
            lines: list[str] = []
            killed = 0.0
            for line in recording.stderr:
                lines.append(line)
                if "Recording episode 1" in line:  # The first one, 0, is finished.
                    time.sleep(1.0)
                    os.kill(server.pid, signal.SIGKILL)
                    killed = time.monotonic()
                if killed and "DeviceError" in line:
                    logger.info("%.2f s from the end of the server to the error", time.monotonic() - killed)
        server.kill()
    assert recording.returncode != 0
    assert re.search(r"(DeviceError|StaleData): ", "".join(lines)), lines[-20:]
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset = LeRobotDataset("me/arm", root=data, video_backend="pyav")
    assert dataset.num_episodes == 1
    assert len(dataset) > SECONDS * 10
    assert dataset[len(dataset) - 1]["observation.images.front"].shape == (3, 240, 320)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_lerobot_teleoperates_the_arm(tmp_path: Path) -> None:
    with Server("ws://127.0.0.1:0", extra_nodes=[MujocoRobot]) as server:
        url = server.server.urls[0]
        options = (*_teleoperator(url, tmp_path), "--teleop_time_s=60")
        command = _command("lerobot-teleoperate", url, tmp_path, *options)
        with subprocess.Popen(command, env=_environment(tmp_path), stdout=subprocess.DEVNULL) as program:
            try:
                pan, end = 0.0, time.monotonic() + 100
                while abs(pan - 0.5) > math.radians(0.5) and time.monotonic() < end:
                    points = [{"positions": [0.5]}]
                    server.publish(TOPIC, {"joint_names": ["shoulder_pan"], "points": points}, TOPIC_TYPE)
                    time.sleep(0.1)
                    pan = server.once("/joint_states", "sensor_msgs/JointState", timeout=60).position[0]
                assert pan == pytest.approx(0.5, abs=math.radians(0.5))
            finally:
                program.terminate()


def _untrained_policy(folder: Path, pan: float) -> None:
    """Save a small policy whose actions are near a position of the first joint, in degrees."""
    import torch
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.factory import make_pre_post_processors

    image = "observation.images.front"
    config = ACTConfig(
        device="cpu", push_to_hub=False, pretrained_backbone_weights=None, use_vae=False,
        dim_model=32, n_heads=2, dim_feedforward=32, n_encoder_layers=1, chunk_size=10, n_action_steps=10,
        input_features={
            "observation.state": PolicyFeature(FeatureType.STATE, (6,)),
            image: PolicyFeature(FeatureType.VISUAL, (3, 240, 320)),
        },
        output_features={"action": PolicyFeature(FeatureType.ACTION, (6,))},
    )  # fmt: skip
    stats = {
        "action": {"mean": torch.tensor([pan, -28.6, 74.5, 45.8, 0.0, 11.5]), "std": torch.full((6,), 0.01)},
        "observation.state": {"mean": torch.zeros(6), "std": torch.full((6,), 50.0)},
        image: {"mean": torch.full((3, 1, 1), 0.5), "std": torch.full((3, 1, 1), 0.5)},
    }
    ACTPolicy(config).save_pretrained(folder)
    for processor in make_pre_post_processors(config, dataset_stats=stats):
        processor.save_pretrained(folder)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_policy_drives_the_arm(tmp_path: Path) -> None:
    if find_spec("lerobot.rollout") is None:
        pytest.skip("this version of LeRobot has no lerobot-rollout")
    _untrained_policy(tmp_path / "policy", pan=20.0)
    with Server("ws://127.0.0.1:0", extra_nodes=[MujocoRobot]) as server:
        url = server.server.urls[0]
        camera = f'type: rosbridge, url: "{url}", topic: /front/image_raw/compressed'
        command = _command(
            "lerobot-rollout", url, tmp_path,
            f"--robot.cameras={{front: {{{camera}, width: 320, height: 240, fps: 30, max_age: 5}}}}",
            f"--policy.path={tmp_path / 'policy'}", "--task=turn", "--duration=5", "--device=cpu",
            "--play_sounds=false", "--return_to_initial_position=false",
        )  # fmt: skip
        _run(command, tmp_path)
        time.sleep(1.0)
        state = server.once("/joint_states", "sensor_msgs/JointState", timeout=60)
        assert math.degrees(state.position[0]) == pytest.approx(20.0, abs=0.5)


@pytest.mark.slow
def test_lerobots_robot_joins_a_server_by_the_command_line_and_again_after_its_restart(
    tmp_path: Path,
) -> None:
    with ExitStack() as running, Server("ws://127.0.0.1:0", extra_nodes=[MujocoRobot]) as simulation:
        server = running.enter_context(Server("ws://127.0.0.1:0"))
        url = server.server.urls[0]
        serve = [
            sys.executable, "-m", "rwt.cli", "lerobot", "serve", "--url", url,
            "--robot.type=rosbridge", f"--robot.url={simulation.server.urls[0]}",
            f"--robot.calibration_dir={tmp_path}",
            *(f"--unit={joint}=degrees" for joint in ("shoulder_pan", "shoulder_lift", "elbow_flex")),
            *(f"--unit={joint}=degrees" for joint in ("wrist_flex", "wrist_roll", "gripper")),
        ]  # fmt: skip
        with subprocess.Popen(serve, env=_environment(tmp_path)) as robot:
            try:
                state = server.once("/joint_states", "sensor_msgs/JointState", timeout=60)
                assert state.name[0] == "shoulder_pan"
                point = {"positions": [0.4], "time_from_start": {"sec": 1}}
                goal = {"trajectory": {"joint_names": ["shoulder_pan"], "points": [point]}}
                handle = server.send_goal("/arm_controller/follow_joint_trajectory", goal)
                assert handle.result(30).succeeded
                moved = simulation.once("/joint_states", "sensor_msgs/JointState", timeout=60)
                assert moved.position[0] == pytest.approx(0.4, abs=0.1)
                running.close()
                server = running.enter_context(Server(url))
                state = server.once("/joint_states", "sensor_msgs/JointState", timeout=60)
                assert state.position[0] == pytest.approx(0.4, abs=0.1)
            finally:
                robot.terminate()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--robot.url=ws://127.0.0.1:1"], "the robot cannot be connected: DeviceError: cannot"),
        (["--robot.port=/dev/none"], "the robot: "),
    ],
)
def test_a_robot_that_is_not_there_is_an_error_without_a_traceback(options: list[str], text: str) -> None:
    serve = [sys.executable, "-m", "rwt.cli", "lerobot", "serve", "--robot.type=rosbridge", *options]
    done = subprocess.run(serve, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode in (1, 2)
    assert text in done.stderr
    assert "Traceback" not in done.stderr
