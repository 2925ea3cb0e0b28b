"""What attacks do to a server: `python -m tests.faults.attacks [NAME …]`."""

from __future__ import annotations

import argparse
import sys

from tests.faults.attacks.attacked import attacked_server, suffer
from tests.faults.attacks.attacker import ATTACKS


def main() -> None:
    """Print a line for each attack, each on a server of its own."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults.attacks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="an attack; all by default")
    parser.add_argument("--distro", default="jazzy", choices=("jazzy", "noetic"))
    parser.add_argument("--role", default="admin", help="of everybody (default admin)")
    options = parser.parse_args()
    for name in options.names or ATTACKS:
        with attacked_server(options.distro, options.role) as server:
            damage = suffer(name, server)
        sys.stdout.write(
            f"{name:<24}{damage.waited * 1000:6.0f} ms {damage.grown:6.0f} MiB {damage.logged:8} bytes logged"
            f"   (undisturbed {damage.undisturbed * 1000:.0f} ms)\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
