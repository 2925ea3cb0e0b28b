"""Write docs/reference/client-grades.md from results of `rwt conformance client --json FILE`.

`make client-grades` grades the libraries and runs it: ``python tools/generate_client_grades.py FILE…``. The
tests compare the page with what the libraries do.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypedDict

TARGET = Path(__file__).parents[1] / "docs" / "reference" / "client-grades.md"

_HEAD = """\
# Client libraries, graded

This page is made by `make client-grades` with the
[conformance suite](../how-to/conformance.md#grade-a-client-library). The suite plays the server and looks
at what a library sends, and at what it gives to its user. The programs around the libraries are in
`conformance/rosbridge_conformance/adapters`; roslib runs on Node there, roslibpy with Twisted. `rwt_client`
is the client of this repository.

Cells say how many cases passed out of those asked; what a library does not offer is not asked. Robustness
counts the HARDEN cases: malformed frames, servers that misbehave, connections that are lost.
[What grades mean](../how-to/conformance.md#verdicts-and-grades)

[By version](matrix.md), with servers.
"""


_VARIANTS = ("tf-topics", "tf-service")
"""Two ways to ask for the same, of which a library has one."""


class Fault(TypedDict):
    """Expectation of a case, and what was received."""

    expected: str
    got: str


class Entry(TypedDict):
    """One result of a report."""

    id: str
    title: str
    level: str
    verdict: str
    remarks: list[str]
    missing: list[str]
    expected_failure: str | None
    fault: Fault | None


class Report(TypedDict):
    """One results file."""

    suite: str
    target: str
    grade: str
    results: list[Entry]


def page(reports: Sequence[Report]) -> str:
    """The whole page."""
    return "\n".join(_lines(reports)) + "\n"


def _lines(reports: Sequence[Report]) -> Iterator[str]:
    yield _HEAD
    yield f"Suite {reports[0]['suite']}, {max(len(report['results']) for report in reports)} cases.\n"
    yield f"| | {' | '.join(report['target'] for report in reports)} |"
    yield f"|---|{'--:|' * len(reports)}"
    yield f"| **grade** | {' | '.join(report['grade'] for report in reports)} |"
    columns = [column(report["results"]) for report in reports]
    for name in sorted({name for cells in columns for name in cells}, key=_order):
        yield f"| {name} | {' | '.join(cells.get(name, '-') for cells in columns)} |"
    for report in reports:
        yield from _library(report)


def _order(name: str) -> tuple[bool, str]:
    return not name.startswith("**"), name


def column(results: Sequence[Entry]) -> dict[str, str]:
    """The cells of one library: conformance, robustness, and each section."""
    rows: dict[str, list[Entry]] = {"**conformance**": [], "**robustness**": []}
    for entry in results:
        rows["**robustness**" if entry["level"] == "HARDEN" else "**conformance**"].append(entry)
        rows.setdefault(entry["id"].partition("/")[0], []).append(entry)
    return {name: _cell(entries) for name, entries in rows.items()}


def _cell(entries: Sequence[Entry]) -> str:
    asked = [entry for entry in entries if entry["verdict"] in ("pass", "non-strict", "fail")]
    passed = [entry for entry in asked if entry["verdict"] != "fail"]
    return f"{len(passed)}/{len(asked)}" if asked else "-"


def _library(report: Report) -> Iterator[str]:
    yield f"\n## {report['target']}\n"
    failed = [entry for entry in report["results"] if entry["verdict"] == "fail"]
    if failed:
        yield "| fails | level | |\n|---|---|---|"
    else:
        yield "Nothing failed."
    for entry in failed:
        yield f"| `{entry['id']}` | {entry['level']} | {_reason(entry)} |"
    lenient = [entry for entry in report["results"] if entry["verdict"] == "non-strict"]
    if lenient:
        yield "\nNot strictly right: " + ", ".join(
            f"`{entry['id']}` ({'; '.join(entry['remarks'])})" for entry in lenient
        )
    yield from _noted(report["results"])
    missing = _missing(report["results"])
    if missing:
        yield f"\nNot offered: {'; '.join(missing)}."


def _noted(results: Sequence[Entry]) -> Iterator[str]:
    """Return the findings of INFO cases, which are not failures."""
    noted = [entry for entry in results if entry["verdict"] == "informational" and entry["fault"]]
    if noted:
        yield "\nNot so, for information only: " + "; ".join(entry["title"] for entry in noted) + "."


def _reason(entry: Entry) -> str:
    fault = entry["fault"]
    why = entry["expected_failure"] or (f"expected {fault['expected']}, got {fault['got']}" if fault else "")
    return why.replace("|", "\\|")


def _missing(results: Sequence[Entry]) -> list[str]:
    """Return what the library lacks, without repetition: profiles first, then options and calls."""
    names = {name for entry in results for name in entry["missing"] if name not in _VARIANTS}
    profiles = sorted(name.removeprefix("profile ") for name in names if name.startswith("profile "))
    others = sorted(name for name in names if not name.startswith("profile ") and name not in profiles)
    return [*([f"the profiles {', '.join(profiles)}"] if profiles else []), *others]


def read(path: Path) -> Report:
    """One results file."""
    report: Report = json.loads(path.read_text(encoding="utf-8"))
    return report


if __name__ == "__main__":
    TARGET.write_text(page([read(Path(name)) for name in sys.argv[1:]]), encoding="utf-8")
