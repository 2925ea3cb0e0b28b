"""View of a camera on the robot: colours and depths, by casting one ray per column.

All obstacles reach from the floor to the ceiling, so one ray determines a whole column: distance of the wall,
its floor and ceiling lines, and the visible strip of its texture. An image of 640x480 takes a few
milliseconds on one core. It needs numpy, so this module is imported with the first subscriber.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rwt.extensions.demo.messages import Message
from rwt.extensions.demo.world.lens import Lens
from rwt.extensions.demo.world.map import Box, Pillar, Pose, World

Floats = NDArray[np.float32]

#: Height of the ceiling, metres.
CEILING: Final = 1.6
#: Distances that the depth camera measures, metres; anything else is 0, which is unknown (REP 118).
NEAREST, FARTHEST = 0.3, 8.0
#: A texture: texels along a metre of wall, texels from the floor to the ceiling, brightnesses.
_ALONG: Final = 32
_UP: Final = 64
_SHADES: Final = 16
#: Distance at which a wall has the darkest shade, metres.
_DARKEST: Final = 10.0
_TILE: Final = 0.5  # side of a floor tile, metres
_COLOURS: Final = (
    (200, 190, 170),
    (190, 90, 70),
    (80, 130, 170),
    (120, 160, 90),
    (200, 160, 70),
    (130, 100, 160),
    (90, 160, 150),
)
#: Number of a float32 in `sensor_msgs/PointField`.
_FLOAT32: Final = 7
_FIELDS: Final = ("x", "y", "z", "rgb")
_STEP: Final = 4 * len(_FIELDS)


@dataclass(frozen=True, slots=True)
class RayHits:
    """Nearest obstacle in each column of an image.

    Attributes:
        depth: metres along the viewing axis.
        texel: offset of the strip of texture in the atlas.
    """

    pose: Pose
    depth: Floats
    texel: NDArray[np.int32]


class View:
    """Renderer of the camera's view.

    Args:
        height: height of the camera above the floor, metres.
    """

    def __init__(self, world: World, lens: Lens, height: float) -> None:
        self._height = height
        self._slopes = (lens.cx - np.arange(lens.width, dtype=np.float32)) / np.float32(lens.focal)
        # Rise of each row's ray per metre of depth, and depth at which it meets the floor or the ceiling.
        self._rises = (lens.cy - np.arange(lens.height, dtype=np.float32)) / np.float32(lens.focal)
        self._planes = np.where(
            self._rises < 0, -height / self._rises, (CEILING - height) / np.maximum(self._rises, 1e-6)
        ).astype(np.float32)
        self._sides = _Sides(world.boxes)
        self._pillars = world.pillars
        self._atlas = _atlas()
        self._tiles, self._ceiling = self._level_surfaces()

    def cast_rays(self, pose: Pose) -> RayHits:
        """Cast a ray for each column of the image from a camera at `pose`."""
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        dx = (cos - self._slopes * sin).astype(np.float32)
        dy = (sin + self._slopes * cos).astype(np.float32)
        depth, along, colour = self._sides.hit(pose, dx, dy)
        for number, pillar in enumerate(self._pillars):
            _hit_pillar(pillar, number, pose, (dx, dy), (depth, along, colour))
        shade = np.minimum(depth * np.float32(_SHADES / _DARKEST), _SHADES - 1).astype(np.int32)
        strip = (along * _ALONG).astype(np.int32) % _ALONG
        return RayHits(pose, depth, ((colour % len(_COLOURS) * _SHADES + shade) * _ALONG + strip) * _UP)

    def colours(self, hits: RayHits) -> NDArray[np.uint8]:
        """Return the image, rows x columns x red, green, blue."""
        above = np.multiply.outer(self._rises, hits.depth)
        above += np.float32(self._height)
        above *= np.float32(_UP / CEILING)
        texel = above.astype(np.int32)
        outside = (above < 0) | (texel >= _UP)
        texel += hits.texel
        image = self._atlas.take(texel, mode="clip")
        np.copyto(image, self._surroundings(hits), where=outside)
        return np.ascontiguousarray(image.view(np.uint8).reshape(*image.shape, 4)[:, :, :3])

    def depths(self, hits: RayHits) -> NDArray[np.uint16]:
        """Return the depth image in millimetres, rows x columns; 0 is unknown (REP 118)."""
        metres = np.minimum(self._planes[:, None], hits.depth)
        metres[(metres < NEAREST) | (metres > FARTHEST)] = 0
        return (metres * np.float32(1000) + np.float32(0.5)).astype(np.uint16)

    def _level_surfaces(self) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """Return colours by row of both kinds of floor tile and of the ceiling; darker far away."""
        light = 1 - np.minimum(self._planes / _DARKEST, 1) * 0.7
        tiles = [_packed(light[:, None] * np.array(colour)) for colour in ((150, 140, 130), (110, 105, 100))]
        return np.stack(tiles), _packed(light[:, None] * np.array((215, 220, 225)))

    def _surroundings(self, hits: RayHits) -> NDArray[np.uint32]:
        rows, columns = len(self._rises), len(self._slopes)
        image = np.empty((rows, columns), np.uint32)
        horizon = int(np.count_nonzero(self._rises >= 0))
        image[:horizon] = self._ceiling[:horizon, None]
        pose, reach = hits.pose, self._planes[horizon:]
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        # + 1000 makes the numbers positive, so that truncation rounds down.
        x = np.multiply.outer(reach, ((cos - self._slopes * sin) / _TILE).astype(np.float32))
        y = np.multiply.outer(reach, ((sin + self._slopes * cos) / _TILE).astype(np.float32))
        x += np.float32(pose.x / _TILE + 1000)
        y += np.float32(pose.y / _TILE + 1000)
        odd = ((x.astype(np.int32) + y.astype(np.int32)) & 1).astype(bool)
        below = self._tiles[:, horizon:, None]
        image[horizon:] = np.where(odd, below[0], below[1])
        return image


class _Sides:
    def __init__(self, boxes: Sequence[Box]) -> None:
        def column(values: list[float]) -> Floats:
            return np.array(values, np.float32)[:, None]

        # Sides along y have an x, sides along x a y; each has a first and a last coordinate.
        self._at_x = column([at for box in boxes for at in (box.left, box.right)])
        self._x_from = column([box.bottom for box in boxes for _ in "lr"])
        self._x_to = column([box.top for box in boxes for _ in "lr"])
        self._at_y = column([at for box in boxes for at in (box.bottom, box.top)])
        self._y_from = column([box.left for box in boxes for _ in "bt"])
        self._y_to = column([box.right for box in boxes for _ in "bt"])

    def hit(self, pose: Pose, dx: Floats, dy: Floats) -> tuple[Floats, Floats, NDArray[np.int32]]:
        """Return for each ray: depth of the nearest side, metres along that side, and number of its box."""
        with np.errstate(divide="ignore", invalid="ignore"):
            depth_x = (self._at_x - np.float32(pose.x)) / dx
            along_x = np.float32(pose.y) + depth_x * dy
            depth_y = (self._at_y - np.float32(pose.y)) / dy
            along_y = np.float32(pose.x) + depth_y * dx
            missed_x = ~((depth_x > 0) & (along_x >= self._x_from) & (along_x <= self._x_to))
            missed_y = ~((depth_y > 0) & (along_y >= self._y_from) & (along_y <= self._y_to))
        depth_x[missed_x] = np.inf
        depth_y[missed_y] = np.inf
        depth = np.concatenate((depth_x, depth_y))
        side = depth.argmin(axis=0)
        ray = np.arange(len(dx))
        # Walls enclose the floor: only a ray between two sides at a corner hits nothing.
        nearest = np.minimum(depth[side, ray], np.float32(2 * _DARKEST))
        along = np.nan_to_num(np.concatenate((along_x, along_y))[side, ray]) + np.float32(1000)
        box = (side % len(self._at_x)) // 2
        return nearest, along, box.astype(np.int32)


def _hit_pillar(
    pillar: Pillar,
    number: int,
    pose: Pose,
    direction: tuple[Floats, Floats],
    found: tuple[Floats, Floats, NDArray[np.int32]],
) -> None:
    (dx, dy), (depth, along, colour) = direction, found
    x, y = pillar.x - pose.x, pillar.y - pose.y
    # |t * d - p| = r, solved for the smaller t.
    square = dx * dx + dy * dy
    towards = dx * np.float32(x) + dy * np.float32(y)
    inside = towards * towards - square * np.float32(x * x + y * y - pillar.radius**2)
    t = (towards - np.sqrt(np.maximum(inside, 0))) / square
    hit = (inside > 0) & (t > 0) & (t < depth)
    depth[hit] = t[hit]
    angle = np.arctan2(t * dy - np.float32(y), t * dx - np.float32(x))
    along[hit] = angle[hit] * np.float32(pillar.radius) + np.float32(1000)
    colour[hit] = number + 1


def _atlas() -> NDArray[np.uint32]:
    """Return all textures in all shades: colour, shade, texel along the wall, texel up, flattened."""
    grain = np.random.default_rng(1).normal(1.0, 0.05, (_ALONG, _UP))
    grain[:, :4] *= 0.5  # a skirting board
    grain[:: _ALONG // 2] *= 0.75  # joints, twice a metre
    grain[:, :: _UP // 4] *= 0.85
    shades = 1 - np.arange(_SHADES) / _SHADES * 0.7
    colours = np.array(_COLOURS, np.float64)
    return _packed(colours[:, None, None, None, :] * shades[:, None, None, None] * grain[:, :, None]).reshape(
        -1
    )


def _packed(colours: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Return colours as one number each, whose first three bytes in memory are red, green and blue."""
    padded = np.zeros((*colours.shape[:-1], 4), np.uint8)
    padded[..., :3] = np.clip(colours, 0, 255)
    packed: NDArray[np.uint32] = padded.view(np.uint32)[..., 0]
    return packed


