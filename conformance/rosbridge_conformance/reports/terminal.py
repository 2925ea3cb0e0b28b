"""Run as text, while it is in progress and at its end."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final, TextIO

from rosbridge_conformance.case_player import describe
from rosbridge_conformance.reports.counts import MARKS, Row, by_section, conformance, grade, robustness
from rosbridge_conformance.runner import Result, Run
from rosbridge_conformance.suite.case import Case
from rosbridge_conformance.suite.rules import Rule
from rosbridge_conformance.suite.target import Target

_NAMES: Final = re.compile(r"/?c[0-9a-f]+_\d+[\w/]*|\d+")
"""Names that are unique to a case, and numbers."""


class Progress:
    """Progress of a run: prints failures once they are final, and a counter on terminals."""

    def __init__(self, out: TextIO, total: int, rules: Mapping[str, Rule]) -> None:
        self._out = out
        self._total = total
        self._rules = rules
        self._done = 0
        self._live = out.isatty()

    def __call__(self, result: Result) -> None:
        """Add a result."""
        self._done += 1
        if result.unexpected:
            self._clear()
            self._out.write(failure(result, self._rules))
        if self._live:
            self._out.write(f"\r{self._done}/{self._total} {result.case.id[:60]:60}")
            self._out.flush()

    def end(self) -> None:
        """Erase the counter."""
        self._clear()

    def _clear(self) -> None:
        if self._live:
            self._out.write("\r" + " " * 72 + "\r")


def failure(result: Result, rules: Mapping[str, Rule]) -> str:
    """Return four lines about a failure and the rule that was violated."""
    case, fault = result.case, result.fault
    lines = [f"{MARKS[result.verdict]} {case.id}  {case.title}"]
    lines += [f"    rule {rule} ({case.level}): {rules[rule].text[:160]}" for rule in case.rules]
    if fault is not None:
        lines.append(f"    step {fault.step}: {fault.doing}")
        lines.append(f"    {fault.difference}")
    else:
        lines += [f"    not strict: {remark}" for remark in result.remarks]
    return "\n".join(lines) + "\n"


def report(run: Run, rules: Mapping[str, Rule], *, verbose: bool = False) -> str:
    """Return the summary: counts by section, expected and stale failures, and the grade."""
    lines = [f"{run.target.name} at {run.url}: {len(run.results)} cases in {run.seconds:.1f} s", ""]
    lines += [_line(row) for row in by_section(run)]
    lines += ["", _line(conformance(run)), _line(robustness(run))]
    text = "\n".join(lines) + "\n"
    expected = [result for result in run.results if result.verdict == "fail" and result.expected]
    if expected:
        text += "\nexpected failures:\n" + "".join(f"  {r.case.id}: {r.expected}\n" for r in expected)
    if run.stale:
        text += "\nstale expectations, which no longer fail; take them out of the target file:\n"
        text += "".join(f"  {key}\n" for key in run.stale)
    late = [result.case.id for result in run.results if result.again]
    if late:
        text += "\nright only when asked again, alone and with more time:\n" + "".join(
            f"  {name}\n" for name in late
        )
    unexpected = [result for result in run.results if result.unexpected]
    text += _by_cause(unexpected)
    if unexpected and not verbose:
        text += "\nframes of a failure: --verbose, best with --run ID; of all failures: --html FILE\n"
    if verbose and unexpected:
        text += "\n" + "".join(failure(result, rules) + _frames(result) for result in unexpected)
    verdict = "ok" if run.ok else f"{len(unexpected)} failed unexpectedly, {len(run.stale)} stale"
    if grade(run) == "none":
        verdict = "no case was judged: the target does not claim what was selected (--target, --profile)"
    return f"{text}\ngrade {grade(run)}, {verdict}\n"


def _line(row: Row) -> str:
    known = f" ({row.expected} expected)" if row.expected else ""
    return f"  {row.name:14} {row.words or 'nothing asked'}{known}"


def _by_cause(failed: Sequence[Result]) -> str:
    """Return the failures that several cases have in common, most frequent first."""
    causes: dict[str, list[str]] = {}
    for result in failed:
        cause = str(result.fault.difference) if result.fault else "; ".join(result.remarks)
        # Names and ids differ from case to case.
        causes.setdefault(_NAMES.sub("…", cause), []).append(result.case.id)
    lines = [
        f"  {len(ids)} cases {cause}\n    {', '.join(ids)}\n"
        for cause, ids in sorted(causes.items(), key=lambda each: -len(each[1]))
        if len(ids) > 1
    ]
    return "\nfailures with the same cause:\n" + "".join(lines) if lines else ""


def _frames(result: Result) -> str:
    return "".join(
        f"      {line.at:8.3f} {line.client} {line.way} {line.text}\n" for line in result.transcript
    )


def listing(cases: Sequence[Case], target: Target, *, steps: bool) -> str:
    """Return the selected cases, with their steps if requested."""
    text = ""
    for case in cases:
        text += f"{case.id}  {case.level} {case.profile} {' '.join(case.rules)}  {case.title}\n"
        if steps:
            missing = target.missing(case, frozenset({"messages", "stream", "several-clients"}))
            text += f"    not asked: lacks {', '.join(missing)}\n" if missing else ""
            text += "".join(f"    {number}. {describe(step)}\n" for number, step in enumerate(case.steps, 1))
    return f"{text}{len(cases)} cases\n"
