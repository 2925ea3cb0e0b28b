"""Run as JUnit XML for CI systems, with the frames of every case that did not pass."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping

from rosbridge_conformance.reports.terminal import failure
from rosbridge_conformance.runner import Result, Run
from rosbridge_conformance.suite.rules import Rule


def render(run: Run, rules: Mapping[str, Rule]) -> str:
    """Return one test suite; expected failures and missing features are skipped, stale expectations fail."""
    failures = sum(1 for result in run.results if result.unexpected) + len(run.stale)
    skipped = sum(1 for result in run.results if _skipped(result))
    suite = ElementTree.Element(
        "testsuite",
        name=f"rosbridge conformance: {run.target.name}",
        tests=str(len(run.results) + len(run.stale)),
        failures=str(failures),
        skipped=str(skipped),
        errors="0",
        time=f"{run.seconds:.3f}",
    )
    for result in run.results:
        _add(suite, result, rules)
    for key in run.stale:
        case = ElementTree.SubElement(suite, "testcase", classname="expectations", name=key)
        ElementTree.SubElement(case, "failure", message="stale expectation: it no longer fails")
    ElementTree.indent(suite)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(suite, encoding="unicode") + "\n"


def _skipped(result: Result) -> bool:
    return result.verdict == "unimplemented" or (result.verdict == "fail" and result.expected is not None)


def _add(suite: ElementTree.Element, result: Result, rules: Mapping[str, Rule]) -> None:
    section, _, name = result.case.id.partition("/")
    case = ElementTree.SubElement(
        suite, "testcase", classname=f"rosbridge.{section}", name=name, time=f"{result.seconds:.3f}"
    )
    if result.unexpected:
        what = str(result.fault.difference) if result.fault else "; ".join(result.remarks)
        fault = ElementTree.SubElement(case, "failure", message=_clean(what))
        fault.text = _clean(failure(result, rules))
    elif _skipped(result):
        why = result.expected or f"not declared: {', '.join(result.missing)}"
        ElementTree.SubElement(case, "skipped", message=_clean(why))
    if result.transcript and result.verdict != "pass":
        lines = (f"{line.at:.3f} {line.client} {line.way} {line.text}" for line in result.transcript)
        ElementTree.SubElement(case, "system-out").text = _clean("\n".join(lines))


def _clean(text: str) -> str:
    """Return a text without characters that XML 1.0 does not allow."""
    return "".join(
        c if c in "\t\n" or (" " <= c < "\ud800") or ("\ue000" <= c <= "\ufffd") or c > "\uffff" else "�"
        for c in text
    )
