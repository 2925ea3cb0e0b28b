"""`rwt gate explain` and `rwt gate check`: the decisions of a server, without one."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.core.access.gated_robot import GatedRobot, drive
from tests.core.cli.conftest import Rwt, check_transcript, transcript


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(Path(__file__).parent / "transcripts" / "gate.toml", "robot.toml")
    Path("wrong.toml").write_text("demo = 'yes'")


@transcript("gate.txt")
def test_a_decision_is_that_of_the_transcript(rwt: Rwt, line: str, printed: str) -> None:
    check_transcript(rwt, line, printed)


@pytest.mark.parametrize("speed", [0.5, 2.0, -1.0])
def test_the_decision_is_that_of_a_server(rwt: Rwt, speed: float) -> None:
    words = ("--as", "phone", "publish", "/cmd_vel", f"{{linear: {{x: {speed}}}}}")
    said = rwt("gate", "check", "robot.toml", *words, "--type", "geometry_msgs/msg/Twist", "--json").json
    fields = {"linear.x": {"min": -0.3, "max": 0.8, "beyond": "clamp"}}
    robot = GatedRobot({"drive": {"topics": ["/cmd_vel"], "fields": fields}})
    drive(robot.client(), speed)
    ((received, _),) = robot.take()
    assert said["sent"].startswith(f'{{"linear":{{"x":{received}' if received != speed else "")
