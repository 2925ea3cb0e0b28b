"""A graph on a simulated clock, and messages with pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry

REGISTRY = Registry()


def image(pixels: Any, encoding: str, *, big: bool = False, padding: int = 0) -> dict[str, Any]:
    """A `sensor_msgs/Image` of an array, rows padded with rubbish."""
    array = np.ascontiguousarray(pixels)
    if array.dtype.itemsize > 1:
        array = array.astype(array.dtype.newbyteorder(">" if big else "<"))
    height, width = array.shape[:2]
    rows = [array[row].tobytes() + b"\xee" * padding for row in range(height)]
    return {
        "header": {"stamp": {"sec": 12, "nanosec": 345678901}, "frame_id": "camera"},
        "width": width,
        "height": height,
        "encoding": encoding,
        "is_bigendian": int(big),
        "step": len(rows[0]),
        "data": b"".join(rows),
    }


def payload(message: dict[str, Any]) -> Payload:
    """The message as the graph carries it."""
    kind = "sensor_msgs/CompressedImage" if "format" in message else "sensor_msgs/Image"
    return Payload.from_value(REGISTRY.message(kind), message)


def scene(shift: int = 0, width: int = 64, height: int = 48) -> Any:
    """A smooth colourful picture, which codecs like; `shift` moves it."""
    y, x = np.mgrid[0:height, 0:width]
    red = 128 + 100 * np.sin((x + shift) / 9)
    green = 128 + 100 * np.sin((y + shift) / 7)
    blue = np.full_like(red, 40 + shift % 160)
    return np.stack((red, green, blue), axis=2).astype(np.uint8)
