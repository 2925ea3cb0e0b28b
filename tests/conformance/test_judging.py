"""Verdicts, expectations, grades and comparisons, on made-up results."""

from __future__ import annotations

import asyncio
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from rosbridge_conformance.case_player import Fault, Line, Played
from rosbridge_conformance.command import main
from rosbridge_conformance.reports import expected, html, junit
from rosbridge_conformance.reports.counts import grade
from rosbridge_conformance.reports.json_file import ReportError, read_results, render
from rosbridge_conformance.reports.terminal import report
from rosbridge_conformance.runner import Conditions, Result, Run, Verdict, judge_cases, select
from rosbridge_conformance.suite.case import Case, Expect, ExpectNothing, Send, Wait
from rosbridge_conformance.suite.loading import CASES, CLIENT_CASES, load_cases, read_case
from rosbridge_conformance.suite.matching import Difference
from rosbridge_conformance.suite.rules import load_rules
from rosbridge_conformance.suite.stretch import AT_ONCE, MOST, factor, stretched
from rosbridge_conformance.suite.target import (
    Target,
    TargetError,
    check_ids,
    find_client_target,
    find_target,
    shipped,
    shipped_clients,
    with_known,
)
from rosbridge_conformance.suite.values import Json
from rosbridge_conformance.wire.pace import RealPace


def _case(name: str = "topics/thing", level: str = "MUST", **more: Json) -> Case:
    steps: Json = [{"expect": {"op": "x"}}]
    usual: dict[str, Json] = {"title": "T", "rules": ["PUB-01"], "profile": "CORE", "steps": steps}
    return read_case(name, {**usual, "level": level, **more})


_CASE = _case()
_FAULT = Fault(1, "a expects", Difference("op", "x", "y"))


def _result(
    verdict: Verdict, name: str = "topics/thing", level: str = "MUST", why: str | None = None
) -> Result:
    return Result(_case(name, level), verdict, _FAULT if verdict == "fail" else None, expected=why)


def _run(*results: Result, stale: tuple[str, ...] = ()) -> Run:
    return Run(Target(), "ws://x", results, stale, 1.0)


def test_a_run_is_ok_without_unexpected_failures_and_stale_expectations() -> None:
    assert _run(_result("pass"), _result("fail", why="known")).ok
    assert not _run(_result("fail")).ok
    assert not _run(_result("pass"), stale=("a/b",)).ok


@pytest.mark.parametrize(
    ("results", "mark"),
    [
        ([_result("pass")], "A+"),
        ([_result("pass"), _result("fail", level="HARDEN")], "A"),
        ([_result("pass"), _result("fail", level="SHOULD")], "B"),
        ([_result("fail"), *[_result("pass") for _ in range(9)]], "C"),
        ([_result("fail"), _result("pass")], "D"),
        ([_result("unimplemented"), _result("informational")], "none"),
    ],
)
def test_grades(results: list[Result], mark: str) -> None:
    assert grade(_run(*results)) == mark


def test_a_target_says_what_is_asked_and_what_is_missing() -> None:
    assert select([_CASE], Target(), ["PUB-*"]) == (_CASE,)
    assert select([_CASE], Target(), ["topics"]) == (_CASE,)
    assert not select([_CASE], Target(), ["SUB-*"])
    assert not select([_CASE], Target(), [], ["topics/*"])
    assert not select([replace(_CASE, ros=(1,))], Target(ros=2))
    wish = replace(_CASE, needs=("messages", "call-timeout"))
    assert Target().missing(wish, frozenset({"messages"})) == ("call-timeout",)
    assert Target(profiles=("PNG",)).missing(_CASE, frozenset()) == ("profile CORE",)


def test_what_failed_is_written_as_a_target_that_expects_it(tmp_path: Path) -> None:
    target = Target(
        name='a "quoted" server', ros=1, profiles=("CORE", "PNG"), settle=0.5, alone=("t/*",),
        unstable={"t/some*": "at times"},
    )  # fmt: skip
    known = _result("fail", "t/known", why="issue 12")
    sometimes = _result("fail", "t/sometimes", why="at times")
    run = replace(_run(_result("fail", "t/new"), known, sometimes, _result("pass", "t/well")), target=target)
    file = tmp_path / "mine.toml"
    file.write_text(expected.render(run, {}), encoding="utf-8")
    written = find_target(str(file))
    assert set(written.expected) == {"t/new", "t/known"}
    assert written.expected["t/known"] == "issue 12"
    assert written.expected["t/new"].startswith(f"{' '.join(_CASE.rules)}: ")
    assert replace(written, expected={}) == target


