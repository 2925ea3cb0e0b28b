"""Run as Markdown, for the summary page of a CI job."""

from __future__ import annotations

from collections.abc import Mapping

from rosbridge_conformance import SUITE_VERSION
from rosbridge_conformance.reports.counts import by_section, conformance, grade, robustness
from rosbridge_conformance.runner import VERDICTS, Run
from rosbridge_conformance.suite.rules import Rule


def render(run: Run, rules: Mapping[str, Rule]) -> str:
    """Return a table of sections and a table of failures."""
    lines = [
        f"## rosbridge conformance of {run.target.name}: grade {grade(run)}",
        "",
        f"Suite {SUITE_VERSION}, {len(run.results)} cases in {run.seconds:.1f} s.",
        "",
        f"| section | {' | '.join(VERDICTS)} |",
        f"|---|{'--:|' * len(VERDICTS)}",
    ]
    for row in (*by_section(run), conformance(run), robustness(run)):
        numbers = " | ".join(str(row.counts[name] or "") for name in VERDICTS)
        name = f"**{row.name}**" if row.name in ("conformance", "robustness") else row.name
        lines.append(f"| {name} | {numbers} |")
    failed = [result for result in run.results if result.verdict == "fail"]
    if failed:
        lines += ["", "| failed | rules | what came |", "|---|---|---|"]
    for result in failed:
        what = str(result.fault.difference) if result.fault else "; ".join(result.remarks)
        known = f"<br>expected: {_cell(result.expected)}" if result.expected else ""
        lines.append(f"| {result.case.id} | {' '.join(result.case.rules)} | {_cell(what)}{known} |")
    lines += [f"- stale expectation: `{key}`" for key in run.stale]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|").replace("\n", " ")
