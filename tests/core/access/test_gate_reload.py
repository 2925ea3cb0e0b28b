"""Gate rules are replaced while clients drive: all of them or none, and never a stop released."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from rwt import Server, SettingsError
from rwt.access.gate.audit.file import read_audit
from rwt.settings import load_settings
from rwt_participant.qos import LATCHED
from tests.core.access.gated_robot import CLIENT, DRIVE, GATE, TWIST, GatedRobot, call, drive, settings_of

STOPPED = {**DRIVE, "emergency": True}
SLOW = {"linear.x": {"min": -0.3, "max": 0.3, "beyond": "clamp"}}


def reload(robot: GatedRobot, rules: Mapping[str, Any], **gate: Any) -> None:
    """Replace the rules as a server does on SIGHUP."""
    robot.access.reload(settings_of({"rules": rules, **gate}))
    robot.bridge.reload_roles()


def holder(robot: GatedRobot) -> str:
    """Return the holder of the lease of /cmd_vel."""
    actor = robot.gate.holder_of("/cmd_vel")
    return "" if actor is None else actor.name


_OTHER: Mapping[str, Any] = {"topics": ["/o"]}
_SLOW: Mapping[str, Any] = {"topics": ["/cmd_vel"], "fields": SLOW}


@pytest.mark.parametrize(
    ("before", "after", "speeds"),
    [
        pytest.param({"drive": DRIVE}, {"drive": {**DRIVE, "fields": SLOW}}, [0.9, 0.3], id="new limits"),
        pytest.param({"other": _OTHER}, {"drive": _SLOW}, [0.9, 0.3], id="first rule of the topic"),
        pytest.param({"drive": _SLOW, "other": _OTHER}, {"other": _OTHER}, [0.3, 0.9], id="rule is gone"),
    ],
)
def test_new_rules_apply_to_the_next_message(
    before: Mapping[str, Any], after: Mapping[str, Any], speeds: list[float]
) -> None:
    robot = GatedRobot(before)
    client = robot.client()
    drive(client, 0.9)
    reload(robot, after)
    drive(client, 0.9)
    assert robot.take() == [(speed, CLIENT) for speed in speeds]


def test_a_lease_stays_and_silence_before_the_reload_counts() -> None:
    robot = GatedRobot({"drive": DRIVE})
    one, two = robot.client(), robot.client("agent")
    drive(one, 0.5)
    robot.clock.advance(0.3)
    reload(robot, {"drive": {**DRIVE, "fields": SLOW}})
    assert holder(robot) == "rosbridge:1"
    assert "held by rosbridge:1" in drive(two, 0.2)
    assert robot.take() == [(0.5, CLIENT)]
    robot.clock.advance(0.19)
    assert holder(robot) == "rosbridge:1"
    robot.clock.advance(0.02)
    assert holder(robot) == ""
    assert robot.take()[0] == (0.0, GATE)


@pytest.mark.parametrize(
    "after",
    [
        pytest.param({"drive": {**DRIVE, "lease": {"seconds": 0.2}}}, id="a shorter lease that is over"),
        pytest.param({"drive": {**DRIVE, "roles": ["supervisor"]}}, id="a lease for another role"),
        pytest.param({"other": _OTHER}, id="no lease"),
    ],
)
def test_a_lease_that_is_no_longer_allowed_ends_with_a_stop(after: Mapping[str, Any]) -> None:
    robot = GatedRobot({"drive": DRIVE, "other": _OTHER})
    drive(robot.client(), 0.5)
    robot.clock.advance(0.3)
    reload(robot, after)
    assert holder(robot) == ""
    told = robot.take()
    assert (told[0], set(told[1:])) == ((0.5, CLIENT), {(0.0, GATE)})


def test_stop_messages_go_on() -> None:
    robot = GatedRobot({"drive": DRIVE})
    drive(robot.client(), 0.5)
    robot.clock.advance(0.6)
    robot.take()
    reload(robot, {"drive": {**DRIVE, "fields": SLOW}})
    robot.clock.advance(0.35)
    assert robot.take() == [(0.0, GATE)] * 3


@pytest.mark.parametrize(
    ("rules", "text"),
    [
        ({"other": {"topics": ["/o"]}}, "`gate.rules.drive`"),
        ({"drive": DRIVE}, "`gate.rules.drive`"),
        ({"drive": {**STOPPED, "topics": ["/o"]}}, "`gate.rules.drive`"),
        ({"drive": {**STOPPED, "roles": ["agent"]}}, "`gate.rules.drive`"),
    ],
)
def test_a_reload_never_releases_a_stop(rules: Mapping[str, Any], text: str) -> None:
    """Attack: change the rule that is stopped."""
    robot = GatedRobot({"drive": STOPPED})
    client = robot.client()
    drive(client, 0.5)
    call(client, "/gate/stop", reason="")
    with pytest.raises(SettingsError, match="release it first") as refused:
        reload(robot, rules)
    assert text in str(refused.value)
    with pytest.raises(SettingsError, match=r"`gate.mode`: the emergency stop is on"):
        reload(robot, {"drive": STOPPED}, mode="observe")
    robot.take()
    reload(robot, {"drive": {**STOPPED, "fields": SLOW, "topics": ["/cmd_vel", "/more"]}})
    assert "the emergency stop is on" in drive(client, 0.5)
    robot.clock.advance(0.55)
    assert set(robot.take()) == {(0.0, GATE)}


def test_a_stop_after_the_reload_reaches_first_what_moved_before() -> None:
    rule = {**STOPPED, "topics": ["/x/*", "/z/*"], "type": TWIST}
    robot = GatedRobot({"drive": rule})
    for number in range(400):
        robot.node.advertise(f"/x/{number}", TWIST)
    client = robot.client()
    heard = robot.hear("/z/1")
    drive(client, 0.5, "/z/1")
    reload(robot, {"drive": {**rule, "fields": SLOW}})
    call(client, "/gate/stop", reason="")
    assert [each.linear.x for each in heard] == [0.5, 0.0]


@pytest.mark.parametrize(
    ("rules", "text"),
    [
        ({"drive": {**DRIVE, "fields": {"speed": {"max": 1}}}}, '`gate.rules.drive.fields."speed"`'),
        ({"drive": {**DRIVE, "stop": {"message": {"speed": 0}}}}, "`gate.rules.drive.stop.message`"),
        ({}, "`gate.rules`: the first and the last rule require a restart"),
    ],
)
def test_a_reload_that_fails_changes_nothing(rules: Mapping[str, Any], text: str) -> None:
    robot = GatedRobot({"drive": {**DRIVE, "fields": SLOW}})
    client = robot.client()
    drive(client, 0.9)
    before = robot.access.admission.roles
    with pytest.raises(SettingsError) as refused:
        reload(robot, rules)
    assert text in str(refused.value)
    assert robot.access.admission.roles is before
    assert holder(robot) == "rosbridge:1"
    drive(client, 0.8)
    assert robot.take() == [(0.3, CLIENT)] * 2


def test_the_audit_and_a_first_gate_require_a_restart(tmp_path: Path) -> None:
    robot = GatedRobot({"drive": DRIVE})
    with pytest.raises(SettingsError, match=r"`gate.audit`: cannot change while the server runs: restart it"):
        reload(robot, {"drive": DRIVE}, audit={"file": tmp_path / "audit.jsonl"})
    robot = GatedRobot({})
    with pytest.raises(SettingsError, match=r"`gate.rules`: .* requires a restart"):
        reload(robot, {"drive": DRIVE})


def test_requests_for_approval_of_changed_rules_are_denied(tmp_path: Path) -> None:
    asked = {"services": ["/blink"], "approval": {"roles": ["supervisor"]}}
    other = {**asked, "services": ["/wink"]}
    file = tmp_path / "audit.jsonl"
    robot = GatedRobot({"asked": asked, "other": other}, audit={"file": file})
    robot.offer("/blink", "/wink")
    client = robot.client()
    for name in ("/blink", "/wink"):
        client.say("call_service", service=name, args={})
    reload(robot, {"asked": {**asked, "largest_bytes": 9}, "other": other}, audit={"file": file})
    assert [each.name for each in robot.gate.approvals.pending] == ["/wink"]
    (answer,) = (each for each in client.heard() if each["op"] == "service_response")
    assert (answer["result"], "the settings have changed" in answer["values"]) == (False, True)
    robot.access.close()
    (line,) = (each for each in read_audit(file) if each["decision"] == "reload")
    assert line["text"] == "rules replaced; changed are gate.rules.asked"


@pytest.mark.anyio
async def test_errors_name_file_and_line_and_settings_without_effect(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "robot.toml"
    text = 'listen = ["ws://127.0.0.1:0"]\nnodes = []\n\n[gate.rules.drive]\ntopics = ["/cmd_vel"]\n'
    path.write_text(text)
    server = Server(settings=load_settings(path).settings, reload=lambda: load_settings(path))
    async with server:
        server.node("robot").subscribe("/cmd_vel", lambda _: None, "geometry_msgs/Twist")
        path.write_text(f"{text}[gate.rules.drive.fields]\nspeed = {{ max = 1 }}\n")
        with pytest.raises(SettingsError, match=r"robot.toml:7: `gate.rules.drive.fields.\"speed\"`"):
            server.reload()
        path.write_text(f"{text}[gate.rules.drive.fields]\n\"linear.x\" = {{ max = '1' }}\n")
        with pytest.raises(SettingsError, match=r"robot.toml:7: `gate.rules.drive.fields.linear.x.max`"):
            server.reload()
        path.write_text(f'{text}[gate.rules.drive.fields]\n"linear.x" = {{ max = 1 }}\n[limits]\ncalls = 7\n')
        with caplog.at_level(logging.WARNING):
            server.reload()
        assert "changed, but without effect until a restart: limits" in caplog.text
        gate = server.bridge.access.gate
        assert gate is not None
        assert json.loads(gate.settings.rules["drive"].model_dump_json())["fields"]["linear.x"]["max"] == 1


@pytest.mark.parametrize("has_left", [False, True])
def test_a_latched_topic_that_gets_a_stop_message_retains_no_command(has_left: bool) -> None:
    robot = GatedRobot({"drive": {"topics": ["/cmd_vel"], "fields": SLOW}})
    client = robot.client()
    client.say("advertise", topic="/cmd_vel", type="geometry_msgs/Twist", latch=True)
    drive(client, 0.2)
    if has_left:  # Its publisher lingers.
        client.peer.closed(1000, "")
    reload(robot, {"drive": DRIVE})
    assert robot.hear("/cmd_vel", qos=LATCHED) == []
    assert drive(robot.client() if has_left else client, 0.3) == ""
    assert robot.take() == [(0.2, CLIENT), (0.3, CLIENT)]
    assert robot.hear("/cmd_vel", qos=LATCHED) == []


def test_a_backend_may_retain_the_commands_of_no_topic_with_a_stop_message() -> None:
    robot = GatedRobot({"drive": {"topics": ["/cmd_vel"], "fields": SLOW}})
    assert robot.graph.may_retain("/cmd_vel")
    reload(robot, {"drive": DRIVE})
    assert not robot.graph.may_retain("/cmd_vel")
    assert robot.graph.may_retain("/other")
