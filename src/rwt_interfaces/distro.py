"""What a ROS distribution changes about names and messages, as data."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Distro:
    """One distribution.

    Attributes:
        name: ``jazzy``, ``noetic``.
        ros_version: 1 or 2.
        time_fields: the names of a time's two halves, whole seconds and nanoseconds.
    """

    name: str
    ros_version: int
    time_fields: tuple[str, str]


JAZZY = Distro("jazzy", 2, ("sec", "nanosec"))
NOETIC = Distro("noetic", 1, ("secs", "nsecs"))

#: The distributions that `rwt serve --distro` takes.
DISTROS: dict[str, Distro] = {distro.name: distro for distro in (JAZZY, NOETIC)}
