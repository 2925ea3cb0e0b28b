"""The audit's file: who did what, by which rule; rotated, bounded, and written by a thread of its own."""

from __future__ import annotations

import json
import stat
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from rwt.access.gate.audit_file import AuditFile, numbered, read_audit
from rwt.access.gate.record import DECISIONS
from rwt.access.settings import SettingsError
from rwt.access.settings.gate import AuditSettings
from tests.rwt.access.gated_robot import DRIVE, GatedRobot, call, drive


def _lines(robot: GatedRobot, file: Path) -> list[Mapping[str, Any]]:
    """What is in the file when the server has ended."""
    robot.access.close()
    return list(read_audit(file))


def _events(lines: list[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    return [tuple(str(line.get(key, "")) for key in ("decision", "act", "name", "client")) for line in lines]


def test_it_says_who_did_what_and_which_rule_decided(tmp_path: Path) -> None:
    file = tmp_path / "audit.jsonl"
    rules = {
        "drive": {**DRIVE, "emergency": True},
        "asked": {"services": ["/blink"], "approval": {"roles": ["supervisor"]}},
    }
    robot = GatedRobot(rules, audit={"file": file})
    robot.node.advertise_service("/blink", "std_srvs/Trigger", lambda _: {"success": True})
    robot.node.parameters.declare("limit", 1.0)
    one, two, supervisor = robot.client(), robot.client("agent"), robot.client("supervisor")
    drive(one, 0.5)
    drive(two, 0.5)
    value = {"type": 3, "double_value": 2.0}
    call(one, "/robot/set_parameters", parameters=[{"name": "limit", "value": value}])
    two.say("call_service", service="/blink", args={})
    call(supervisor, "/gate/approve", id="1", approve=True, seconds=0.0)
    two.peer.graph.take_role(robot.access.admission.roles["viewer"])
    two.say("call_service", service="/blink", args={})
    call(supervisor, "/gate/stop", reason="smoke\x1b[31m\nsecond line")
    lines = _lines(robot, file)
    assert _events(lines) == [
        ("allowed", "publish", "/cmd_vel", "rosbridge:1"),
        ("lease", "publish", "/cmd_vel", "rosbridge:1"),
        ("allowed", "publish", "/cmd_vel", "rosbridge:2"),
        ("refused", "publish", "/cmd_vel", "rosbridge:2"),
        ("allowed", "set_param", "/robot:limit", "rosbridge:1"),
        ("asked", "call", "/blink", "rosbridge:2"),
        ("approved", "call", "/blink", "rosbridge:3"),
        ("allowed", "call", "/blink", "rosbridge:2"),
        ("refused", "call", "/blink", "rosbridge:2"),
        ("stop", "stop", "", "rosbridge:3"),
        ("lease", "publish", "/cmd_vel", "rosbridge:1"),
    ]
    refused = lines[3]
    assert (refused["rule"], refused["role"], refused["address"]) == (
        "gate.rules.drive.lease", "agent", "127.0.0.1",
    )  # fmt: skip
    assert refused["time"] == "2023-11-14T22:13:20.000Z"
    assert "held by rosbridge:1" in refused["text"]
    assert "roles.viewer.call" in lines[8]["text"]
    assert file.read_bytes().count(b"\n") == len(lines)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert {line["decision"] for line in lines} <= set(DECISIONS)


def test_an_audit_alone_needs_no_rules_and_offers_nothing(tmp_path: Path) -> None:
    file = tmp_path / "audit.jsonl"
    robot = GatedRobot({}, audit={"file": file})
    robot.node.advertise_service("/blink", "std_srvs/Trigger", lambda _: {"success": True})
    client = robot.client()
    assert drive(client, 0.5) == ""
    call(client, "/blink")
    assert robot.graph.service("/gate/stop") is None
    client.say("publish", topic="/gate/leases", type="std_msgs/Empty", msg={})
    assert client.heard() == []
    drive(client, 0.6)
    assert _events(_lines(robot, file)) == [
        ("allowed", "publish", "/cmd_vel", "rosbridge:1"),
        ("allowed", "call", "/blink", "rosbridge:1"),
        ("allowed", "publish", "/gate/leases", "rosbridge:1"),
    ]


def test_who_is_refused_again_and_again_causes_few_lines_and_their_number(tmp_path: Path) -> None:
    file = tmp_path / "audit.jsonl"
    robot = GatedRobot({"drive": DRIVE}, audit={"file": file})
    drive(robot.client(), 0.1)
    client = robot.client()
    for _ in range(1000):
        drive(client, 0.2)
    robot.clock.advance(0.4)
    drive(client, 0.2)
    lines = _lines(robot, file)
    assert 200 < len(lines) < 215
    (left_out,) = (line for line in lines if line["decision"] == "left out")
    refused = sum(line["decision"] == "refused" for line in lines)
    assert left_out["text"] == f"{1001 - refused} lines about this client"


def test_files_are_rotated_and_the_oldest_deleted(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    audit = AuditFile(AuditSettings(file=path, file_bytes=1024, files=3, queue_bytes=1024 * 1024))
    for number in range(200):
        audit.write({"number": number, "text": "x" * 100})
        while audit.waiting:
            threading.Event().wait(0.001)
    audit.close()
    files = sorted(each.name for each in tmp_path.iterdir())
    assert files == ["audit.jsonl", "audit.jsonl.1", "audit.jsonl.2"]
    assert all(each.stat().st_size <= 1024 for each in tmp_path.iterdir())
    numbers = [line["number"] for line in read_audit(path)]
    assert numbers == list(range(200 - len(numbers), 200))
    assert len(numbers) > 15


def test_a_disk_that_is_slower_than_the_events_costs_lines_and_never_the_server(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "audit.jsonl"
    audit = AuditFile(AuditSettings(file=path, queue_bytes=1024))
    is_writing, go_on = threading.Event(), threading.Event()
    put = audit._put

    def slowly(lines: list[bytes], unsaid: int) -> None:
        is_writing.set()
        go_on.wait(20)
        put(lines, unsaid)

    monkeypatch.setattr(audit, "_put", slowly)
    audit.write({"number": 0})
    assert is_writing.wait(20)
    for number in range(1, 200):
        audit.write({"number": number})
    assert audit.waiting <= 1024
    dropped = audit.dropped
    assert dropped > 100
    go_on.set()
    audit.close()
    lines = list(read_audit(path))
    assert lines[-1] == {"decision": "left out", "text": f"{dropped} lines were dropped"}
    assert [line["number"] for line in lines[:-1]] == list(range(200 - dropped))


def test_a_full_disk_is_counted_and_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full here")
    audit = AuditFile(AuditSettings(file=Path("/dev/full")))
    for number in range(3):
        audit.write({"number": number})
    audit.close()
    assert audit.dropped == 3
    assert caplog.text.count("the audit cannot be written: /dev/full: No space left") == 1


def test_a_file_that_cannot_be_opened_is_an_error_of_the_settings(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"`gate.audit.file`: cannot be written: No such file"):
        GatedRobot({}, audit={"file": tmp_path / "missing" / "audit.jsonl"})


def test_a_line_that_was_cut_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "audit.jsonl"
    numbered(path, 1).write_text('{"number": 1}\n{"numb')
    path.write_text('\n[]\n{"number": 2}\n')
    assert [json.dumps(line) for line in read_audit(path)] == ['{"number": 1}', '{"number": 2}']
