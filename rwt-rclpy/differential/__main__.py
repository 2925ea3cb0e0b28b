"""Compare this rclpy with the real one, or with what the real one printed when it was recorded."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from differential import generated
from differential.comparison import REAL, compare_ours, our_rclpy, read_recorded, real_rclpy, record


def main() -> int:
    """Run the comparison; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m differential", description=__doc__)
    parser.add_argument("--distro", choices=REAL, action="append", help="both by default")
    parser.add_argument("--real", type=Path, metavar="DIR", help="environment with the real rclpy's wheels")
    parser.add_argument("--record", action="store_true", help="keep the real one's output")
    parser.add_argument("--accept", metavar="REASON", help="write a reviewed difference for each one found")
    parser.add_argument("--quiet", action="store_true", help="print the names alone")
    parser.add_argument(
        "--cases",
        type=int,
        default=200,
        metavar="N",
        help="generated cases of each kind, 0 for none; default %(default)s",
    )
    parser.add_argument("names", nargs="*", help="areas or programs; by default all, and generated cases")
    options = parser.parse_args()
    failed = 0
    for distro in options.distro or REAL:
        if options.real:
            rclpy, recorded = real_rclpy(options.real, distro), read_recorded(distro)
            real = rclpy.play(options.names, 2)
            if changed := [name for name, text in real.items() if recorded.get(name) != text]:
                real.update(rclpy.play(changed, 1))  # Alone, without delays by others.
            if options.record:
                record(distro, options.real, real)
        else:
            real = read_recorded(distro, options.names)
        result = compare_ours(distro, real, options.names)
        for difference in result.unreviewed:
            print(difference.name if options.quiet else difference.text())
            if options.accept:
                difference.accept(options.accept)
        print(result.table(), result.summary(), result.kinds(), sep="\n")
        failed += not result.ok
        if options.cases and not options.names:
            failed += not _compare_cases(distro, options.real, options.cases, record=options.record)
    return 1 if failed else 0


def _compare_cases(distro: str, place: Path | None, number: int, *, record: bool) -> bool:
    """Compare generated cases, or recorded ones without a real rclpy; returns True if all are the same."""
    if place is None:
        found = generated.differences_from_recorded(our_rclpy(distro))
    else:
        real = real_rclpy(place, distro)
        if record:
            generated.record_generated(real)
        found = generated.compare_generated(real, our_rclpy(distro), number)
    for difference in found:
        print(difference)
    print(f"{distro}: {len(found)} generated cases with other answers")
    return not found


if __name__ == "__main__":
    sys.exit(main())
