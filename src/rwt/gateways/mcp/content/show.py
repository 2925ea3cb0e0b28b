"""Table of the message types that are shown in another way than by their fields."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from rwt.gateways.mcp.content.answer import Answer, as_text, bounded
from rwt.gateways.mcp.content.images import draw_image, draw_map, draw_scan
from rwt.gateways.mcp.content.plain import plain
from rwt_participant.errors import ImageFormat
from rwt_participant.messages import Message


def _cloud(message: Message, side: int) -> Answer:
    """Describe a `sensor_msgs/PointCloud2`: number of points and bounds."""
    import numpy as np

    places = {field.name: field for field in message.fields}
    if any(name not in places or places[name].datatype != 7 for name in ("x", "y", "z")):
        raise ImageFormat("the cloud has no x, y and z of float32")
    step, count = message.point_step, message.width * message.height
    offsets = [places[name].offset for name in ("x", "y", "z")]
    padded = message.height > 1 and message.row_step != step * message.width
    if padded or step < max(offsets) + 4 or len(message.data) < step * count:
        raise ImageFormat(f"{len(message.data)} bytes are no cloud of {count} points")
    order = ">f4" if message.is_bigendian else "<f4"
    point = np.dtype({"names": ["x", "y", "z"], "formats": [order] * 3, "offsets": offsets, "itemsize": step})
    points = np.frombuffer(message.data, point, count)
    xyz = np.stack([points[name].astype(np.float64) for name in ("x", "y", "z")])
    finite = xyz[:, np.isfinite(xyz).all(axis=0)]
    about = f"{count} points, {finite.shape[1]} of them measured, frame {message.header.frame_id}"
    said = [f"{about}, fields {', '.join(places)}"]
    if finite.size:
        said += [
            f"{name} from {low:.2f} to {high:.2f} m"
            for name, low, high in zip("xyz", finite.min(axis=1), finite.max(axis=1), strict=True)
        ]
    return ("; ".join(said),)


_SEEN: Final[Mapping[str, Callable[[Message, int], Answer]]] = MappingProxyType(
    {
        "sensor_msgs/Image": draw_image,
        "sensor_msgs/CompressedImage": draw_image,
        "sensor_msgs/LaserScan": draw_scan,
        "sensor_msgs/PointCloud2": _cloud,
        "nav_msgs/OccupancyGrid": draw_map,
    }
)


def show(message: Message, type: str, max_bytes: int, side: int) -> Answer:
    """Present a message to a model: as an image with a description if possible, otherwise as JSON."""
    draw = _SEEN.get(type)
    if draw is not None:
        try:
            return draw(message, side)
        except ImageFormat as error:
            return (bounded(f"it cannot be drawn: {error}; {as_text(plain(message))}", max_bytes),)
    return (bounded(as_text(plain(message)), max_bytes),)
