"""The node `robot_state_publisher` and its settings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rwt import Server
from rwt.access.settings import SettingsError

URDF = """<robot name="wheel"><link name="base"/><link name="rim"/>
  <joint name="axle" type="continuous"><parent link="base"/><child link="rim"/><axis xyz="0 1 0"/></joint>
</robot>"""


def server(**settings: object) -> Server:
    return Server(
        "ws://127.0.0.1:0", nodes=["rosapi", "robot_state_publisher"], robot_state_publisher=settings
    )


def test_it_publishes_what_its_settings_say(tmp_path: Path) -> None:
    file = tmp_path / "wheel.urdf"
    file.write_text(URDF)
    heard: list[Any] = []
    with server(urdf=file, frame_prefix="anna/", publish_frequency=1.0) as robot:
        assert robot.params.get("/robot_state_publisher:robot_description") == URDF
        assert robot.once("/robot_description").data == URDF
        robot.subscribe("/tf", lambda message: heard.extend(message.transforms))
        for nanosec in (0, 999_999_999):
            state = {"header": {"stamp": {"sec": 5, "nanosec": nanosec}}, "name": ["axle"], "position": [0.0]}
            robot.publish("/joint_states", state, "sensor_msgs/JointState")
        robot.clock.sleep(0.0)
    assert [(each.header.frame_id, each.child_frame_id) for each in heard] == [("anna/base", "anna/rim")]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "No such file"),
        (b"<sdf/>", "wheel.urdf: the description starts with <sdf>"),
        (b"\xff", "wheel.urdf: not UTF-8"),
        (b" " * (4 * 1024 * 1024 + 1), "larger than"),
    ],
)
def test_a_file_that_is_no_description_is_an_error_of_the_setting(
    tmp_path: Path, content: bytes | None, reason: str
) -> None:
    file = tmp_path / "wheel.urdf"
    if content is not None:
        file.write_bytes(content)
    match = r"`robot_state_publisher\.urdf`: .*" + reason
    with pytest.raises(SettingsError, match=match), server(urdf=file):
        pass


def test_the_file_is_required() -> None:
    with pytest.raises(SettingsError, match=r"`robot_state_publisher\.urdf`: required"), server():
        pass


@pytest.mark.parametrize("rate", [0, -1, 1001, float("inf"), float("nan"), "fast"])
def test_the_frequency_has_a_range(rate: object) -> None:
    with pytest.raises(SettingsError, match="publish_frequency"):
        server(urdf="wheel.urdf", publish_frequency=rate)
