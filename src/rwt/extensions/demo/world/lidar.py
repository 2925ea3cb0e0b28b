"""Laser scanner of the world's boxes and pillars, and its topic `/scan`.

Each visible side is cast onto the rays within its angle of view instead of each ray onto every side: one pass
over about a thousand ray hits, where walking a grid takes tens of thousands of cells. That is a fraction of a
millisecond in plain Python, so no array library is loaded for it.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable

from rwt.extensions.demo import messages
from rwt.extensions.demo.drive import DifferentialDrive
from rwt.extensions.demo.model.urdf import LASER
from rwt.extensions.demo.world.map import Box, Pillar, Pose, World
from rwt_graph import Node, Timer
from rwt_participant.qos import SENSOR_DATA


class Lidar:
    """Laser scanner with a full turn.

    Attributes:
        ray_count: rays in a scan.
        angle_min: direction of the first ray from the robot's heading, radians.
        angle_increment: angle between rays, counterclockwise, radians.
        range_min: minimum measurable distance, metres.
        range_max: maximum measurable distance, metres.
        noise: standard deviation of a range, metres.
    """

    ray_count = 360
    range_min = 0.05
    range_max = 12.0

    def __init__(self, world: World, seed: int = 1) -> None:
        self.angle_min = -math.pi
        self.angle_increment = math.tau / self.ray_count
        self.noise = 0.0
        self._world = world
        self._random = random.Random(seed)
        # Drawn once: scans use random sections of it, which is far cheaper than drawing for each ray.
        self._errors = [self._random.gauss(0.0, 1.0) for _ in range(16 * self.ray_count)]
        angles = [self.angle_min + i * self.angle_increment for i in range(self.ray_count)]
        # Twice around, so that a span of rays across the seam is one range of indices.
        self._cos = [math.cos(angle) for angle in angles] * 2
        self._sin = [math.sin(angle) for angle in angles] * 2

    def scan(self, pose: Pose) -> list[float]:
        """Return the range of each ray from `pose` in metres, rounded to millimetres; infinite if too far."""
        ranges = [math.inf] * (2 * self.ray_count)
        for box in self._world.boxes:
            self._see_box(box, pose, ranges)
        for pillar in self._world.pillars:
            self._see_pillar(pillar, pose, ranges)
        nearest = map(min, ranges[: self.ray_count], ranges[self.ray_count :])
        return self._measured(nearest)

    def _measured(self, distances: Iterable[float]) -> list[float]:
        shortest, longest, noise = self.range_min, self.range_max, self.noise
        first = self._random.randrange(len(self._errors) - self.ray_count)
        errors = self._errors[first : first + self.ray_count]
        noisy = [distance + noise * error for distance, error in zip(distances, errors, strict=True)]
        return [
            math.inf if distance > longest else round(distance, 3) if distance > shortest else shortest
            for distance in noisy
        ]

    def _see_box(self, box: Box, pose: Pose, ranges: list[float]) -> None:
        """Cast the sides that face the scanner: at most two of the four."""
        if pose.x < box.left:
            self._see_side((box.left, box.bottom), (box.left, box.top), pose, ranges)
        elif pose.x > box.right:
            self._see_side((box.right, box.top), (box.right, box.bottom), pose, ranges)
        if pose.y < box.bottom:
            self._see_side((box.right, box.bottom), (box.left, box.bottom), pose, ranges)
        elif pose.y > box.top:
            self._see_side((box.left, box.top), (box.right, box.top), pose, ranges)

    def _see_side(
        self, first: tuple[float, float], last: tuple[float, float], pose: Pose, ranges: list[float]
    ) -> None:
        """Cast a straight side whose ends are counterclockwise as seen from `pose`."""
        x1, y1 = _relative(first, pose)
        x2, y2 = _relative(last, pose)
        length = math.hypot(x2 - x1, y2 - y1)
        normal_x, normal_y = (y2 - y1) / length, (x1 - x2) / length
        away = x1 * normal_x + y1 * normal_y
        if away <= 0.0:
            return
        cos, sin = self._cos, self._sin
        for ray in self._rays(math.atan2(y1, x1), math.atan2(y2, x2)):
            facing = cos[ray] * normal_x + sin[ray] * normal_y
            # A ray along the side would divide by zero; it hits an adjacent side.
            if facing > 1e-9:
                distance = away / facing
                if distance < ranges[ray]:
                    ranges[ray] = distance

    def _see_pillar(self, pillar: Pillar, pose: Pose, ranges: list[float]) -> None:
        x, y = _relative((pillar.x, pillar.y), pose)
        outside = x * x + y * y - pillar.radius**2
        if outside <= 0.0:
            return
        middle, half = math.atan2(y, x), math.asin(pillar.radius / math.hypot(x, y))
        for ray in self._rays(middle - half, middle + half):
            along = self._cos[ray] * x + self._sin[ray] * y
            # Rounding can put the outermost rays just past the edge.
            distance = along - math.sqrt(max(0.0, along * along - outside))
            if distance < ranges[ray]:
                ranges[ray] = distance

    def _rays(self, first: float, last: float) -> range:
        """Return the rays counterclockwise between two directions, as indices of the doubled circle."""
        start = (first - self.angle_min) % math.tau
        span = (last - first) % math.tau
        return range(
            math.ceil(start / self.angle_increment),
            min(math.floor((start + span) / self.angle_increment) + 1, 2 * self.ray_count),
        )


def _relative(point: tuple[float, float], pose: Pose) -> tuple[float, float]:
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    dx, dy = point[0] - pose.x, point[1] - pose.y
    return cos * dx + sin * dy, cos * dy - sin * dx


class ScanPublisher:
    """Publisher of `/scan`."""

    def __init__(self, node: Node, drive: DifferentialDrive, lidar: Lidar) -> None:
        self._node = node
        self._drive = drive
        self._lidar = lidar
        self._frame = messages.frame(node, LASER)
        self._scans = node.advertise("scan", "sensor_msgs/LaserScan", qos=SENSOR_DATA)
        self._period = 0.1
        self._timer: Timer | None = None

    def start(self) -> None:
        """Start to publish scans."""
        self._timer = self._node.create_timer(self._period, self._scan)

    def set_rate(self, rate: float) -> None:
        """Start to scan `rate` times per second."""
        self._period = 1 / rate
        if self._timer is not None:
            self._timer.cancel()
            self.start()

    def _scan(self) -> None:
        # Rays are cast for subscribers only.
        if not self._scans.subscriber_count:
            return
        lidar = self._lidar
        self._scans.publish(
            {
                "header": messages.header(self._node.clock.time_ns(), self._frame),
                "angle_min": lidar.angle_min,
                "angle_max": lidar.angle_min + (lidar.ray_count - 1) * lidar.angle_increment,
                "angle_increment": lidar.angle_increment,
                "scan_time": self._period,
                "range_min": lidar.range_min,
                "range_max": lidar.range_max,
                "ranges": lidar.scan(self._drive.pose),
            }
        )
