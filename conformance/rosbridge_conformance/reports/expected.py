"""Target file from a run: its declarations, with each failure as an expected one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, replace

from rosbridge_conformance.runner import Result, Run
from rosbridge_conformance.suite.rules import Rule


def render(run: Run, rules: Mapping[str, Rule]) -> str:
    """TOML that `--target` reads. Reasons that the run's own target gives are kept; the others name the rules
    and what came instead."""
    declared = {each.name: getattr(run.target, each.name) for each in fields(run.target)}
    declared.pop("expected")
    unstable = declared.pop("unstable")
    lines = [f"{key} = {_value(value)}" for key, value in declared.items() if value is not None]
    at_times = replace(run.target, expected={})
    lines += ["", "[expected_failures]"]
    for each in sorted(run.results, key=lambda each: each.case.id):
        if each.verdict == "fail" and at_times.reason(each.case.id) is None:
            lines.append(f"{_value(each.case.id)} = {_value(each.expected or _reason(each))}")
    if unstable:
        lines += ["", "[unstable]", *(f"{_value(key)} = {_value(why)}" for key, why in unstable.items())]
    return "\n".join(lines) + "\n"


def _reason(failed: Result) -> str:
    what = str(failed.fault.difference) if failed.fault else "; ".join(failed.remarks)
    return f"{' '.join(failed.case.rules)}: {' '.join(what.split())}"


def _value(value: object) -> str:
    # JSON of strings, numbers and lists of strings is TOML, except for one character that TOML escapes.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
