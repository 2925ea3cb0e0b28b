"""`python -m bench.client`: this client beside roslibpy, in turns on this machine, against one server.

The server (`bench.client.peer`) only sends or only counts, so that what is measured is the client. Each
measurement is a process of its own; the ratio is taken within a round, so that what slows the machine down
for a while slows both.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

from bench.traffic.processes import Server


@dataclass(frozen=True, slots=True)
class Case:
    """Case of the benchmark.

    Attributes:
        what: ``receive`` or ``publish``.
        message: the kind of message.
        ours, theirs: how many messages.
        floor: how many times as fast as roslibpy this client must be.
    """

    what: str
    message: str
    ours: int
    theirs: int
    floor: float

    @property
    def label(self) -> str:
        """For people."""
        shown = "640x480 Image as numpy" if self.message == "Image" else self.message
        return f"{self.what} {shown}"


CASES = (
    Case("receive", "String", 200_000, 30_000, 5.0),
    Case("receive", "Odometry", 100_000, 20_000, 5.0),
    Case("receive", "Image", 1_500, 60, 20.0),
    Case("publish", "String", 60_000, 10_000, 5.0),
    Case("publish", "Twist", 60_000, 10_000, 5.0),
    Case("publish", "Odometry", 30_000, 5_000, 5.0),
)


@dataclass(frozen=True, slots=True)
class Rate:
    """Messages a second: by the clock, and of CPU time, which other programs disturb less."""

    wall: float
    cpu: float


@dataclass(frozen=True, slots=True)
class Row:
    """Medians over the rounds, in messages a second, and the medians of the ratios."""

    label: str
    ours: float
    roslibpy: float
    ratio: float
    cpu_ratio: float
    floor: float


def rate(library: str, case: Case, url: str, scale: float) -> Rate:
    """Measure the rate of one library, once."""
    count = max(10, int((case.ours if library == "ours" else case.theirs) * scale))
    path = f"receive/{case.message}/{count}" if case.what == "receive" else f"publish/{count}"
    command = [
        sys.executable,
        "-m",
        "bench.client.library",
        library,
        case.what,
        f"{url}/{path}",
        case.message,
    ]
    done = subprocess.run([*command, str(count)], capture_output=True, text=True, check=False)
    try:
        wall, cpu = map(float, done.stdout.split())
        return Rate(count / wall, count / cpu)
    except (ValueError, ZeroDivisionError):
        raise SystemExit(f"bench: {library} {case.label}: no result\n{done.stderr[-2000:]}") from None


def measure(case: Case, url: str, rounds: int, scale: float) -> Row:
    """Both libraries in turns."""
    pairs = [(rate("ours", case, url, scale), rate("roslibpy", case, url, scale)) for _ in range(rounds)]
    return Row(
        case.label,
        median(ours.wall for ours, _ in pairs),
        median(theirs.wall for _, theirs in pairs),
        median(ours.wall / theirs.wall for ours, theirs in pairs),
        median(ours.cpu / theirs.cpu for ours, theirs in pairs),
        case.floor,
    )


def table(rows: Sequence[Row]) -> str:
    """The rows for a terminal and for Markdown."""
    lines = [
        "| | this client | roslibpy | ratio | per CPU second | floor |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    lines += [
        f"| {row.label} | {row.ours:,.0f}/s | {row.roslibpy:,.0f}/s "
        f"| {row.ratio:.1f} x | {row.cpu_ratio:.1f} x | {row.floor:.0f} x |"
        for row in rows
    ]
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.client", description=__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="turns of each client (default 5)")
    parser.add_argument("--quick", action="store_true", help="two rounds of a quarter of the messages")
    parser.add_argument("--only", metavar="TEXT", default="", help="only the cases whose name contains TEXT")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the rows to FILE")
    parser.add_argument("--check", action="store_true", help="exit with 1 when a floor is missed")
    options = parser.parse_args(argv)
    rounds, scale = (2, 0.25) if options.quick else (options.rounds, 1.0)
    server = Server("the other side", ["-m", "bench.client.peer"])
    try:
        url = f"ws://{server.host}:{server.port}"
        cases = [case for case in CASES if options.only in case.label]
        rows = [measure(case, url, rounds, scale) for case in cases]
    finally:
        server.stop()
    print(table(rows))
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=2) + "\n", encoding="utf-8")
    return int(options.check and any(row.ratio < row.floor for row in rows))


if __name__ == "__main__":
    sys.exit(main())
