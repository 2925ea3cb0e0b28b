"""Calibration of cameras in `CameraInfo`."""

from __future__ import annotations

from typing import Any

import pytest

from rwt import Server
from rwt_lerobot import LeRobotNode
from rwt_lerobot.calibration import CalibrationError, camera_info

CALIBRATION = """
image_width: 32
image_height: 24
camera_name: front
camera_matrix: {rows: 3, cols: 3, data: [30, 0, 16, 0, 30, 12, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [30, 0, 16, 0, 0, 30, 12, 0, 0, 0, 1, 0]}
"""


def test_camera_info_has_the_calibration(arm: Any) -> None:
    with Server("ws://127.0.0.1:0") as robot:
        node = LeRobotNode(robot.node, arm, rate=50.0, calibrations={"front": camera_info(CALIBRATION)})
        info = robot.once("/front/camera_info", "sensor_msgs/CameraInfo", timeout=60)
        node.close()
    assert (info.width, info.height, info.distortion_model) == (32, 24, "plumb_bob")
    assert [*info.k][:3] == [30, 0, 16]
    assert info.d[0] == 0.1
    assert info.header.frame_id == "front_optical_frame"


def test_a_calibration_of_another_size_is_rejected(arm: Any) -> None:
    given = camera_info(CALIBRATION.replace("image_width: 32", "image_width: 640"))
    with Server("ws://127.0.0.1:0") as robot:
        with pytest.raises(CalibrationError, match="front: the calibration is for 640x24, the images"):
            LeRobotNode(robot.node, arm, calibrations={"front": given})
        with pytest.raises(CalibrationError, match="no camera 'side'"):
            LeRobotNode(robot.node, arm, calibrations={"side": given})


@pytest.mark.parametrize("text", ["", "[1", "image_width: 3", CALIBRATION.replace("30, 0, 16, 0, 30", "30")])
def test_what_is_no_calibration(text: str) -> None:
    with pytest.raises(CalibrationError):
        camera_info(text)
