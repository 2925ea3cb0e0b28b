"""Messages as images for a model: camera images, and drawings of scans and maps, limited in size."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from rwt.extensions.mcp.content.answer import Parts, Picture, as_text, bounded
from rwt.extensions.mcp.content.plain import plain
from rwt_participant.errors import ImageFormat
from rwt_participant.images import image_to_pillow, open_compressed
from rwt_participant.messages import Message

if TYPE_CHECKING:
    from PIL.Image import Image

#: Maximum number of pixels of a compressed image.
_MAX_PIXELS: Final = 40_000_000

#: Maximum number of cells of a map that is drawn.
_MAX_CELLS: Final = 100_000_000

_JPEG_QUALITY: Final = 80


def draw_image(message: Message, side: int) -> Parts:
    """Draw a `sensor_msgs/Image` or `CompressedImage`; near is dark in depth images. Raises ImageFormat."""
    if hasattr(message, "format"):
        image = open_compressed(message, _MAX_PIXELS)
        about = f"{image.width}x{image.height} {message.format}"
    else:
        if message.width * message.height > _MAX_PIXELS:
            raise ImageFormat(f"a picture of {message.width}x{message.height} is too large")
        image = image_to_pillow(message)
        about = f"{message.width}x{message.height} {message.encoding}"
    frame = f", frame {message.header.frame_id}" if message.header.frame_id else ""
    if image.mode in ("I;16", "I;16B", "I", "F"):
        image, depths = _shades(image)
        return (f"{about}{frame}; {depths}", _png(_smaller(image, side)))
    return (f"{about}{frame}", _jpeg(_smaller(image, side)))


def _shades(depth: Image) -> tuple[Image, str]:
    import numpy as np
    from PIL import Image as pillow

    values = np.asarray(depth, np.float64)
    metres = values if depth.mode == "F" else values / 1000
    seen = metres[np.isfinite(metres) & (metres > 0)]
    if not len(seen):
        return pillow.fromarray(np.zeros(metres.shape, np.uint8)), "no depth was measured"
    low, high = float(seen.min()), float(seen.max())
    scaled = np.nan_to_num((metres - low) / max(high - low, 1e-9), nan=1.0, posinf=1.0, neginf=1.0)
    shades = (np.clip(scaled, 0, 1) * 225 + 30).astype(np.uint8)
    shades[~(np.isfinite(metres) & (metres > 0))] = 0
    text = f"depth from {low:.2f} m (dark) to {high:.2f} m (bright); black is not measured"
    return pillow.fromarray(shades), text


def draw_scan(message: Message, side: int) -> Parts:
    """Draw a `sensor_msgs/LaserScan` from above, ahead is up, and describe distances."""
    import numpy as np
    from PIL import Image as pillow
    from PIL import ImageDraw

    ranges = np.asarray(message.ranges, np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        angles = message.angle_min + np.arange(len(ranges)) * message.angle_increment
    valid = (
        np.isfinite(angles)
        & np.isfinite(ranges)
        & (ranges >= message.range_min)
        & (ranges <= message.range_max)
    )
    words = _scan_in_words(message, ranges, angles, valid)
    if not valid.any():
        return (words,)
    reach = float(ranges[valid].max()) * 1.05
    half = side / 2
    image = pillow.new("RGB", (side, side), "white")
    draw = ImageDraw.Draw(image)
    step = _ring_step(reach)
    rings = 0
    for number in range(1, int(reach / step) + 1):
        radius = number * step / reach * half
        draw.ellipse((half - radius, half - radius, half + radius, half + radius), outline="#cccccc")
        rings = number
    for distance, angle in zip(ranges[valid], angles[valid], strict=True):
        x = half - math.sin(angle) * distance / reach * half
        y = half - math.cos(angle) * distance / reach * half
        draw.rectangle((x - 1, y - 1, x + 1, y + 1), fill="black")
    draw.polygon([(half, half - 8), (half - 5, half + 6), (half + 5, half + 6)], fill="#d04020")
    return (f"{words}; drawn from above, ahead is up, {rings} rings {step:g} m apart", _png(image))


def _ring_step(reach: float) -> float:
    """Return the distance between rings in metres, for a handful of rings."""
    step = 10.0 ** math.floor(math.log10(max(reach, 1e-3)))
    return step if reach / step >= 3 else step / 4


#: Directions around the robot, in degrees counterclockwise from ahead.
_SECTORS: Final = (("ahead", -30, 30), ("left", 30, 120), ("behind", 120, 240), ("right", -120, -30))


def _scan_in_words(message: Message, ranges: object, angles: object, valid: object) -> str:
    import numpy as np

    distances, seen = np.asarray(ranges), np.asarray(valid)
    degrees = np.degrees(np.where(seen, np.asarray(angles), 0.0))
    said = [f"{len(distances)} distances, {int(seen.sum())} valid, frame {message.header.frame_id}"]
    for name, low, high in _SECTORS:
        inside = seen & ((degrees - low) % 360 <= high - low)
        near = f"{float(distances[inside].min()):.2f} m" if inside.any() else "nothing in reach"
        said.append(f"{name}: {near}")
    return "; ".join(said)


def draw_map(message: Message, side: int) -> Parts:
    """Draw a `nav_msgs/OccupancyGrid`, north (+y) up, and describe its extent. Raises ImageFormat."""
    import numpy as np
    from PIL import Image as pillow

    info = message.info
    count = info.width * info.height
    cells = message.data
    if not count or count > _MAX_CELLS or len(cells) < count:
        raise ImageFormat(f"{len(cells)} cells are no map of {info.width}x{info.height}")
    raw = isinstance(cells, bytes | bytearray | memoryview)
    flat = np.frombuffer(cells, np.int8, count) if raw else np.asarray(cells[:count], np.int8)
    grid = flat.reshape(info.height, info.width)
    grey = np.where(grid < 0, 205, 254 - np.clip(grid.astype(np.int16), 0, 100) * 254 // 100)
    image = _smaller(pillow.fromarray(np.flipud(grey).astype(np.uint8)), side)
    origin = info.origin.position
    unknown, occupied = (float((grid < 0).mean()), float((grid >= 50).mean()))
    right, top = origin.x + info.width * info.resolution, origin.y + info.height * info.resolution
    words = (
        f"map of {info.width}x{info.height} cells of {info.resolution:.3g} m,"
        f" frame {message.header.frame_id}: x from {origin.x:.2f} to {right:.2f} m (left to right),"
        f" y from {origin.y:.2f} to {top:.2f} m (bottom to top);"
        f" {occupied:.0%} occupied (black), {unknown:.0%} unknown (grey), the rest free (white)"
    )
    return (words, _png(image))


def _smaller(image: Image, side: int) -> Image:
    if max(image.size) > side:
        image.thumbnail((side, side))
    return image


def _jpeg(image: Image) -> Picture:
    file = io.BytesIO()
    flat = image if image.mode in ("L", "RGB") else image.convert("RGB")
    flat.save(file, "JPEG", quality=_JPEG_QUALITY)
    return Picture(file.getvalue(), "image/jpeg")


def _png(image: Image) -> Picture:
    file = io.BytesIO()
    image.save(file, "PNG", optimize=True)
    return Picture(file.getvalue(), "image/png")


def _cloud(message: Message, side: int) -> Parts:
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


_SEEN: Final[Mapping[str, Callable[[Message, int], Parts]]] = MappingProxyType(
    {
        "sensor_msgs/Image": draw_image,
        "sensor_msgs/CompressedImage": draw_image,
        "sensor_msgs/LaserScan": draw_scan,
        "sensor_msgs/PointCloud2": _cloud,
        "nav_msgs/OccupancyGrid": draw_map,
    }
)


def show(message: Message, type: str, max_bytes: int, side: int) -> Parts:
    """Present a message to a model: as an image with a description if possible, otherwise as JSON."""
    draw = _SEEN.get(type)
    if draw is not None:
        try:
            return draw(message, side)
        except ImageFormat as error:
            return (bounded(f"it cannot be drawn: {error}; {as_text(plain(message))}", max_bytes),)
    return (bounded(as_text(plain(message)), max_bytes),)
