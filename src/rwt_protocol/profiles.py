"""The versions of the protocol, as data: which op and which member belongs, and when `status` is sent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Final

from rwt_protocol.ops import OPS, Direction


class StatusRule(Enum):
    """When a client hears `status` (X04)."""

    FROM_THE_START = "from the start"
    """At level `error` until it sets another (STA-02)."""
    AFTER_SET_LEVEL = "after set_level"
    """Not before it has asked: shipping clients log a traceback for each (STA-05)."""
    NEVER = "never"


@dataclass(frozen=True)
class Profile:
    """One version of the protocol.

    Attributes:
        name: as it is written in settings.
        ops: the ops that exist in it.
        without: members that do not exist in it, by op. Like every unknown member they are ignored (ENV-01).
        status: when a client hears `status`.
        both_ways: ops that servers take too, although servers alone send them in the other versions.
    """

    name: str
    ops: frozenset[str]
    status: StatusRule
    without: Mapping[str, frozenset[str]] = field(default_factory=lambda: MappingProxyType({}))
    both_ways: frozenset[str] = frozenset()

    def direction(self, op: str) -> Direction:
        """Who sends `op` in this version."""
        return Direction.BOTH if op in self.both_ways else OPS[op].direction

    def arriving(self, direction: Direction) -> frozenset[str]:
        """The names of the ops that arrive where messages of `direction` do; all of them for `BOTH`."""
        if direction is Direction.BOTH:
            return self.ops
        return frozenset(op for op in self.ops if self.direction(op) in (direction, Direction.BOTH))

    def __hash__(self) -> int:
        return hash(self.name)


_ACTION_OPS: Final = frozenset(name for name in OPS if "action" in name)
_ALL: Final = frozenset(OPS)


def _without(**members: str) -> Mapping[str, frozenset[str]]:
    return MappingProxyType({op: frozenset(names.split()) for op, names in members.items()})


COMPAT: Final = Profile("compat", _ALL, StatusRule.AFTER_SET_LEVEL)
"""The default: everything that a shipping client sends."""

_EITHER_WAY: Final = frozenset({"png"})
"""The older texts have `png` as one of the ways to send any message; no shipping server takes it (PNG-09)."""

# `latch` and `queue_size` are in neither text and in both servers and every client of the time (ADV-06, X10).
ROS1: Final = Profile(
    "ros1",
    _ALL - _ACTION_OPS,
    StatusRule.FROM_THE_START,
    _without(advertise="qos", publish="type qos", subscribe="qos", call_service="type timeout"),
    _EITHER_WAY,
)
"""The text of the branch ros1."""

ROS2_2024: Final = Profile(
    "ros2-2024",
    _ALL - {"auth"},
    StatusRule.FROM_THE_START,
    _without(advertise="qos", publish="type qos", subscribe="qos", call_service="type timeout"),
    _EITHER_WAY,
)
"""The text of the branch ros2 in 2024."""

V2_0_0: Final = Profile(
    "2.0.0",
    _ALL - {"auth", "set_level", "status"},
    StatusRule.NEVER,
    _without(
        advertise="qos",
        publish="qos",
        subscribe="qos",
        call_service="type compression",
        send_action_goal="compression",
    ),
)
"""The text numbered 2.0.0, of 2026."""

PROFILES: Final[Mapping[str, Profile]] = MappingProxyType(
    {profile.name: profile for profile in (COMPAT, ROS1, ROS2_2024, V2_0_0)}
)
"""Every profile, by its name."""
