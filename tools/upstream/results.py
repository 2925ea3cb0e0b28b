"""Results of a suite's tests, compared with the expected ones."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Literal

Outcome = Literal["passed", "failed", "skipped"]

_GO_LINE = re.compile(r"\s*--- (PASS|FAIL|SKIP): (\S+)")
_GO_OUTCOMES: dict[str, Outcome] = {"PASS": "passed", "FAIL": "failed", "SKIP": "skipped"}


@dataclass(frozen=True, slots=True)
class Result:
    """One test.

    Attributes:
        id: its name, with that of the file or class it is in.
        outcome: what it came to.
        text: the first line of what it says of a failure.
    """

    id: str
    outcome: Outcome
    text: str = ""


def of_junit(files: Iterable[Path]) -> Iterator[Result]:
    """The tests of reports in the form of JUnit, which pytest, vitest, googletest and surefire write."""
    for file in files:
        for case in ElementTree.parse(file).iter("testcase"):
            problem = next((each for each in case if each.tag in ("failure", "error")), None)
            is_skipped = case.find("skipped") is not None or case.get("status") == "notrun"
            outcome: Outcome = "failed" if problem is not None else "skipped" if is_skipped else "passed"
            text = "" if problem is None else (problem.get("message") or problem.text or "").strip()
            yield Result(
                f"{case.get('classname', '')}::{case.get('name', '')}", outcome, text.partition("\n")[0]
            )


def of_go(output: str) -> Iterator[Result]:
    """The tests in the output of `go test -v`."""
    for line in output.splitlines():
        found = _GO_LINE.match(line)
        if found is not None:
            yield Result(found[2], _GO_OUTCOMES[found[1]])


@dataclass(frozen=True, slots=True)
class Verdict:
    """A run, held against the list of failures that are expected.

    Attributes:
        passed, skipped: how many tests did.
        apart: tests that are not counted, each with the reason.
        expected: failures that are expected, each with its reason.
        unexpected: failures that are not.
        stale: entries of the list whose tests, if there are any, did not fail.
    """

    passed: int
    skipped: int
    apart: tuple[tuple[Result, str], ...]
    expected: tuple[tuple[Result, str], ...]
    unexpected: tuple[Result, ...]
    stale: tuple[str, ...]

    @property
    def is_as_expected(self) -> bool:
        """True if there were tests, and nothing differs from the list."""
        ran = self.passed + len(self.expected) + len(self.unexpected)
        return ran > 0 and not self.unexpected and not self.stale


def judge(
    results: Iterable[Result], expected_failures: Mapping[str, str], apart: Mapping[str, str] | None = None
) -> Verdict:
    """Hold results against the list of expected failures: globs of ids, each with a reason.

    Args:
        results: what the tests came to.
        expected_failures: those that are expected to fail.
        apart: those that cannot pass here by what they are, and are not counted; globs of ids.
    """
    counted, aside = [], []
    for result in results:
        reason = _entry(apart or {}, result)
        if reason is None:
            counted.append(result)
        else:
            aside.append((result, (apart or {})[reason]))
    found = tuple(counted)
    expected, unexpected, used = [], [], set()
    for result in found:
        if result.outcome != "failed":
            continue
        glob = _entry(expected_failures, result)
        if glob is None:
            unexpected.append(result)
        else:
            used.add(glob)
            expected.append((result, expected_failures[glob]))
    return Verdict(
        passed=sum(result.outcome == "passed" for result in found),
        skipped=sum(result.outcome == "skipped" for result in found),
        apart=tuple(aside),
        expected=tuple(expected),
        unexpected=tuple(unexpected),
        stale=tuple(glob for glob in expected_failures if glob not in used),
    )


def _entry(globs: Iterable[str], result: Result) -> str | None:
    """The first glob that a test's id fits, or None."""
    return next((each for each in globs if fnmatchcase(result.id, each)), None)
