"""Differences between two runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rosbridge_conformance.reports.json_file import Recorded, read_results

_ORDER = ("fail", "unimplemented", "informational", "non-strict", "pass")


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of two runs.

    Attributes:
        worse: ids whose verdict got worse, or which passed before and are missing now.
    """

    better: tuple[str, ...]
    worse: tuple[str, ...]
    text: str


def compare_files(before: Path, after: Path) -> Comparison:
    """Compare two files written by `--json`."""
    return compare(read_results(before), read_results(after))


def compare(before: dict[str, Recorded], after: dict[str, Recorded]) -> Comparison:
    """Compare verdicts case by case."""
    better: list[str] = []
    worse: list[str] = []
    lines: list[str] = []
    for key in sorted({*before, *after}):
        old = before[key]["verdict"] if key in before else "not asked"
        new = after[key]["verdict"] if key in after else "not asked"
        if old == new:
            continue
        if "not asked" in (old, new) and "pass" not in (old, new):
            continue
        rank = _rank(new) - _rank(old)
        (better if rank > 0 else worse).append(key)
        lines.append(f"{'+' if rank > 0 else '-'} {key}: {old} -> {new}\n")
    lines.append(f"{len(better)} better, {len(worse)} worse, {len({*before} & {*after})} in both\n")
    return Comparison(tuple(better), tuple(worse), "".join(lines))


def _rank(verdict: str) -> int:
    return _ORDER.index(verdict) if verdict in _ORDER else 1
