"""Options for quality of service, named as in the ``ros2`` tool."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from rwt.cli.verbs import Arguments, count_or_none

if TYPE_CHECKING:
    from rwt_protocol.ops import Qos

_POLICIES = {
    "reliability": ("reliable", "best_effort"),
    "durability": ("volatile", "transient_local"),
    "history": ("keep_last", "keep_all"),
}
_RELIABLE: Final = {"reliability": "reliable", "durability": "volatile", "history": "keep_last", "depth": 10}
_PROFILES: Final[Mapping[str, Mapping[str, Any]]] = {
    "default": _RELIABLE,
    "sensor_data": {**_RELIABLE, "reliability": "best_effort", "depth": 5},
    "services_default": _RELIABLE,
    "parameters": {**_RELIABLE, "depth": 1000},
    "parameter_events": {**_RELIABLE, "depth": 1000},
    "action_status_default": {**_RELIABLE, "durability": "transient_local", "depth": 1},
    "best_available": {**_RELIABLE, "reliability": "best_available", "durability": "best_available"},
    "system_default": {},
}
"""ROS 2's profiles by name (rmw/qos_profiles.h)."""


def add_qos_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--qos-…``, which only ROS 2 robots apply."""
    parser.add_argument(
        "--qos-profile",
        choices=_PROFILES,
        default="system_default",
        help="QoS profile (ROS 2); the following options override its policies",
    )
    for policy, words in _POLICIES.items():
        parser.add_argument(f"--qos-{policy}", choices=words, help=f"QoS {policy} (ROS 2)")
    parser.add_argument("--qos-depth", type=count_or_none, metavar="N", help="history depth with keep_last")


def qos_from(arguments: Arguments) -> Qos | None:
    """Return the QoS request of the options; None without any."""
    from rwt_protocol.ops import Qos  # slow import that `--help` does not need

    given = {policy: getattr(arguments, f"qos_{policy}") for policy in (*_POLICIES, "depth")}
    chosen = {policy: value for policy, value in given.items() if value is not None}
    asked = {**_PROFILES[arguments.qos_profile], **chosen}
    return Qos(**asked) if asked else None
