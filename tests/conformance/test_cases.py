"""The cases are whole: each can be read, and every rule and example of the texts has one or a reason."""

from __future__ import annotations

import json
from typing import cast

import pytest

from rosbridge_conformance.suite.case import (
    LEVELS,
    PROFILES,
    SIDES,
    TEXTS,
    VIA,
    Case,
    Expect,
    ExpectAll,
    Send,
    Tell,
)
from rosbridge_conformance.suite.loading import CASES, CLIENT_CASES, OPTIONAL, REQUIRED, VERBS, load_cases
from rosbridge_conformance.suite.matching import Context, Match, match_frame
from rosbridge_conformance.suite.rules import load_rules
from rosbridge_conformance.suite.target import CLIENT_FEATURES, FEATURES, WIRE_FEATURES
from rosbridge_conformance.suite.values import Json, as_value
from rosbridge_conformance.wire.line_protocol import COMMANDS

_FOLDER = CASES.parent


@pytest.fixture(scope="module")
def cases() -> tuple[Case, ...]:
    return load_cases()


@pytest.fixture(scope="module")
def client_cases() -> tuple[Case, ...]:
    return load_cases(CLIENT_CASES)


def test_each_side_has_its_folder(cases: tuple[Case, ...], client_cases: tuple[Case, ...]) -> None:
    assert {case.side for case in cases} == {"server"}
    assert {case.side for case in client_cases} == {"client"}
    assert len(cases) >= 300 and len(client_cases) >= 200


def test_every_rule_has_a_client_case_or_a_reason_and_not_both(client_cases: tuple[Case, ...]) -> None:
    asked = {rule for case in client_cases for rule in case.rules}
    groups = json.loads((_FOLDER / "coverage.json").read_text())["without_client_case"]
    excused = [rule for group in groups for rule in group["rules"]]
    assert len(set(excused)) == len(excused)
    assert asked.isdisjoint(excused)
    assert asked | set(excused) == set(load_rules())
    assert all(len(group["why"]) > 20 for group in groups)


def test_client_cases_use_every_command_and_every_feature(client_cases: tuple[Case, ...]) -> None:
    told = [step.command for case in client_cases for step in case.steps if isinstance(step, Tell)]
    assert {command["do"] for command in told if isinstance(command, dict)} == set(COMMANDS)
    needed = {name for case in client_cases for name in case.needs}
    assert set(CLIENT_FEATURES) <= needed <= {*CLIENT_FEATURES, *PROFILES}


def test_every_rule_has_a_case_or_a_reason_and_not_both(cases: tuple[Case, ...]) -> None:
    rules = load_rules()
    asked = {rule for case in cases for rule in case.rules}
    assert asked <= set(rules)
    assert {key for key, rule in rules.items() if not rule.no_case} == asked
    reasons = json.loads((_FOLDER / "coverage.json").read_text())["without_case"]
    assert set(reasons) <= set(rules)
    assert all(len(why) > 20 for why in reasons.values())


def test_what_cases_need_can_be_declared_and_all_of_it_is_needed(cases: tuple[Case, ...]) -> None:
    needed = {name for case in cases for name in case.needs}
    assert needed <= {*FEATURES, *WIRE_FEATURES, *PROFILES}
    assert set(FEATURES) <= needed
    assert {case.profile for case in cases} == set(PROFILES)


def test_every_matcher_name_bound_is_used_or_checked_in_order(cases: tuple[Case, ...]) -> None:
    for case in cases:
        text = json.dumps([str(step) for step in case.steps])
        for used in {part.split("'")[0] for part in text.split("'$use': '")[1:]}:
            assert f"'$bind': '{used}'" in text, (case.id, used)


def _frames(case: Case) -> list[Json]:
    frames: list[Json] = []
    for step in case.steps:
        if isinstance(step, Send) and step.form == "json":
            frames.append(step.body)
        elif isinstance(step, Expect):
            frames += [step.frame, *(item.frame for item in step.tolerate)]
        elif isinstance(step, ExpectAll):
            frames += step.frames
    return frames


def test_every_example_of_the_texts_is_replayed(cases: tuple[Case, ...]) -> None:
    examples = json.loads((_FOLDER / "examples.json").read_text())
    named = {name: case for case in cases for name in case.example}
    assert set(named) == set(examples)


_NOT_AS_PRINTED = {
    # The op is made up; what the example shows is the id.
    "envelope-minimal", "envelope-id-string", "envelope-id-int",
    # Computed when it is sent, because its times are near now.
    "auth", "auth-bad-mac",
    # Shown as the defect that the case refuses.
    "fragment-total-float-as-sent-by-suites",
    # Comes in a picture, which the step names.
    "png-publish",
}  # fmt: skip


def test_examples_are_replayed_as_they_are_printed(cases: tuple[Case, ...]) -> None:
    examples = json.loads((_FOLDER / "examples.json").read_text())
    for case in cases:
        frames = [json.loads(json.dumps(frame).replace("/@/", "/")) for frame in _frames(case)]
        patterns = [_loosened(frame) for frame in frames]
        for name in set(case.example) - _NOT_AS_PRINTED:
            message = as_value(cast(Json, examples[name]["message"]))
            fits = [isinstance(match_frame(pattern, message, Context()), Match) for pattern in patterns]
            assert any(fits), (case.id, name)


def _loosened(frame: Json) -> Json:
    """A frame as a pattern that an example with literal ids fits; times and rosapi's names stay."""
    if isinstance(frame, list):
        return [_loosened(item) for item in frame]
    if not isinstance(frame, dict):
        return frame
    if "$use" in frame or "$bind" in frame or "$regex" in frame:
        return {"$any": "anything"}
    return {key: _loosened(item) for key, item in frame.items()}


def _schema() -> dict[str, dict[str, dict[str, object]]]:
    value: dict[str, dict[str, dict[str, object]]] = json.loads((_FOLDER / "case.schema.json").read_text())
    return value


def test_the_schema_has_the_keys_that_the_loader_knows() -> None:
    schema = _schema()
    assert set(schema["properties"]) == {*REQUIRED, *OPTIONAL}
    assert set(schema["required"]) == set(REQUIRED)
    assert schema["properties"]["level"]["enum"] == list(LEVELS)
    assert schema["properties"]["side"]["enum"] == list(SIDES)
    assert schema["properties"]["profile"]["enum"] == list(PROFILES)
    assert set(cast(dict[str, object], schema["properties"]["spec"]["properties"])) == set(TEXTS)


def test_the_schema_has_the_verbs_that_the_loader_knows() -> None:
    steps = cast(dict[str, list[dict[str, object]]], _schema()["properties"]["steps"]["items"])["oneOf"]
    verbs = {
        cast(list[str], step["required"])[0]: cast(dict[str, object], step["properties"]) for step in steps
    }
    assert {verb: tuple(keys)[1:] for verb, keys in verbs.items()} == dict(VERBS)
    via = cast(dict[str, dict[str, list[str]]], verbs["expect"]["via"])
    assert via["items"]["enum"] == list(VIA)
