"""`rwt gate explain` and `rwt gate check`: the decisions of a server, without one."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.core.access.gated_robot import GatedRobot, drive
from tests.core.cli.conftest import Rwt

TOKEN = "phone-token-of-the-test"
CONFIG = f"""
[auth.tokens.phone]
token = "{TOKEN}"
role = "operator"

[roles.operator]
publish = ["/cmd_vel"]
call = ["/reset", "/arm"]
goals = ["/dock"]
set_param = ["/robot:*"]

[gate.rules.drive]
topics = ["/cmd_vel"]
emergency = true
lease = {{ seconds = 0.5 }}
stop = {{}}

[gate.rules.drive.fields]
"linear.x" = {{ min = -0.3, max = 0.8, beyond = "clamp" }}
"linear.y" = {{ min = 0, max = 0 }}

[gate.rules.asked]
services = ["/arm"]
actions = ["/dock"]
parameters = ["/robot:speed"]
approval = {{ roles = ["admin"] }}
"""
TWIST = ("--type", "geometry_msgs/msg/Twist")
TRIGGER = ("--type", "std_srvs/srv/Trigger")
DOCK = ("--type", "example_interfaces/action/Fibonacci")
PHONE = ("--as", "phone")
DRIVE, ASKED = "gate.rules.drive", "gate.rules.asked"


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """Settings of a server."""
    path = tmp_path / "robot.toml"
    path.write_text(CONFIG)
    return path


@pytest.mark.parametrize(
    ("words", "code", "decision", "rule", "line"),
    [
        ((*PHONE, "publish", "/cmd_vel", "{linear: {x: 0.5}}", *TWIST), 0, "allowed", "", 0),
        ((*PHONE, "publish", "cmd_vel", "{linear: {x: 2}}", *TWIST), 0, "changed", "", 0),
        (("--as", TOKEN, "publish", "cmd_vel", "linear: {y: 2}", *TWIST), 1, "denied", f"{DRIVE}.fields", 18),
        ((*PHONE, "publish", "cmd_vel", "{linear: {y: .nan}}", *TWIST), 1, "denied", f"{DRIVE}.finite", 12),
        ((*PHONE, "publish", "/other", *TWIST), 1, "denied", "roles.operator.publish", 7),
        ((*PHONE, "subscribe", "/other"), 1, "denied", "roles.operator.subscribe", 6),
        (("--role", "viewer", "publish", "/cmd_vel", *TWIST), 1, "denied", "roles.viewer.publish", 0),
        (("--role", "viewer", "subscribe", "/cmd_vel"), 0, "allowed", "", 0),
        (("--role", "viewer", "get_param", "/robot:speed"), 0, "allowed", "", 0),
        ((*PHONE, "call", "/reset", *TRIGGER), 0, "allowed", "", 0),
        ((*PHONE, "call", "/arm", *TRIGGER), 1, "needs approval", f"{ASKED}.approval", 26),
        ((*PHONE, "set_param", "/robot:speed", "3"), 1, "needs approval", f"{ASKED}.approval", 26),
        ((*PHONE, "set_param", "/robot:name", "x"), 0, "allowed", "", 0),
        ((*PHONE, "set_param", "/other:name", "x"), 1, "denied", "roles.operator.set_param", 10),
        ((*PHONE, "goal", "/dock", *DOCK), 1, "needs approval", f"{ASKED}.approval", 26),
        ((*PHONE, "provide", "/reset"), 1, "denied", "roles.operator.provide", 6),
        (("publish", "/cmd_vel", *TWIST), 1, "denied", "auth.default_role", 0),
    ],
)  # fmt: skip
def test_check(
    rwt: Rwt, config: Path, words: tuple[str, ...], code: int, decision: str, rule: str, line: int
) -> None:
    ended = rwt("gate", "check", str(config), *words, "--json")
    said = ended.json
    assert (ended.code, said["decision"], said["rule"]) == (code, decision, rule), said
    assert said["place"] == (f"{config}:{line}" if line else "default" if rule else "")
    assert (said["credential"] == "phone") == ("--as" in words)


@pytest.mark.parametrize("speed", [0.5, 2.0, -1.0])
def test_the_decision_is_that_of_a_server(rwt: Rwt, config: Path, speed: float) -> None:
    message = f"{{linear: {{x: {speed}}}}}"
    said = rwt("gate", "check", str(config), *PHONE, "publish", "/cmd_vel", message, *TWIST, "--json").json
    fields = {"linear.x": {"min": -0.3, "max": 0.8, "beyond": "clamp"}}
    robot = GatedRobot({"drive": {"topics": ["/cmd_vel"], "fields": fields}})
    drive(robot.client(), speed)
    ((received, _),) = robot.take()
    assert said["sent"].startswith(f'{{"linear":{{"x":{received}' if received != speed else "")


def test_check_for_people(rwt: Rwt, config: Path) -> None:
    said = rwt(
        "gate", "check", str(config), "--as", "phone", "publish", "/cmd_vel", "{linear: {y: 1}}", *TWIST
    )
    assert said.out.splitlines() == [
        "denied (role operator, token phone)",
        "  linear.y: expected 0 to 0, got 1 (gate.rules.drive.fields)",
        f"  decided by gate.rules.drive.fields ({config}:18)",
        f"  checked by gate.rules.drive ({config}:12)",
    ]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--as", "nobody", "subscribe", "/x"), "no such token in auth.tokens; known names are phone"),
        (("--role", "nobody", "subscribe", "/x"), "no role 'nobody'"),
        ((*PHONE, "--role", "viewer", "subscribe", "/x"), "expected one of --as and --role"),
        ((*PHONE, "publish", "/cmd_vel"), "does not state its type: pass --type"),
        ((*PHONE, "publish", "/cmd_vel", "{speed: 1}", *TWIST), "speed"),
        ((*PHONE, "publish", "/cmd_vel", "--type", "a/B"), "a/B"),
        ((*PHONE, "subscribe", "/x", "{}"), "subscribe has no message"),
        ((*PHONE, "drive", "/x"), "drive"),
    ],
)  # fmt: skip
def test_incorrect_use(rwt: Rwt, config: Path, words: tuple[str, ...], text: str) -> None:
    ended = rwt("gate", "check", str(config), *words)
    assert (ended.code, text in ended.err) == (2, True), ended.err


def test_settings_that_a_server_rejects(rwt: Rwt, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("demo = 'yes'")
    ended = rwt("gate", "explain", str(path))
    assert (ended.code, f"{path}:1: `demo`" in ended.err) == (2, True)


def test_explain(rwt: Rwt, config: Path) -> None:
    rows = rwt("gate", "explain", str(config), "--json").json
    found = {(row["role"], row["verb"], row["resource"]): row for row in rows}
    row = found["operator", "publish", "/cmd_vel"]
    assert (row["rules"], row["places"]) == (["drive"], [f"{config}:12"])
    assert row["limits"] == (
        "lease 0.5 s, emergency stop, linear.x -0.3 to 0.8 (clamp), linear.y 0 to 0 (refuse)"
    )
    assert found["operator", "call", "/arm"]["limits"] == "approval by admin"
    assert ("viewer", "publish", "/cmd_vel") not in found
    assert ("admin", "approve", "asked") in found and ("operator", "approve", "asked") not in found
    assert ("operator", "stop", "/gate") in found and ("operator", "release_stop", "/gate") not in found
    shown = rwt("gate", "explain", str(config), "--role", "operator").out
    assert f"token phone: role operator ({config}:2)" in shown
    assert "viewer" not in shown
    assert rwt("gate", "explain", str(config), "--role", "x").code == 2
