"""Measurements, and their report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from teaching.plan import COMMAND_PERIOD, JOINT_RATE, TF_RATE, Camera


@dataclass(frozen=True, slots=True)
class Teaching:
    """Measurements of one demonstrator.

    Attributes:
        robot: which was taught.
        seconds: how long.
        pictures: that came.
        picture_ages: seconds from the moment that a picture shows to its arrival.
        transforms: messages of tf2_web_republisher.
        joint_states: messages.
        commands: that were sent.
        latencies: seconds from a command to the arrival of the first odometry that shows its effect.
        waypoints: that were recorded.
        cpu: seconds that the demonstrator's own process computed.
    """

    robot: str
    seconds: float
    pictures: int
    picture_ages: tuple[float, ...]
    transforms: int
    joint_states: int
    commands: int
    latencies: tuple[float, ...]
    waypoints: int
    cpu: float


_HEAD = "            pictures/s  age ms   tf/s  joints/s  commands/s  command → effect ms  waypoints"


def percentile(values: Sequence[float], percent: float) -> float:
    """The smallest value that so many percent do not exceed; NaN of none."""
    ordered = sorted(values)
    rank = max(1, math.ceil(len(ordered) * percent / 100))
    return ordered[rank - 1] if ordered else math.nan


def table(teachings: Sequence[Teaching], server_cpu: float, camera: Camera) -> str:
    """The report as text: a row for each demonstrator, and what it cost.

    Args:
        teachings: of all, at least one.
        server_cpu: seconds that the server's process computed meanwhile.
        camera: of the robots.
    """
    lines = [_HEAD, f"{'':22}{'p50':>8}{'':30}{'p50 / p95':>20}"]
    lines += [_row(teaching) for teaching in teachings]
    lines.append(_wanted(camera))
    latencies = [latency for teaching in teachings for latency in teaching.latencies]
    seconds = median(teaching.seconds for teaching in teachings)
    theirs = sum(teaching.cpu for teaching in teachings) / seconds
    lines.append("")
    lines.append(f"command → effect of all: p50 {_ms(latencies, 50)} ms, p95 {_ms(latencies, 95)} ms")
    lines.append(f"CPU of the server, with robots, cameras and encoders: {server_cpu / seconds:.2f} cores")
    lines.append(f"CPU of the demonstrators: {theirs:.2f} cores")
    return "\n".join(lines)


def _row(it: Teaching) -> str:
    rates = [count / it.seconds for count in (it.pictures, it.transforms, it.joint_states, it.commands)]
    delay = f"{_ms(it.latencies, 50)} / {_ms(it.latencies, 95)}"
    rate, tf, joints, commands = rates
    picture = f"{it.robot:12}{rate:10.1f}{_ms(it.picture_ages, 50):>8}"
    return f"{picture}{tf:7.1f}{joints:10.1f}{commands:12.1f}{delay:>21}{it.waypoints:11}"


def _wanted(camera: Camera) -> str:
    return (
        f"{'at most':12}{camera.rate:10.1f}{'':8}{TF_RATE:7.1f}{JOINT_RATE:10.1f}{1 / COMMAND_PERIOD:12.1f}"
    )


def _ms(seconds: Sequence[float], percent: float) -> str:
    return f"{percentile(seconds, percent) * 1000:.0f}"
