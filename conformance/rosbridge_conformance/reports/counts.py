"""Counts of verdicts; conformance and robustness count separately."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rosbridge_conformance.runner import VERDICTS, Result, Run

MARKS: Mapping[str, str] = {
    "pass": "✓", "non-strict": "~", "informational": "i", "unimplemented": "-", "fail": "✗"
}  # fmt: skip
"""Symbol of each verdict."""


@dataclass(frozen=True, slots=True)
class Row:
    """Verdicts of one section, or of all.

    Attributes:
        expected: number of failures that the target file expects.
    """

    name: str
    counts: Mapping[str, int]
    expected: int

    @property
    def asked(self) -> int:
        """Number of cases that were played and judged."""
        return sum(self.counts[verdict] for verdict in ("pass", "non-strict", "fail"))

    @property
    def passed(self) -> int:
        """Number of cases that passed, strictly or not."""
        return self.counts["pass"] + self.counts["non-strict"]

    @property
    def words(self) -> str:
        """Return text such as `41 pass, 2 fail`, without verdicts that did not occur."""
        return ", ".join(f"{self.counts[name]} {name}" for name in VERDICTS if self.counts[name])


def row(name: str, results: Iterable[Result]) -> Row:
    """Count the verdicts of some results."""
    kept = tuple(results)
    counts = Counter(str(result.verdict) for result in kept)
    failed = sum(1 for result in kept if result.verdict == "fail" and result.expected is not None)
    return Row(name, {name: counts[name] for name in VERDICTS}, failed)


def conformance(run: Run) -> Row:
    """Count all cases except those about robustness."""
    return row("conformance", (result for result in run.results if not result.robustness))


def robustness(run: Run) -> Row:
    """Count the HARDEN cases: known defects of other servers."""
    return row("robustness", (result for result in run.results if result.robustness))


def by_section(run: Run) -> tuple[Row, ...]:
    """Return the counts of each section, by name."""
    sections: dict[str, list[Result]] = {}
    for result in run.results:
        sections.setdefault(result.case.section, []).append(result)
    return tuple(row(name, results) for name, results in sorted(sections.items()))


def grade(run: Run) -> str:
    """Return the grade (docs/how-to/conformance.md): A to D, with `+` without failures in robustness.

    A: nothing failed. B: no MUST failed. C: at most a tenth of the MUST cases failed. D: more. None where
    no case was judged.
    Expected failures count: an expectation explains a failure and does not undo it.
    """
    if not row("", run.results).asked:
        return "none"
    failed = [result for result in run.results if result.verdict == "fail"]
    plain = [result for result in failed if not result.robustness]
    must = [result for result in plain if result.case.level == "MUST"]
    asked = [r for r in run.results if r.case.level == "MUST" and r.verdict != "unimplemented"]
    if not plain:
        return "A" if len(failed) > len(plain) else "A+"
    if not must:
        return "B"
    return "C" if len(must) * 10 <= len(asked) else "D"
