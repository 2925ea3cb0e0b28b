"""Limits of values: refused or brought within, with the field and the rule in the text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest

from rwt import Settings, SettingsError
from rwt.access.errors import GateRefused
from rwt.access.gate.fields import Clamped, FieldChecks
from rwt.access.gate.rules import Rule
from rwt.access.settings import GateRule
from rwt_interfaces.payload import Payload
from tests.core.access.gated_robot import CLIENT, FIBONACCI, TWIST, GatedRobot, drive, errors
from tests.core.rosbridge.recording_client import Client


def _robot(**limit: Any) -> GatedRobot:
    """A robot with limits of its speed."""
    return GatedRobot({"drive": {"topics": ["/cmd_vel"], "fields": {"linear.x": limit}}})


def _say(client: Client, topic: str, msg: Mapping[str, Any], type: str | None = None) -> str:
    """Publish; returns the error that the client is told, empty if none."""
    client.say("publish", topic=topic, msg=msg, **({"type": type} if type else {}))
    return errors(client)


def test_a_number_beyond_its_range_is_refused_or_brought_within() -> None:
    robot = _robot(min=-0.2, max=0.5)
    client = robot.client()
    assert "linear.x: expected -0.2 to 0.5, got 0.51 (gate.rules.drive.fields)" in drive(client, 0.51)
    assert drive(client, 0.5) == ""
    assert robot.take() == [(0.5, CLIENT)]
    robot = _robot(min=-0.2, max=0.5, beyond="clamp")
    client = robot.client()
    for asked, told in ((2.0, 0.5), (-2.0, -0.2), (0.3, 0.3)):
        assert drive(client, asked, y=0.25) == ""
        assert robot.take() == [(told, CLIENT)]
        value: Any = robot.samples[-1].payload.value()
        assert (value.linear.x, value.linear.y) == (told, 0.25), "other fields stay as they are"


def test_null_in_json_is_nan_and_never_passes() -> None:
    robot = GatedRobot({"drive": {"topics": ["/cmd_vel"]}})
    client = robot.client()
    zeros = {"x": 0.0, "y": 0.0, "z": 0.0}
    # Complete and compact, so that the text itself would be passed on.
    refused = _say(client, "/cmd_vel", {"linear": zeros | {"x": None}, "angular": zeros}, TWIST)
    assert "linear.x: expected a finite number (gate.rules.drive.finite)" in refused
    assert robot.take() == []
    assert _say(client, "/cmd_vel", {"linear": zeros, "angular": zeros}) == ""
    assert robot.take() == [(0.0, CLIENT)]


def test_nan_in_lists_is_found_by_its_place() -> None:
    type = GatedRobot({}).graph.registry.message("trajectory_msgs/JointTrajectory")
    checks = FieldChecks(Rule("arm", GateRule(topics=("*",))), type)
    # Their sum is infinite, and none of them is.
    points = [{"positions": [0.0, 1e308, 1e308]}, {"positions": [0.0, math.nan]}]
    with pytest.raises(GateRefused, match=r"points\[1\]\.positions\[1\]: expected a finite number"):
        checks.check(Payload.from_value(type, {"points": points}), 0.0)
    fine = Payload.from_value(type, {"points": points[:1]})
    assert checks.check(fine, 0.0) == (fine, ())


def test_a_rate_holds_away_from_standing_and_never_for_braking() -> None:
    robot = _robot(rate=1.0, beyond="clamp")
    client = robot.client()
    told = []
    for asked in (1.0, 1.0, 1.0, 0.0, -1.0, -1.0, 0.0, 1.0):
        drive(client, asked)
        told += [speed for speed, _ in robot.take()]
        robot.clock.advance(0.1)
    assert told == pytest.approx([0.1, 0.2, 0.3, 0.0, -0.1, -0.2, 0.0, 0.1])
    robot.clock.advance(1.0)  # After a pause the robot is taken to stand.
    drive(client, -1.0)
    ((speed, _),) = robot.take()
    assert speed == pytest.approx(-0.1)


def test_size_and_number_of_messages_are_bounded() -> None:
    rule = {"say": {"topics": ["/say"], "largest_bytes": 100, "messages_per_second": 10}}
    robot = GatedRobot(rule)
    heard = robot.hear("/say", "std_msgs/String")
    client = robot.client()
    refused = _say(client, "/say", {"data": "x" * 100})
    assert "bytes: 100 is the limit (gate.rules.say.largest_bytes)" in refused
    said = [_say(client, "/say", {"data": "x"}) for _ in range(10)]
    assert (said[:2], len(heard)) == (["", ""], 2)
    assert "more than 10 messages a second on /say (gate.rules.say.messages_per_second)" in said[2]
    robot.clock.advance(0.1)
    assert _say(client, "/say", {"data": "x"}) == ""


def test_requests_and_goals_are_limited_too() -> None:
    rules = {
        "add": {"services": ["/add"], "fields": {"a": {"max": 10}}},
        "count": {"actions": ["/count"], "fields": {"order": {"max": 5, "beyond": "clamp"}}},
        "late": {"services": ["/late"], "fields": {"missing": {"max": 1}}},
    }
    robot = GatedRobot(rules)
    robot.node.advertise_service("/add", "example_interfaces/AddTwoInts", lambda r: {"sum": r.a + r.b})
    robot.offer("/late")
    orders, _ = robot.accept_goals("/count")
    client = robot.client()
    client.say("call_service", service="/add", args={"a": 11, "b": 1})
    (answer,) = client.heard()
    assert answer["result"] is False
    assert "a: expected at most 10, got 11 (gate.rules.add.fields)" in answer["values"]
    client.say("call_service", service="/late", args={})
    assert "has no field missing" in client.heard()[0]["values"]
    client.say("send_action_goal", action="/count", action_type=FIBONACCI, args={"order": 9})
    assert orders == [5]


@pytest.mark.parametrize(
    ("field", "limit", "text"),
    [
        ("linear.w", {"max": 1}, "has no field w; it has x, y, z"),
        ("linear", {"max": 1}, "expected a number"),
        ("linear.x", {"one_of": ["a"]}, "expected a text"),
        ("linear[].x", {"max": 1}, "no list"),
        ("linear.x.y", {"max": 1}, "which has no fields"),
    ],
)
def test_a_field_that_there_is_not_is_an_error_of_the_settings(field: str, limit: Any, text: str) -> None:
    robot = GatedRobot({"drive": {"topics": ["/late"], "fields": {field: limit}}})
    refused = drive(robot.client("admin"), 0.0, "/late")
    assert "gate.rules.drive.fields" in refused
    assert text in refused
    # Of a topic that is there when the server starts, it does not start.
    with pytest.raises(ValueError, match=r"gate\.rules\.drive\.fields"):
        GatedRobot({"drive": {"topics": ["/cmd_vel"], "fields": {field: limit}}})


@pytest.mark.parametrize(
    ("rule", "text"),
    [
        ({}, "expected one of `topics`"),
        ({"topics": ["/a"], "lease": {}}, "need a stop message"),
        ({"topics": ["/a"], "emergency": True}, "need a stop message"),
        ({"services": ["/a"], "stop": {}}, "`stop` is about topics"),
        ({"services": ["/a"], "fields": {"a": {"rate": 1}}}, "`rate` is about topics"),
        ({"parameters": ["/a"], "fields": {"a": {"max": 1}}}, "`fields` are those of messages"),
        ({"topics": ["/a"], "fields": {"a": {}}}, "expected one of `min`"),
        ({"topics": ["/a"], "fields": {"a": {"min": 2, "max": 1}}}, "expected at most `max`"),
        ({"topics": ["/a"], "fields": {"a": {"max": math.nan}}}, "fields.a.max`: expected a"),
        ({"topics": ["/a"], "fields": {"a..b": {"max": 1}}}, "the way to a field"),
        ({"topics": ["/a"], "fields": {"a": {"one_of": ["x"], "beyond": "clamp"}}}, "cannot be brought"),
        ({"topics": ["/a"], "lease": {"seconds": 0.0}, "stop": {}}, "lease.seconds`: expected a"),
        ({"topics": ["/a"], "leese": {}}, "did you mean `gate.rules.it.lease`?"),
        ({"topics": ["/a"], "approval": {}}, "approval.roles`: "),
        ({"topics": ["/a"], "approval": {"roles": ["admin"]}}, "approval.roles`: no client can approve"),
        ({"topics": ["/a"], "approval": {"roles": ["nobody"]}}, "there is no role 'nobody'"),
        ({"topics": ["/a"], "roles": ["oprator"]}, "there is no role 'oprator'"),
    ],
)
def test_a_rule_that_does_not_fit_together_is_refused(rule: Mapping[str, Any], text: str) -> None:
    with pytest.raises(SettingsError) as raised:
        Settings(gate={"rules": {"it": rule}})
    assert text in str(raised.value)
    with pytest.raises(SettingsError, match="expected `workers = 1`"):
        Settings(workers=2, graph="zenoh", gate={"rules": {"it": {"topics": ["/a"]}}})


def test_every_rule_that_fits_holds() -> None:
    rules = {
        "wide": {"topics": ["*"], "largest_bytes": 1000},
        "drive": {"topics": ["/cmd_*"], "fields": {"linear.x": {"max": 1}}},
        "slow": {"topics": ["cmd_vel"], "fields": {"linear.x": {"max": 0.5}}},
    }
    robot = GatedRobot(rules)
    client = robot.client()
    assert "gate.rules.wide" in _say(client, "/text", {"data": "x" * 1000}, "std_msgs/String")
    assert "gate.rules.drive" in drive(client, 2.0)
    assert "gate.rules.slow" in drive(client, 0.8)
    assert drive(client, 0.5) == ""
    assert robot.take() == [(0.5, CLIENT)]


def _trajectory(robot_rule: Mapping[str, Any]) -> tuple[GatedRobot, Client]:
    rule = {"topics": ["/arm"], "stop": {}, "type": "trajectory_msgs/JointTrajectory", **robot_rule}
    robot = GatedRobot({"arm": rule})
    return robot, robot.client()


def _move(client: Client, *positions: float, names: tuple[str, ...] = ("pan", "lift")) -> str:
    message = {"joint_names": names, "points": [{"positions": positions}]}
    return _say(client, "/arm", message, "trajectory_msgs/JointTrajectory")


def test_items_of_a_list_have_limits_of_their_own() -> None:
    _, client = _trajectory(
        {
            "fields": {
                "joint_names[0]": {"one_of": ["pan"]},
                "joint_names[1]": {"one_of": ["lift"]},
                "points[].positions[0]": {"min": -1, "max": 1},
                "points[].positions[1]": {"max": 2, "beyond": "clamp"},
            }
        }
    )
    assert _move(client, 0.5, 1.5) == ""
    assert _move(client, 0.5, 9.0) == ""
    assert _move(client, 0.5) == ""
    assert "points[0].positions[0]: expected -1 to 1, got 1.5 (gate.rules.arm.fields)" in _move(client, 1.5)
    assert "joint_names[0]: expected 'pan', got 'lift'" in _move(client, 1.5, 0.5, names=("lift", "pan"))


def test_a_clamped_item_leaves_the_others_of_the_list() -> None:
    rule = Rule(
        "arm",
        GateRule.model_validate(
            {"topics": ["/arm"], "fields": {"points[].positions[1]": {"max": 2, "beyond": "clamp"}}}
        ),
    )
    type = GatedRobot({}).graph.registry.message("trajectory_msgs/JointTrajectory")
    given = Payload.from_value(type, {"points": [{"positions": [7, 8, 9]}, {"positions": [1]}]})
    passed, changes = FieldChecks(rule, type).check(given, 0.0)
    assert str(Clamped(changes)) == "points[0].positions[1]: 2 in place of 8"
    value: Any = passed.value()
    assert [list(point.positions) for point in value.points] == [[7, 2, 9], [1]]


def test_a_rate_from_the_last_value_holds_in_both_directions() -> None:
    rate = {"rate": 1.0, "rate_from": "last"}
    robot, client = _trajectory({"fields": {"points[0].positions[]": rate}})
    assert _move(client, 1.5) == ""  # The first one: where the arm is now is not known.
    robot.clock.advance(0.1)
    assert "points[0].positions[0]: expected 1.4 to 1.6, got 0" in _move(client, 0.0)
    robot.clock.advance(5.0)
    assert "expected 1.4 to 1.6, got 0" in _move(client, 0.0)
    assert _move(client, 1.4) == ""
