"""Options for the quality of service, as the ``ros2`` tool names them."""

from __future__ import annotations

import argparse

from rwt_cli.verbs import Arguments, count_or_none

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


def qos_from(arguments: Arguments) -> dict[str, object] | None:
    """What the options ask for; None if nothing."""
    given = {policy: getattr(arguments, f"qos_{policy}") for policy in (*_POLICIES, "depth")}
    found: dict[str, object] = {policy: value for policy, value in given.items() if value is not None}
    return found or None
