"""Options for the quality of service, as the ``ros2`` tool names them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rwt_cli.verbs import Arguments, count_or_none

if TYPE_CHECKING:
    from rwt_protocol.ops import Qos

_POLICIES = {
    "reliability": ("reliable", "best_effort"),
    "durability": ("volatile", "transient_local"),
    "history": ("keep_last", "keep_all"),
}


def add_qos_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--qos-…``, which robots of ROS 2 heed."""
    for policy, words in _POLICIES.items():
        parser.add_argument(f"--qos-{policy}", choices=words, help=f"quality of service (ROS 2): {policy}")
    parser.add_argument("--qos-depth", type=count_or_none, metavar="N", help="messages kept with keep_last")


def qos_from(arguments: Arguments) -> Qos | None:
    """What the options ask for; None if nothing."""
    from rwt_protocol.ops import Qos  # takes a while, and `--help` needs none of it

    given = {policy: getattr(arguments, f"qos_{policy}") for policy in (*_POLICIES, "depth")}
    return Qos(**given) if any(value is not None for value in given.values()) else None
