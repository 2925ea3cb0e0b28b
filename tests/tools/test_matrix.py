"""The page of grades is made of its results, and leaves nothing out that is listed."""

from __future__ import annotations

import json

import pytest

from rosbridge_conformance.suite.target import find_client_target, find_target
from tools.generate_matrix import PAGE, RESULTS, page, subjects, summary, title_of

RESULT = {
    "suite": "1.0.0",
    "grade": "B",
    "results": [
        {"id": "a/one", "level": "MUST", "verdict": "pass", "fault": None, "expected_failure": None},
        {"id": "a/two", "level": "SHOULD", "verdict": "non-strict", "fault": None, "expected_failure": None},
        {"id": "a/three", "level": "SHOULD", "verdict": "fail", "fault": {"expected": "1|2", "got": "<3>"},
         "expected_failure": None},
        {"id": "b/one", "level": "HARDEN", "verdict": "fail", "fault": None, "expected_failure": "throws"},
        {"id": "b/two", "level": "HARDEN", "verdict": "unimplemented", "fault": None,
         "expected_failure": None},
    ],
}  # fmt: skip


def test_the_page_is_that_of_the_results() -> None:
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert PAGE.read_text(encoding="utf-8") == page(subjects(), results), "run make matrix ARGS=--page"
    assert set(results) <= {title_of(each) for kind in ("servers", "clients") for each in subjects()[kind]}


@pytest.mark.parametrize("kind", ["servers", "clients"])
def test_what_needs_no_checkout_is_graded(kind: str) -> None:
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    wanted = {title_of(each) for each in subjects()[kind] if "needs" not in each}
    assert wanted - set(results) == set()


@pytest.mark.parametrize(("kind", "find"), [("servers", find_target), ("clients", find_client_target)])
def test_targets_are_there(kind: str, find: object) -> None:
    assert callable(find)
    for each in subjects()[kind]:
        assert find(each["target"])


def test_a_report_becomes_a_row_and_its_failures() -> None:
    found = summary(RESULT)
    assert (found["conformance"], found["robustness"]) == ([2, 3], [0, 1])
    table = {"servers": [{"name": "x", "version": "2"}], "clients": [], "absent": []}
    text = page(table, {"x, 2": found})
    assert "| x | 2 | - | - | **B** | 2/3 | 0/1 | 2 | 1.0.0 |" in text
    assert "| `a/three` | SHOULD | expected 1\\|2, got &lt;3> |" in text
    assert "| `b/one` | HARDEN | throws |" in text


def test_what_was_not_run_says_how() -> None:
    table = {"servers": [{"name": "x", "version": "2", "needs": "checkout"}], "clients": [], "absent": []}
    assert "not yet: `make matrix ARGS='--only rosbridge_suite --checkout …'`" in page(table, {})