def test_reports_for_people_keep_the_frames_of_what_did_not_pass() -> None:
    failed, passed = (
        replace(_result(verdict, f"t/{verdict}"), transcript=(Line(0.1, "a", "<", f"came in {verdict}"),))
        for verdict in ("fail", "pass")
    )
    run = _run(failed, passed)
    for kind in (html, junit):
        text = kind.render(run, load_rules())
        assert "came in fail" in text
        assert "came in pass" not in text
    assert "came in pass" in render(run, {})


def test_two_runs_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, after = tmp_path / "before", tmp_path / "after"
    before.write_text(
        render(_run(_result("pass", "t/a"), _result("fail", "t/b"), _result("pass", "t/c")), {})
    )
    after.write_text(render(_run(_result("fail", "t/a"), _result("pass", "t/b"), _result("pass", "t/c")), {}))
    assert main(["diff", str(before), str(after)]) == 1
    assert (
        capsys.readouterr().out == "- t/a: pass -> fail\n+ t/b: fail -> pass\n1 better, 1 worse, 3 in both\n"
    )
    assert main(["diff", str(before), str(before)]) == 0


@pytest.mark.parametrize("text", ["", "{}", "[]", json.dumps({"format": 99}), '{"format": 1, "results": 5}'])
def test_files_that_are_no_results_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "x"
    path.write_text(text)
    with pytest.raises(ReportError, match="x: "):
        read_results(path)


# -- cases that measure time ---------------------------------------------------------------------------------


def test_all_times_of_a_case_are_stretched_alike() -> None:
    steps: list[Json] = [
        {"send": {"op": "subscribe", "topic": "/@/t", "throttle_rate": 200}},
        {"send": {"op": "publish", "topic": "/@/t", "msg": {"throttle_rate": "x"}}, "times": 3, "every": 0.1},
        {"wait": 0.25},
        {"expect_nothing": 0.5},
        {"expect": {"op": "publish"}, "within": 0.125},
        {"expect": {"op": "publish"}},
    ]
    case = _case("throttle/x", timed=True, steps=steps)
    subscribe, publish, wait, nothing, within, whenever = stretched(case, 2.0).steps
    assert isinstance(subscribe, Send)
    assert subscribe.body == {"op": "subscribe", "topic": "/@/t", "throttle_rate": 400}
    assert isinstance(publish, Send) and publish.every == 0.2
    assert publish.body == {"op": "publish", "topic": "/@/t", "msg": {"throttle_rate": "x"}}
    assert isinstance(wait, Wait) and wait.seconds == 0.5
    assert isinstance(nothing, ExpectNothing) and nothing.seconds == 1.0
    assert isinstance(within, Expect) and within.within == 0.25
    assert isinstance(whenever, Expect) and whenever.within is None
    assert stretched(case, 1.0) is case


@pytest.mark.parametrize(("slowest", "times"), [(0.0, 1.0), (AT_ONCE, 1.0), (3 * AT_ONCE, 3.0), (60.0, MOST)])
def test_times_grow_with_the_slowest_answer(slowest: float, times: float) -> None:
    assert factor(slowest) == pytest.approx(times)


# -- known failures in a file of their own -------------------------------------------------------------------


