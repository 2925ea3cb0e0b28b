"""Fuzz, guided by coverage: `python -m tests.fuzz [--seconds N] [TARGET …]`; needs the group `fuzz`.
`python -m tests.fuzz costs` looks for messages that cost much for their size, `gate-costs` for inputs that
cost other clients of a gate much, and `refusal-costs` for the dearest refusals of each gateway; all need
nothing.

Each target runs in a process of its own for its share of the time, starts from its kept inputs and is stopped
by the first exception, by more than 10 s for one input, or by more memory than its bound. What it finds worth
keeping goes to a scratch folder; `--keep` adds to the kept inputs what of it reaches a line that none of them
reaches. A new target needs a folder with a first input. Prints one line for each target.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tests.fuzz import gate_costs, refusal_costs
from tests.fuzz.costs import MOST_MEMORY, worst
from tests.fuzz.keeping import keep
from tests.fuzz.targets import CORPUS, TARGETS

MEMORY_MB = 400
"""Resident memory at which a run fails; the libraries take 70 MB of it."""
LONGEST_INPUT = 4096
SLOWEST_INPUT_SECONDS = 10
IMPORT_SECONDS = 600
"""Maximum time in which the libraries are imported and instrumented, on a busy machine."""

_STATISTIC = re.compile(r"stat::(\w+):\s+(\d+)")
_PROGRESS = re.compile(r"cov: (\d+)")


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of the run of one target."""

    executions: int
    covered: int
    memory_mb: int
    failed: bool
    log: str


def run(target: str, seconds: int, scratch: Path) -> Outcome:
    """Fuzz one target in a process of its own; that ends by itself, and is ended if it does not."""
    found = scratch / target
    found.mkdir()
    options = [f"-artifact_prefix={scratch}/{target}-", f"-rss_limit_mb={MEMORY_MB}", "-print_final_stats=1",
               f"-max_len={LONGEST_INPUT}", f"-timeout={SLOWEST_INPUT_SECONDS}"]  # fmt: skip
    command = [sys.executable, "-m", "tests.fuzz.one", target, *options, f"-max_total_time={seconds}"]
    try:
        done = subprocess.run(
            [*command, str(found), str(CORPUS / target)],
            capture_output=True, text=True, errors="replace", timeout=seconds + IMPORT_SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired as late:
        return Outcome(0, 0, 0, True, f"still running after {late.timeout:.0f} s")
    log = done.stderr
    statistics = {name: int(value) for name, value in _STATISTIC.findall(log)}
    covered = max((int(value) for value in _PROGRESS.findall(log)), default=0)
    return Outcome(
        statistics.get("number_of_executed_units", 0), covered, statistics.get("peak_rss_mb", 0),
        done.returncode != 0, log,
    )  # fmt: skip


def main() -> int:
    """Run the targets one after the other; 1 if any failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Fuzz, guided by coverage.")
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"some of {', '.join(TARGETS)}")
    parser.add_argument("--seconds", type=int, default=120, help="time for all targets together")
    parser.add_argument("--keep", action="store_true", help="add what was found to the kept inputs")
    parser.add_argument(
        "--random", type=int, default=1, metavar="N", help="seed of `costs`, `gate-costs` and `refusal-costs`"
    )
    arguments = parser.parse_args()
    if arguments.targets == ["costs"]:
        return _costs(arguments.random, arguments.seconds)
    if arguments.targets == ["gate-costs"]:
        return _gate_costs(arguments.random, arguments.seconds)
    if arguments.targets[:1] == ["refusal-costs"]:
        gateways = arguments.targets[1:] or list(refusal_costs.TARGETS)
        return _refusal_costs(gateways, arguments.random, arguments.seconds / len(gateways))
    chosen = arguments.targets or list(TARGETS)
    unknown = set(chosen) - TARGETS.keys()
    if unknown:
        parser.error(f"no target {', '.join(sorted(unknown))}; there are {', '.join(TARGETS)}")
    return _run_all(chosen, max(1, arguments.seconds // len(chosen)), keeping=arguments.keep)


def _costs(seed: int, seconds: int) -> int:
    """Look for the messages that cost the most for each of their bytes; 1 if one takes too much memory."""
    found = worst(seed, seconds)
    _say(f"{'encoding':8} {'ns for a byte':>14} {'bytes for a byte':>17}  where, and what is repeated there")
    for encoding in sorted(found):
        for each in found[encoding]:
            where = f"{each.case.place}: {each.case.value!r}"
            _say(f"{encoding:8} {each.nanoseconds:14,.0f} {each.memory:17,.0f}  {where}")
    return int(any(largest.memory > MOST_MEMORY for _, largest in found.values()))


def _gate_costs(seed: int, seconds: int) -> int:
    """Look for the inputs that cost other clients of a gate the most; 1 if one, or a stop, takes too long."""
    found, stop = gate_costs.worst(seed, seconds)
    for new, given in sorted(found.values(), key=lambda each: -each[0]):
        _say(f"{new * 1000:8.1f} ms  {given}")
    _say(f"{stop * 1000:8.1f} ms  the slowest stop")
    return int(
        max(new for new, _ in found.values()) > gate_costs.MOST_SECONDS or stop > gate_costs.STOP_SECONDS
    )


def _refusal_costs(gateways: list[str], seed: int, seconds: float) -> int:
    """Look for the dearest refusals of gateways; 1 if one takes too long."""
    failures = 0
    for name in gateways:
        found, count = refusal_costs.dearest(name, seed, seconds)
        _say(f"{name}: {count:,} messages, of which the dearest that are refused are")
        for each in found[:5]:
            _say(f"  {each}")
        failures += any(each.seconds > refusal_costs.TARGETS[name].most for each in found)
    return int(failures > 0)


def _run_all(chosen: list[str], share: int, *, keeping: bool) -> int:
    total, failures = 0, 0
    scratch = Path(tempfile.mkdtemp(prefix="fuzz-"))
    _say(f"{'target':14} {'executions':>12} {'covered':>8} {'MB':>5}")
    for name in chosen:
        outcome = run(name, share, scratch)
        total += outcome.executions
        failures += outcome.failed
        _say(f"{name:14} {outcome.executions:12,} {outcome.covered:8,} {outcome.memory_mb:5}")
        if keeping and not outcome.failed:
            _say(f"{'':14} {keep(name, scratch / name):12,} inputs kept")
        if outcome.failed:
            _say(f"FAILED; the input is in {scratch}/{name}-*\n{outcome.log[-3000:]}")
    _say(f"{'all':14} {total:12,}")
    return 1 if failures else 0


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
