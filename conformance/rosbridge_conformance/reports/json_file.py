"""Complete run as JSON, for programs and for `diff`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TypedDict

from rosbridge_conformance import SUITE_VERSION
from rosbridge_conformance.reports.counts import grade
from rosbridge_conformance.runner import Result, Run
from rosbridge_conformance.suite.rules import Rule
from rosbridge_conformance.suite.values import Json

FORMAT = 1
"""Version of the file format."""


class ReportError(ValueError):
    """A results file cannot be read; the text names it and the reason."""


class Recorded(TypedDict):
    """Fields of a result that `diff` compares."""

    verdict: str
    level: str


def render(run: Run, rules: Mapping[str, Rule]) -> str:
    """Return all data of a run."""
    value: dict[str, Json] = {
        "format": FORMAT,
        "suite": SUITE_VERSION,
        "target": run.target.name,
        "url": run.url,
        "grade": grade(run),
        "ok": run.ok,
        "seconds": round(run.seconds, 3),
        "stale": list(run.stale),
        "results": [_result(result) for result in run.results],
    }
    return json.dumps(value, indent=1, ensure_ascii=False) + "\n"


def _result(result: Result) -> Json:
    case, fault = result.case, result.fault
    value: dict[str, Json] = {
        "id": case.id,
        "title": case.title,
        "rules": list(case.rules),
        "level": case.level,
        "profile": case.profile,
        "verdict": result.verdict,
        "seconds": round(result.seconds, 4),
        "again": result.again,
        "remarks": list(result.remarks),
        "missing": list(result.missing),
        "expected_failure": result.expected,
        "fault": None,
        "transcript": [[line.at, line.client, line.way, line.text] for line in result.transcript],
    }
    if fault is not None:
        different = fault.difference
        value["fault"] = {
            "step": fault.step,
            "doing": fault.doing,
            "at": different.path,
            "expected": different.expected,
            "got": different.got,
        }
    return value


def read_results(path: Path) -> dict[str, Recorded]:
    """Return verdict and level by case id.

    Raises:
        ReportError: the file is not such a report.
    """
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
        if value["format"] != FORMAT:
            raise ReportError(f"{path}: format {value['format']}, this program reads {FORMAT}")
        return {
            entry["id"]: Recorded(verdict=entry["verdict"], level=entry["level"])
            for entry in value["results"]
        }
    except OSError as error:
        raise ReportError(f"{path}: cannot be read: {error.strerror}") from error
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise ReportError(f"{path}: not a results file of this suite (--json)") from error
