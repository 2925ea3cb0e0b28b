"""Effects of attacks on a server: `python -m tests.faults.attacks [NAME …]`."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import ExitStack

from tests.faults.attacks.attacked import (
    OF_ROS_1,
    PEERS,
    WEBRTC,
    Damage,
    attacked_server,
    suffer,
    suffer_at_once,
)
from tests.faults.attacks.attacker import ATTACKS


def described(name: str) -> str:
    """Attack, run against a server."""
    what = " ".join((ATTACKS[name].__doc__ or name).split()).removesuffix(".")
    return what if what[:2].isalpha() and what[:2].isupper() else what[0].lower() + what[1:]


def row(name: str, damage: Damage) -> str:
    """Return an attack and its effects as a row of a table in Markdown."""
    held, ran = round(damage.held * 1000), round(damage.ran * 1000)
    return f"| {described(name)} | {held} | {ran} | {max(0, round(damage.grown))} |"


def main() -> None:
    """Print a line for each attack."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults.attacks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="an attack; all by default")
    parser.add_argument("--distro", default="jazzy", choices=("jazzy", "noetic"))
    parser.add_argument("--role", default="admin", help="of everybody (default admin)")
    parser.add_argument("--apart", action="store_true", help="each on a server of its own")
    parser.add_argument(
        "--trace", type=float, metavar="MS", help="print where the event loop is once it is held for so long"
    )
    parser.add_argument(
        "--at-once", action="store_true", help="all at the same time, with those of WebRTC peers"
    )
    parser.add_argument(
        "--rows", action="store_true", help="print rows of the table in docs/explanation/robustness.md"
    )
    options = parser.parse_args()
    if options.trace:
        os.environ["HOLDS_TO_TRACE"] = str(options.trace / 1000)
    if options.at_once:
        names = options.names or [each for each in ATTACKS if each not in OF_ROS_1]
        with attacked_server(options.distro, options.role, WEBRTC) as attacked:
            damage, refused, failed = suffer_at_once(names, PEERS, attacked)
            count = len(names) + len(PEERS)
            ends = f"{refused} ended by limits.connections, {len(failed)} not to their ends"
            sys.stdout.write(f"{count} attacks at once, {ends}: {damage}\n")
            sys.stdout.writelines(f"  {each}\n" for each in failed)
            if options.trace:
                sys.stdout.write(attacked.log.read_text())
        return
    with ExitStack() as stack:
        server = None
        for name in options.names or ATTACKS:
            if server is None or options.apart:
                stack.close()
                server = stack.enter_context(attacked_server(options.distro, options.role))
            damage = suffer(name, server)
            sys.stdout.write(f"{row(name, damage)}\n" if options.rows else f"{name:<24} {damage}\n")
            sys.stdout.flush()
            if options.trace:
                sys.stdout.write(server.log.read_text())


if __name__ == "__main__":
    main()
