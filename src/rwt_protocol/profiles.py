"""Protocol versions as data: their ops and members, and when `status` is sent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Final

from rwt_protocol.ops import OPS, Direction


class StatusRule(Enum):
    """Condition for sending `status` to a client (X04)."""

    FROM_THE_START = "from the start"
    """At level `error` until the client sets another (STA-02)."""
    AFTER_SET_LEVEL = "after set_level"
    """Only after the client set a level: common clients log a traceback for each (STA-05)."""
    NEVER = "never"


@dataclass(frozen=True)
class Profile:
    """Version of the protocol.

    Attributes:
        without: members that it lacks, by op; ignored like all unknown members (ENV-01).
        both_ways: ops that servers accept too, although only servers send them in the other versions.
    """

    name: str
    ops: frozenset[str]
    status: StatusRule
    without: Mapping[str, frozenset[str]] = field(default_factory=lambda: MappingProxyType({}))
    both_ways: frozenset[str] = frozenset()

    def direction(self, op: str) -> Direction:
        """Return the sender of `op` in this version."""
        return Direction.BOTH if op in self.both_ways else OPS[op].direction

    def arriving(self, direction: Direction) -> frozenset[str]:
        """Return the names of the ops that arrive with messages of `direction`; all for `BOTH`."""
        if direction is Direction.BOTH:
            return self.ops
        return frozenset(op for op in self.ops if self.direction(op) in (direction, Direction.BOTH))

    # Dataclasses hash all fields, and mappings have no hash; names of profiles are unique.
    def __hash__(self) -> int:
        return hash(self.name)


_ACTION_OPS: Final = frozenset(name for name in OPS if "action" in name)
_ALL: Final = frozenset(OPS)


def _without(**members: str) -> Mapping[str, frozenset[str]]:
    return MappingProxyType({op: frozenset(names.split()) for op, names in members.items()})


COMPAT: Final = Profile("compat", _ALL, StatusRule.AFTER_SET_LEVEL)
"""Default profile: everything that released clients send."""

_EITHER_WAY: Final = frozenset({"png"})
"""Ops that the older texts allow in both directions; no released server accepts them (PNG-09)."""

_WITHOUT_OF_OLD_TEXTS: Final = _without(
    advertise="qos", publish="type qos", subscribe="qos", call_service="type timeout"
)
# `latch` and `queue_size` are in neither text, but in both servers and all clients of the time (ADV-06, X10).
ROS1: Final = Profile(
    "ros1",
    _ALL - _ACTION_OPS,
    StatusRule.FROM_THE_START,
    _WITHOUT_OF_OLD_TEXTS,
    _EITHER_WAY,
)
"""Protocol text of the branch ros1."""

ROS2_2024: Final = Profile(
    "ros2-2024",
    _ALL - {"auth"},
    StatusRule.FROM_THE_START,
    _WITHOUT_OF_OLD_TEXTS,
    _EITHER_WAY,
)
"""Protocol text of the branch ros2 in 2024."""

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
"""Protocol text numbered 2.0.0, of 2026."""

PROFILES: Final[Mapping[str, Profile]] = MappingProxyType(
    {profile.name: profile for profile in (COMPAT, ROS1, ROS2_2024, V2_0_0)}
)
"""All profiles by name."""
