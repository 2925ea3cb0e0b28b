"""Compare this rclpy with the real one, or with what the real one printed when it was recorded."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from differential.comparison import REAL, compare_ours, play_real, read_recorded, record


def main() -> int:
    """Run the comparison; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m differential", description=__doc__)
    parser.add_argument("--distro", choices=("jazzy", "kilted"), action="append", help="both by default")
    parser.add_argument("--real", type=Path, metavar="DIR", help="environment with the real rclpy's wheels")
    parser.add_argument("--record", action="store_true", help="keep the real one's output")
    parser.add_argument("--accept", metavar="REASON", help="write a reviewed difference for each one found")
    parser.add_argument("--quiet", action="store_true", help="print the names alone")
    parser.add_argument("names", nargs="*", help="areas or programs; all by default")
    options = parser.parse_args()
    failed = 0
    for distro in options.distro or REAL:
        if options.real:
            real = play_real(options.real, distro, options.names)
            if options.record:
                record(distro, options.real, real)
        else:
            real = read_recorded(distro, options.names)
        result = compare_ours(distro, real, options.names)
        for difference in result.unreviewed:
            print(difference.name if options.quiet else difference.text())
            if options.accept:
                difference.accept(options.accept)
        print(result.summary())
        failed += not result.ok
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