def test_known_failures_come_beside_those_of_the_target(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = tmp_path / "known.toml"
    known.write_text(
        'suite = "1.0.0"\n'
        '[expected_failures]\n"publish/*" = "known"\n'
        '[unstable]\n"subscribe/*" = "at times"\n'
    )
    target = Target(expected={"envelope/*": "of the target"})
    both = with_known(target, known, "1.7.0")
    assert both.expected == {**target.expected, "publish/*": "known"}
    assert both.unstable == {"subscribe/*": "at times"}
    assert main(["ws://127.0.0.1:9", "--expect", str(known), "--list", "--run", "publish/*"]) == 0
    assert "publish/" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('suite = "2.0.0"\n', "made with '2.0.0', and this is 1.0.0"),
        ("suite = 1\n", "made with 1, and this is 1.0.0"),
        ("ros = 1\n", "`ros`: unknown; known are suite, expected_failures and unstable"),
        ('[expected_failures]\n"a/b" = ""\n', "expected the reason as text"),
        ("suite = ", "not TOML"),
    ],
)
def test_known_failures_that_cannot_be_used(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = tmp_path / "known.toml"
    known.write_text(text)
    with pytest.raises(TargetError, match=re.escape(said)):
        with_known(Target(), known, "1.0.0")
    with pytest.raises(TargetError, match="cannot be read: No such file"):
        with_known(Target(), tmp_path / "none.toml", "1.0.0")
    assert main(["ws://127.0.0.1:9", "--expect", str(known)]) == 2
    assert said.split(", and this")[0] in capsys.readouterr().err


# -- which cases are played beside each other ----------------------------------------------------------------


class _Plays:
    """Notes which cases are under way at the same time; one of them fails where others are."""

    def __init__(self, fails_in_company: str = "") -> None:
        self.fails_in_company = fails_in_company
        self.under_way: set[str] = set()
        self.beside: dict[str, set[str]] = {}
        self.played: list[str] = []

    async def __call__(self, case: Case, tag: str) -> Played:
        self.under_way.add(case.id)
        self.played.append(case.id)
        for each in self.under_way:
            self.beside.setdefault(each, set()).update(self.under_way - {each})
        for _ in range(3):
            await asyncio.sleep(0)
        self.under_way.remove(case.id)
        if case.id == self.fails_in_company and self.beside.pop(case.id):
            return Played(_FAULT, (), (), 0.0)
        return Played(None, (), (), 0.0)


async def _judged(plays: _Plays, target: Target, *cases: Case) -> Run:
    return await judge_cases(cases, target, plays, "ws://x", Conditions(jobs=4), RealPace())


def test_cases_are_played_beside_those_that_they_may_be_played_beside() -> None:
    plays = _Plays()
    target = Target(alone=("hang/*",))
    cases = [_case(name) for name in ("hang/a", "hang/b", "free/a", "free/b")]
    timed = [_case(f"time/{letter}", timed=True) for letter in "abc"]
    run = asyncio.run(_judged(plays, target, *cases, *timed, _case("count/a", alone=True)))
    assert [each.case.id for each in run.results] == sorted(plays.played)
    assert plays.beside["hang/a"] == plays.beside["hang/b"] == plays.beside["count/a"] == set()
    assert plays.beside["time/a"] == {"time/b", "time/c"}
    assert plays.beside["free/a"] == {"free/b"}


def test_a_case_that_measures_time_is_played_alone_before_it_counts_as_failed() -> None:
    plays = _Plays("time/a")
    run = asyncio.run(_judged(plays, Target(), *(_case(f"time/{letter}", timed=True) for letter in "abc")))
    assert plays.played.count("time/a") == 2
    assert [each.verdict for each in run.results] == ["pass"] * 3


def test_what_fails_at_times_is_neither_news_nor_stale() -> None:
    target = Target(expected={"t/always": "known"}, unstable={"t/time*": "at times"})
    assert target.reason("t/timely") == "at times"

    async def passes(case: Case, tag: str) -> Played:
        return Played(None, (), (), 0.0)

    async def fails(case: Case, tag: str) -> Played:
        return Played(_FAULT, (), (), 0.0)

    cases = [_case("t/timely")]
    for play in (passes, fails):
        assert asyncio.run(judge_cases(cases, target, play, "ws://x", Conditions(), RealPace())).ok


def test_the_report_groups_failures_by_cause() -> None:
    def failed(name: str, got: str) -> Result:
        fault = Fault(2, "a expects", Difference("id", '"text"', got))
        return replace(_result("fail", name), fault=fault)

    cases = [failed("fragments/a", "7"), failed("fragments/b", "12"), failed("json/c", "null")]
    said = report(_run(*cases), load_rules())
    assert said.count("with the same cause") == 1
    assert '  2 cases at id: expected "text", got …\n    fragments/a, fragments/b\n' in said
    assert "frames of a failure: --verbose" in said
    assert "--verbose" not in report(_run(*cases), load_rules(), verbose=True)


@pytest.mark.parametrize("key", ["topics/nothing", "no/*"])
def test_an_expectation_of_no_case(tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str) -> None:
    known = tmp_path / "known.toml"
    known.write_text(f'[expected_failures]\n"{key}" = "a typing error"\n')
    assert main(["--expect", str(known), "--list"]) == 2
    assert f"no case has the id {key}" in capsys.readouterr().err


def test_the_ids_of_shipped_targets() -> None:
    for names, find, folder in (
        (shipped(), find_target, CASES),
        (shipped_clients(), find_client_target, CLIENT_CASES),
    ):
        ids = [case.id for case in load_cases(folder)]
        for name in names:
            check_ids(find(name), ids)
