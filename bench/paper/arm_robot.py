"""A mobile robot with a 6-DOF arm and 52 frames, and a minute of somebody driving it by hand.

Everything is a function of time, so that the minute can be played as fast as the machine can.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from rwt_tf2 import Transform
from rwt_tf2.quaternion import Vector

MINUTE = 60.0
"""Seconds."""

ROOT = "map"

Place = Callable[[float], Transform]
"""Where a frame is in its parent at some second."""


@dataclass(frozen=True, slots=True)
class Link:
    """One frame of the robot.

    Attributes:
        parent: the frame it is given in.
        at: where it is; constant for what is screwed on.
        moves: whether it ever moves in its parent.
    """

    parent: str
    at: Place
    moves: bool


@dataclass(frozen=True, slots=True)
class Phase:
    """A time during which the hand is on some stick, seconds."""

    begin: float
    end: float

    def share(self, second: float) -> float:
        """Return the completed share of the phase: smooth from 0 to 1."""
        part = min(1.0, max(0.0, (second - self.begin) / (self.end - self.begin)))
        return part * part * (3 - 2 * part)


DRIVES = (Phase(3, 11), Phase(14, 19), Phase(36, 47))
ARM_MOVES = (Phase(19, 27), Phase(29, 33), Phase(47, 56))
LOOKS = (Phase(11, 14), Phase(27, 29))
GRASPS = (Phase(33, 35), Phase(56, 58))


def done(phases: tuple[Phase, ...], second: float) -> float:
    """Return how many are completed by then."""
    return sum(phase.share(second) for phase in phases)


def base_at(second: float) -> Transform:
    """About two metres and most of a turn in each phase of driving."""
    way = done(DRIVES, second)
    heading = 1.2 * math.sin(2.1 * way)
    return Transform.from_rpy((2.2 * way, 0.8 * math.sin(1.7 * way), 0.0), 0.0, 0.0, heading)


def wheel_at(x: float, y: float) -> Place:
    def at(second: float) -> Transform:
        return Transform.from_rpy((x, y, 0.08), 0.0, 2.2 / 0.08 * done(DRIVES, second), 0.0)

    return at


def caster_at(x: float, y: float) -> Place:
    def at(second: float) -> Transform:
        return Transform.from_rpy((x, y, 0.05), 0.0, 0.0, math.sin(3.0 * done(DRIVES, second)))

    return at


def joint_at(number: int, offset: Vector) -> Place:
    """A joint of the arm: they turn about z and y in turns, each by its own amount."""

    def at(second: float) -> Transform:
        angle = (0.9 - 0.1 * number) * math.sin((1.3 + 0.2 * number) * done(ARM_MOVES, second))
        turns = (0.0, 0.0, angle) if number % 2 == 0 else (0.0, angle, 0.0)
        return Transform.from_rpy(offset, *turns)

    return at


def finger_at(number: int) -> Place:
    def at(second: float) -> Transform:
        return Transform.from_rpy((0.05, 0.0, 0.0), 2.094 * number, 0.4 * done(GRASPS, second), 0.0)

    return at


def look_at(height: float, axis: int) -> Place:
    def at(second: float) -> Transform:
        angle = 0.7 * math.sin(2.0 * done(LOOKS, second))
        turns = (0.0, 0.0, angle) if axis == 2 else (0.0, angle, 0.0)
        return Transform.from_rpy((0.0, 0.0, height), *turns)

    return at


def screwed_on(x: float, y: float, z: float, yaw: float = 0.0) -> Place:
    """At the same place always."""
    transform = Transform.from_rpy((x, y, z), 0.0, 0.0, yaw)
    return lambda second: transform


def _links() -> Iterator[tuple[str, Link]]:
    yield "odom", Link(ROOT, screwed_on(1.5, -0.5, 0.0, 0.3), moves=False)
    yield "base_footprint", Link("odom", base_at, moves=True)
    yield "base_link", Link("base_footprint", screwed_on(0, 0, 0.1), moves=False)
    for side, y in (("left", 0.25), ("right", -0.25)):
        yield f"{side}_wheel_link", Link("base_link", wheel_at(0.0, y), moves=True)
        yield f"{side}_caster_link", Link("base_link", caster_at(-0.3, 0.6 * y), moves=True)
        yield f"{side}_caster_wheel_link", Link(f"{side}_caster_link", wheel_at(0.0, 0.0), moves=True)
    for number in range(13):
        angle = math.tau * number / 13
        yield (
            f"sonar_{number}_link",
            Link(
                "base_link", screwed_on(0.3 * math.cos(angle), 0.3 * math.sin(angle), 0.2, angle), moves=False
            ),
        )
    for number, name in enumerate(
        ("laser", "imu_link", "gps_link", "battery_link", "bumper_link", "plate_link")
    ):
        yield name, Link("base_link", screwed_on(0.05 * number, 0.0, 0.1 * number), moves=False)
    yield from _arm()
    yield from _head()


def _arm() -> Iterator[tuple[str, Link]]:
    yield "arm_base_link", Link("plate_link", screwed_on(0.1, 0.0, 0.05), moves=False)
    parent = "arm_base_link"
    offsets = ((0, 0, 0.15), (0, 0, 0.12), (0.41, 0, 0), (0.1, 0, 0), (0.11, 0, 0), (0.08, 0, 0))
    for number, offset in enumerate(offsets):
        yield f"arm_link_{number + 1}", Link(parent, joint_at(number, offset), moves=True)
        parent = f"arm_link_{number + 1}"
    yield "hand_link", Link(parent, screwed_on(0.06, 0, 0), moves=False)
    yield "tool_link", Link("hand_link", screwed_on(0.12, 0, 0), moves=False)
    for number in range(3):
        yield f"finger_{number + 1}_link", Link("hand_link", finger_at(number), moves=True)
        yield (
            f"finger_{number + 1}_tip",
            Link(f"finger_{number + 1}_link", screwed_on(0.06, 0, 0), moves=False),
        )


def _head() -> Iterator[tuple[str, Link]]:
    yield "mast_link", Link("plate_link", screwed_on(-0.2, 0.0, 0.5), moves=False)
    yield "pan_link", Link("mast_link", look_at(0.1, 2), moves=True)
    yield "tilt_link", Link("pan_link", look_at(0.05, 1), moves=True)
    yield "camera_link", Link("tilt_link", screwed_on(0.02, 0, 0.02), moves=False)
    for number, name in enumerate(("rgb", "depth")):
        yield f"camera_{name}_frame", Link("camera_link", screwed_on(0, 0.02 * number, 0), moves=False)
        yield (
            f"camera_{name}_optical_frame",
            Link(f"camera_{name}_frame", screwed_on(0, 0, 0, -math.pi / 2), moves=False),
        )


LINKS: Mapping[str, Link] = dict(_links())
"""Every frame but the root, parents first."""
