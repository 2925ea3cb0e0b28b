"""Bounded texts of messages for a model."""

from __future__ import annotations

import io
import json
import math
import sys
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from PIL import Image

from rwt.extensions.mcp.content.answer import Picture, as_text, bounded
from rwt.extensions.mcp.content.images import show
from rwt.extensions.mcp.content.plain import field, numeric_fields, plain
from rwt.extensions.mcp.errors import ToolError
from rwt_interfaces.payload import Payload
from tests.conftest import REGISTRIES

REGISTRY = REGISTRIES["jazzy"]


def message(type: str, **fields: object) -> Any:
    return Payload.from_value(REGISTRY.message(type), fields).value()


def shown(type: str, **fields: object) -> tuple[str, Sequence[Image.Image]]:
    """The text, and the pictures."""
    parts = show(message(type, **fields), type, 4096, 128)
    pictures = [Image.open(io.BytesIO(part.data)) for part in parts if isinstance(part, Picture)]
    assert all(max(picture.size) <= 128 for picture in pictures)
    return "\n".join(part for part in parts if isinstance(part, str)), pictures


@given(st.text(), st.integers(1024, 4096))
def test_a_text_is_never_longer_than_it_may_be(text: str, most: int) -> None:
    for given_text in (text, text * 1000):
        cut = bounded(given_text, most)
        assert len(cut.encode()) <= most
        assert cut == given_text or "cut at" in cut


@given(st.lists(st.floats(), max_size=200))
@example([8.988465674311579e307] * 25)
@example([sys.float_info.max] * 25)
@example([sys.float_info.max] * 47 + [-sys.float_info.max])
def test_any_numbers_are_shown_as_json(values: list[float]) -> None:
    text = as_text(plain(message("std_msgs/Float64MultiArray", data=values)))
    data = json.loads(text)["data"]
    if len(values) > 24:
        finite = [value for value in values if math.isfinite(value)]
        assert data["length"] == len(values) and len(data["first"]) == 8
        if finite:
            assert (data["min"], data["max"]) == (min(finite), max(finite))
    else:
        assert len(data) == len(values)


def test_long_lists_octets_and_texts_give_way_to_what_they_hold() -> None:
    cloud = plain(message("sensor_msgs/PointCloud2", data=bytes(1000)))
    assert isinstance(cloud, dict) and cloud["data"] == "1000 bytes"
    log = plain(message("std_msgs/String", data="x" * 10_000))
    assert isinstance(log, dict) and log["data"].endswith("… (10000 characters)")
    many = plain(message("nav_msgs/Path", poses=[{}] * 100))
    assert isinstance(many, dict) and (many["poses"]["length"], len(many["poses"]["first"])) == (100, 12)


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("pose.pose.position.x", 1.5),
        ("pose.covariance[35]", 0.25),
        ("header.frame_id", "map"),
        ("pose.pose.position.w", "there are x, y, z"),
        ("pose.covariance[36]", "the list has 36 items"),
        ("pose.covariance[x]", "expected a number in brackets"),
        ("pose.covariance[-1]", "expected a number in brackets"),
        ("header.frame_id.x", "there is nothing below"),
        ("header.frame_id[0]", "of what is no list"),
        ("header[0]", "of what is no list"),
        ("", "there is no field ''"),
        ("__class__", "there is no field '__class__'"),
        ("pose.__init__", "there is no field '__init__'"),
    ],
)
def test_a_field_is_found_by_its_path_or_what_there_is_is_said(path: str, expected: object) -> None:
    odometry = message(
        "nav_msgs/Odometry",
        header={"frame_id": "map"},
        pose={"pose": {"position": {"x": 1.5}}, "covariance": [0.0] * 35 + [0.25]},
    )
    try:
        found = field(odometry, path)
    except ToolError as error:
        assert isinstance(expected, str) and expected in str(error)
    else:
        assert found == expected


def test_the_numbers_of_a_message_have_paths() -> None:
    twist = message("geometry_msgs/Twist", linear={"x": 1.0}, angular={"z": -2.0})
    found = numeric_fields(twist)
    assert found["linear.x"] == 1.0 and found["angular.z"] == -2.0 and len(found) == 6


def test_depth_is_shown_as_shades() -> None:
    depths = (1000, 0, 3000)
    rows = b"".join(depth.to_bytes(2, "little") * 20 for depth in depths)
    text, (picture,) = shown("sensor_msgs/Image", height=3, width=20, step=40, encoding="16UC1", data=rows)
    assert "depth from 1.00 m (dark) to 3.00 m (bright)" in text
    shades = list(picture.convert("L").crop((5, 0, 6, 3)).tobytes())
    assert shades[1] == 0 < shades[0] < shades[2]


def test_a_cloud_is_told_in_words() -> None:
    import struct

    fields = [{"name": name, "offset": 4 * at, "datatype": 7, "count": 1} for at, name in enumerate("xyz")]
    data = struct.pack("<6f", 1, 2, 3, -1, float("nan"), 0) + struct.pack("<3f", -4, 5, 6)
    text, pictures = shown(
        "sensor_msgs/PointCloud2", height=1, width=3, point_step=12, row_step=36, fields=fields, data=data
    )
    assert "3 points, 2 of them measured" in text and "x from -4.00 to 1.00 m" in text and not pictures


@pytest.mark.parametrize(
    ("type", "fields"),
    [
        ("sensor_msgs/Image", {"height": 4_000_000_000, "width": 4_000_000_000, "encoding": "rgb8"}),
        ("sensor_msgs/Image", {"height": 10, "width": 10, "encoding": "rgb8", "step": 30, "data": b"x"}),
        ("sensor_msgs/Image", {"height": 1, "width": 1, "encoding": "nought", "step": 1, "data": b"x"}),
        ("sensor_msgs/CompressedImage", {"format": "png", "data": b"\x89PNG\r\n\x1a\n" + bytes(100)}),
        ("nav_msgs/OccupancyGrid", {"info": {"width": 4_000_000_000, "height": 4_000_000_000}}),
        ("nav_msgs/OccupancyGrid", {"info": {"width": 10, "height": 10}, "data": [1] * 99}),
        ("sensor_msgs/PointCloud2", {"height": 1, "width": 1_000_000, "point_step": 12, "data": b"x"}),
        (
            "sensor_msgs/PointCloud2",
            {"fields": [{"name": each, "datatype": 7} for each in "xyz"], "width": 9},
        ),
    ],
)
def test_what_is_no_picture_is_told_as_what_it_is(type: str, fields: dict[str, object]) -> None:
    text, pictures = shown(type, **fields)
    assert text.startswith("it cannot be drawn: ") and not pictures


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"ranges": [math.nan] * 10, "range_max": 5.0},
        {"ranges": [1.0] * 10, "range_max": 5.0},
        {"ranges": [1e38] * 10, "range_max": 3e38, "angle_increment": 1e30},
        {"ranges": [0.0] * 10, "range_max": 5.0, "angle_increment": math.inf},
        {"ranges": [1e-30] * 10, "range_max": 5.0},
    ],
)
def test_any_scan_is_drawn_or_told(fields: dict[str, object]) -> None:
    text, _ = shown("sensor_msgs/LaserScan", **fields)
    assert "distances" in text
