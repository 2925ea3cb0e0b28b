"""Calibration of cameras, as ROS's camera_calibration writes it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import yaml

#: Fields of `sensor_msgs/CameraInfo` by the matrices of the file, with their number of values.
_MATRICES: Final[tuple[tuple[str, str, int | None], ...]] = (
    ("k", "camera_matrix", 9),
    ("d", "distortion_coefficients", None),
    ("r", "rectification_matrix", 9),
    ("p", "projection_matrix", 12),
)


class CalibrationError(ValueError):
    """A calibration cannot be read; the text gives the reason."""


def camera_info(text: str) -> Mapping[str, Any]:
    """Return the `sensor_msgs/CameraInfo` of a calibration in YAML, without a header.

    Raises:
        CalibrationError: a value is missing or invalid.
    """
    try:
        given = yaml.safe_load(text)
        info: dict[str, Any] = {
            "width": int(given["image_width"]),
            "height": int(given["image_height"]),
            "distortion_model": str(given["distortion_model"]),
        }
        for field, name, count in _MATRICES:
            info[field] = [float(value) for value in given[name]["data"]]
            if count is not None and len(info[field]) != count:
                raise ValueError(f"{name} has {len(info[field])} values, expected {count}")
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise CalibrationError(f"not a calibration of a camera: {type(error).__name__}: {error}") from error
    return info