def point_cloud(
    header: Message, depths: NDArray[np.uint16], colours: NDArray[np.uint8], lens: Lens, skip: int
) -> Message:
    """Return an organised `sensor_msgs/PointCloud2`; NaN where no depth was measured.

    Points are in the optical frame: x right, y down, z forward, in metres. `rgb` is the bytes blue, green,
    red and 0 as a float, as in PCL.

    Args:
        depths: rows x columns, millimetres; 0 is unknown.
        colours: rows x columns x red, green, blue.
        skip: distance between rows, and columns, that become points.
    """
    down, across = (
        (np.arange(0, count, skip, dtype=np.float32) - np.float32(centre)) / np.float32(lens.focal)
        for count, centre in zip(depths.shape, (lens.cy, lens.cx), strict=True)
    )
    depths, colours = depths[::skip, ::skip], colours[::skip, ::skip]
    rows, columns = depths.shape
    points = np.empty((rows, columns, len(_FIELDS)), "<f4")
    z = depths.astype(np.float32) * np.float32(0.001)
    z[depths == 0] = np.nan
    np.multiply(z, across, out=points[:, :, 0])
    np.multiply(z, down[:, None], out=points[:, :, 1])
    points[:, :, 2] = z
    packed = points.view(np.uint8)
    packed[:, :, 12:15] = colours[:, :, ::-1]
    packed[:, :, 15] = 0
    return {
        "header": header,
        "height": rows,
        "width": columns,
        "fields": [
            {"name": name, "offset": 4 * number, "datatype": _FLOAT32, "count": 1}
            for number, name in enumerate(_FIELDS)
        ],
        "is_bigendian": False,
        "point_step": _STEP,
        "row_step": _STEP * columns,
        "data": points.tobytes(),
        "is_dense": False,
    }
