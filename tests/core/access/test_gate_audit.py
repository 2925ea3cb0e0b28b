"""The audit's file: who did what, by which rule; rotated, bounded, and written by a thread of its own."""

from __future__ import annotations

import errno
import io
import json
import logging
import os
import stat
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from rwt.access.audit import Audit, LogRate
from rwt.access.gate.audit.file import AuditFile, encode, hash_of, numbered, read_audit, traffic_file
from rwt.access.gate.audit.verification import verify_audit
from rwt.access.gate.record import DECISIONS, Actor, AuditBudget, Recorder
from rwt.access.roles import Role
from rwt.access.settings import AuditSettings, RoleSettings, SettingsError
from rwt.rosapi import Rosapi
from rwt_graph import SimulatedClock
from rwt_transports.endpoint import PeerInfo
from rwt_transports.errors import Refused
from tests.core.access.gated_robot import DRIVE, GatedRobot, call, drive, token


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "audit.jsonl"


def _lines(robot: GatedRobot, file: Path) -> list[Mapping[str, Any]]:
    """Return the lines when the server has ended, without the first and the last, which say that it ran."""
    robot.access.close()
    lines = list(read_audit(file))
    assert [lines[0]["decision"], lines[-1]["decision"]] == ["opened", "closed"]
    return lines[1:-1]


def _write(audit: AuditFile, **line: object) -> None:
    audit.write(encode(line))


def _plain(line: Mapping[str, Any]) -> dict[str, Any]:
    """Return a line without what chains it."""
    return {key: value for key, value in line.items() if key not in ("sequence", "line", "previous")}


def _events(lines: list[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    return [tuple(str(line.get(key, "")) for key in ("decision", "act", "name", "client")) for line in lines]


def test_it_says_who_did_what_and_which_rule_decided(file: Path) -> None:
    rules = {
        "drive": {**DRIVE, "emergency": True},
        "asked": {"services": ["/blink"], "approval": {"roles": ["supervisor"]}},
    }
    robot = GatedRobot(rules, audit={"file": file})
    robot.offer("/blink")
    robot.node.parameters.declare("limit", 1.0)
    one, two, supervisor = robot.clients("operator", "agent", "supervisor")
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
    assert "sequence" in refused
    assert refused["time"] == "2023-11-14T22:13:20.000Z"
    assert "held by rosbridge:1" in refused["text"]
    assert "roles.viewer.call" in lines[8]["text"]
    assert [(lines[at]["before"], lines[at]["after"]) for at in (1, 9, 10)] == [
        ("", "rosbridge:1"), ("released", "stopped"), ("rosbridge:1", ""),
    ]  # fmt: skip
    assert lines[4]["after"]["parameters"][0]["value"]["double_value"] == 2.0
    assert [line.get("credential") for line in lines[:8]] == [
        "operator", "operator", "agent", "agent", "operator", "agent", "supervisor", "agent",
    ]  # fmt: skip
    assert verify_audit(file).faults == []
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert {line["decision"] for line in lines} <= set(DECISIONS)


def test_a_clamped_message_has_its_values_before_and_after(file: Path) -> None:
    fields = {"linear.x": {"max": 0.8, "beyond": "clamp"}, "linear.y": {"min": -1, "beyond": "clamp"}}
    robot = GatedRobot({"drive": {"topics": ["/cmd_vel"], "fields": fields}}, audit={"file": file})
    client = robot.client()
    for _ in range(7):
        drive(client, 3.0, y=-2.5)
    changed, *_, repeated = (line for line in _lines(robot, file) if line["decision"] == "changed")
    assert changed["before"] == {"linear.x": 3.0, "linear.y": -2.5}
    assert changed["after"] == {"linear.x": 0.8, "linear.y": -1.0}
    assert (repeated["repeated"], "before" in repeated) == (2, False)


def test_an_audit_alone_needs_no_rules_and_offers_nothing(file: Path) -> None:
    robot = GatedRobot({}, audit={"file": file})
    robot.offer("/blink")
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


def test_repeated_events_are_counted(file: Path) -> None:
    robot = GatedRobot({"drive": DRIVE}, audit={"file": file})
    drive(robot.client(), 0.1)
    client = robot.client()
    for _ in range(317):
        drive(client, 0.2)
    robot.clock.advance(0.4)
    robot.clock.advance(10)
    lines = [line for line in _lines(robot, file) if line["decision"] == "refused"]
    assert [line.get("repeated") for line in lines] == [None] * 5 + [312]
    assert lines[5]["text"] == "repeated 312 times in 10 s"
    assert (lines[5]["rule"], lines[5]["client"]) == ("gate.rules.drive.lease", "rosbridge:2")


def test_a_viewer_cannot_rotate_away_what_others_did(file: Path) -> None:
    """Attack: reconnect again and again, and be refused under ever new names."""
    robot = GatedRobot({"drive": DRIVE}, audit={"file": file, "file_bytes": 128 * 1024, "files": 2})
    drive(robot.client(), 0.1)
    robot.clock.advance(1)
    for attempt in range(300):
        viewer = robot.client("agent")
        viewer.peer.graph.take_role(robot.access.admission.roles["viewer"].given_by("viewer"))
        for number in range(10):
            viewer.say("publish", topic=f"/x{attempt}/{number}", type="std_msgs/Empty", msg={})
            viewer.heard()
        viewer.peer.closed(1000, "")
        robot.clock.advance(0.5)
    lines = _lines(robot, file)
    assert lines[0]["name"] == "/cmd_vel", "the operator's first event has disappeared"
    assert any(line["decision"] == "lease" and line["role"] == "operator" for line in lines)
    left_out = [line for line in lines if line["decision"] == "left out"]
    written = sum(line["decision"] == "refused" for line in lines)
    counted = sum(int(line["text"].removeprefix("over the budget: ").split()[0]) for line in left_out)
    assert written + counted == 3000
    assert len(list(file.parent.iterdir())) <= 4
    assert verify_audit(file).faults == []


def test_allowed_traffic_does_not_rotate_events_away(file: Path) -> None:
    robot = GatedRobot({"drive": DRIVE}, audit={"file": file, "file_bytes": 4096, "files": 2})
    robot.offer(*(f"/s{number}" for number in range(200)))
    drive(robot.client(), 0.1)
    robot.clock.advance(1)
    client = robot.client("agent")
    for number in range(200):
        call(client, f"/s{number}")
    robot.access.close()
    events = [line["decision"] for line in map(json.loads, file.read_text().splitlines())]
    assert events == ["opened", "lease", "lease", "closed"]
    assert traffic_file(file).exists()


def test_a_line_names_the_token_and_values_before_and_after(file: Path) -> None:
    settings = AuditSettings(file=file)
    recorder = Recorder(settings, Audit(), SimulatedClock(0))
    role = Role("pilot", RoleSettings()).given_by("joystick")
    actor = Actor("rosbridge:1", role, "192.0.2.7")
    recorder.note(
        "changed", "publish", "/cmd_vel", actor, "clamped", "gate.rules.drive", before=3.0, after=0.8
    )
    recorder.note("allowed", "call", "/x\ud800", actor, "text\udcff", before="x" * 5000)
    recorder.close()
    _, line, odd, _ = read_audit(file)
    assert _plain(line) == {
        "time": "1970-01-01T00:00:00.000Z", "decision": "changed", "act": "publish", "name": "/cmd_vel",
        "client": "rosbridge:1", "role": "pilot", "address": "192.0.2.7", "credential": "joystick",
        "rule": "gate.rules.drive", "text": "clamped", "before": 3.0, "after": 0.8,
    }  # fmt: skip
    assert (odd["name"], odd["text"], len(str(odd["before"]))) == ("/x\\ud800", "text\\udcff", 2001)


@pytest.mark.parametrize(("credentials", "days"), [(1, 12), (2, 5)])
def test_the_files_last_for_days_against_credentials_that_write_all_they_may(
    credentials: int, days: int
) -> None:
    """Attack: many addresses each, one line after the other."""
    file_bytes, files, line = 10 * 1024 * 1024, 5, 400
    budget = AuditBudget(file_bytes, files, 7 * 86_400.0)
    written = 0
    for now in range(0, days * 86_400, 3600):
        for credential in range(credentials):
            for address in range(20):
                while budget.take((f"token{credential}", f"192.0.2.{address}"), line, float(now)):
                    written += line
    assert 0.5 < written / (file_bytes * (files - 1)) < 1


def test_clients_without_credentials_do_not_use_up_the_budget_of_the_gate_itself(file: Path) -> None:
    recorder = Recorder(AuditSettings(file=file, file_bytes=1024), Audit(), SimulatedClock(0))
    for number in range(2000):
        actor = Actor(f"http:{number}", Role("admin", RoleSettings()), f"192.0.2.{number % 200}")
        recorder.note("refused", "publish", f"/x{number}", actor)
    recorder.note("stop", "stop", "", None, "by the robot")
    recorder.close()
    assert any(line["decision"] == "stop" for line in read_audit(file))


def test_credentials_come_with_the_role() -> None:
    admission = GatedRobot({}).access.admission
    info, unknown = (
        PeerInfo("websocket", "192.0.2.7", 1, "/", {"authorization": f"Bearer {token(name)}"})
        for name in ("operator", "nobody")
    )
    with pytest.raises(Refused, match="this bearer token is not known here"):
        admission.role_of(unknown)
    role, plain = admission.role_of(info), admission.roles["operator"]
    assert role is not None
    assert (role.name, role.credential, plain.credential) == ("operator", "operator", "")
    assert role.answers is plain.answers


def _audit_of(path: Path, count: int = 8) -> list[bytes]:
    """Write an audit of some lines, and return them."""
    audit = AuditFile(AuditSettings(file=path))
    for number in range(count):
        _write(audit, number=number)
    audit.close()
    return path.read_bytes().splitlines(keepends=True)


@pytest.mark.parametrize(
    "attack, expected",
    [
        (lambda lines: [*lines[:2], lines[2].replace(b":2,", b":9,"), *lines[3:]], (3, "changed")),
        (lambda lines: [*lines[:2], *lines[5:]], (3, "3 lines were removed before this one")),
        (lambda lines: [*lines[:3], lines[2], *lines[3:]], (3, "inserted")),
        (lambda lines: [*lines[:3], b'{"number":7}\n', *lines[3:]], (4, "inserted")),
        (lambda lines: [*lines[:3], b"no JSON\n", *lines[3:]], (4, "inserted")),
    ],
)  # fmt: skip
def test_verification_finds_the_line(
    file: Path, attack: Callable[[list[bytes]], list[bytes]], expected: tuple[int, str]
) -> None:
    lines = _audit_of(file)
    assert verify_audit(file).faults == []
    file.write_bytes(b"".join(attack(lines)))
    line, text = expected
    assert any(each.line == line and each.text.startswith(text) for each in verify_audit(file).faults)


def test_verification_of_an_end_needs_a_hash_or_the_other_file(file: Path) -> None:
    audit = AuditFile(AuditSettings(file=file))
    for number in range(9):
        audit.write(encode({"number": number}), is_traffic=number > 6)
    audit.close()
    report = verify_audit(file)
    (_, last), _ = report.heads.values()
    assert verify_audit(file, last).has_line
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join(lines[:-2]))
    report = verify_audit(file, last)
    assert not report.has_line
    assert [each.text for each in report.faults] == [
        "lines with the sequence numbers 6 to 7 were removed at an end"
    ]
    traffic_file(file).unlink()
    assert verify_audit(file).faults == []  # Without the other file and a hash, an end looks like any other.


def test_a_chain_continues_after_rotation_restart_and_power_failure(file: Path) -> None:
    settings = AuditSettings(file=file, file_bytes=1024, files=9)
    for start in range(3):
        audit = AuditFile(settings)
        for number in range(12):
            _write(audit, number=number, text="x" * 50)
            while audit.waiting:
                threading.Event().wait(0.001)
        audit.close()
        if start == 1:
            with file.open("ab") as log:
                log.write(b'{"sequence":25,"li')
    report = verify_audit(file)
    assert report.faults == []
    assert report.lines == 37
    assert numbered(file, 2).exists()
    numbered(file, 1).unlink()
    numbered(file, 2).rename(numbered(file, 1))
    faults = verify_audit(file).faults
    assert any("removed before this one" in each.text for each in faults)


def test_files_are_rotated_by_age(file: Path) -> None:
    settings = AuditSettings(file=file, file_days=1.0)
    file.write_text('{"time": "2020-01-01T00:00:00Z", "line": 1, "sequence": 1}\n')
    audit = AuditFile(settings)
    _write(audit, number=1)
    audit.close()
    assert numbered(file, 1).read_text().startswith('{"time": "2020')
    assert verify_audit(file).faults == []


def test_lines_go_to_standard_output(capfd: pytest.CaptureFixture[str]) -> None:
    audit = AuditFile(AuditSettings(stdout=True))
    _write(audit, decision="stop")
    audit.write(encode({"decision": "allowed"}), is_traffic=True)
    audit.close()
    first, second = map(json.loads, capfd.readouterr().out.splitlines())
    assert (first["decision"], first["sequence"], second["sequence"]) == ("stop", 1, 2)
    assert second["previous"] == hash_of(encode(first))


def test_files_are_rotated_and_the_oldest_deleted(file: Path) -> None:
    audit = AuditFile(AuditSettings(file=file, file_bytes=1024, files=3, queue_bytes=1024 * 1024))
    for number in range(200):
        _write(audit, number=number, text="x" * 100)
        while audit.waiting:
            threading.Event().wait(0.001)
    audit.close()
    files = sorted(each.name for each in file.parent.iterdir())
    assert files == ["audit.jsonl", "audit.jsonl.1", "audit.jsonl.2", "audit.traffic.jsonl"]
    assert all(each.stat().st_size <= 1024 for each in file.parent.iterdir())
    numbers = [line["number"] for line in read_audit(file)]
    assert numbers == list(range(200 - len(numbers), 200))
    assert len(numbers) >= 9


def test_a_disk_that_is_slower_than_the_events_costs_lines_and_never_the_server(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    audit = AuditFile(AuditSettings(file=file, queue_bytes=1024))
    is_writing, go_on = threading.Event(), threading.Event()
    put = audit._put

    def slowly(lines: list[tuple[bytes, bool]], unsaid: int) -> None:
        is_writing.set()
        go_on.wait(20)
        put(lines, unsaid)

    monkeypatch.setattr(audit, "_put", slowly)
    _write(audit, number=0)
    assert is_writing.wait(20)
    for number in range(1, 200):
        _write(audit, number=number)
    assert audit.waiting <= 1024
    dropped = audit.dropped
    assert dropped > 100
    go_on.set()
    audit.close()
    lines = list(read_audit(file))
    assert _plain(lines[-1]) == {"decision": "left out", "text": f"{dropped} lines were dropped"}
    assert [line["number"] for line in lines[:-1]] == list(range(200 - dropped))


def test_a_full_disk_is_counted_and_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full here")
    path = tmp_path / "full.jsonl"
    path.symlink_to("/dev/full")
    audit = AuditFile(AuditSettings(file=path))
    for number in range(3):
        _write(audit, number=number)
    audit.close()
    assert audit.failure == "No space left on device"
    assert audit.dropped == 3
    assert caplog.text.count(f"the audit cannot be written: {path}: No space left") == 1


def test_a_failure_ends_with_the_next_line_that_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    audit = AuditFile(AuditSettings(file=tmp_path / "audit.jsonl", queue_bytes=1024))

    def until_written() -> None:
        while audit.waiting:
            time.sleep(0.001)

    for number in range(1000):
        _write(audit, number=number)  # Lines over the limit of the queue are no failure of the disk.
    until_written()
    assert audit.dropped > 0
    failures = [audit.failure]
    for _ in range(2):
        with monkeypatch.context() as full:
            full.setattr("rwt.access.gate.audit.file.chained", _no_space)
            _write(audit, number=0)
            until_written()
            failures.append(audit.failure)
        _write(audit, number=1)
        until_written()
        failures.append(audit.failure)
    audit.close()
    assert failures == ["", *["No space left on device", ""] * 2]
    assert caplog.text.count("the audit cannot be written") == 2
    assert caplog.text.count("the audit is written again") == 2


def _no_space(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_file_that_cannot_be_opened_is_an_error_of_the_settings(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"`gate.audit.file`: cannot be written: No such file"):
        GatedRobot({}, audit={"file": tmp_path / "missing" / "audit.jsonl"})


def test_a_line_that_was_cut_is_left_out(file: Path) -> None:
    numbered(file, 1).write_text('{"number": 1}\n{"numb')
    file.write_text('\n[]\n{"number": 2}\n')
    assert [json.dumps(line) for line in read_audit(file)] == ['{"number": 1}', '{"number": 2}']


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
def test_a_changed_parameter_has_its_values_before_and_after(file: Path, distro: str) -> None:
    robot = GatedRobot({}, distro, audit={"file": file})
    Rosapi(robot.graph)
    robot.node.parameters.declare("limit", 1.5)
    client = robot.client()
    name = "/robot:limit" if distro == "jazzy" else "/robot/limit"
    for value in ("2.5", "3.5"):
        call(client, "/rosapi/set_param", name=name, value=value)
    call(client, "/rosapi/set_param", name="/new" if distro == "noetic" else "/robot:new", value="1")
    lines = [line for line in _lines(robot, file) if line["act"] == "set_param"]
    assert [line.get("before") for line in lines] == [1.5, 2.5, None]
    assert all("value" in str(line["after"]) for line in lines)


def test_log_gate_and_audit_name_a_client_in_the_same_way(
    file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "rwt.bridge")
    robot = GatedRobot({"drive": {**DRIVE, "emergency": True}}, audit={"file": file})
    client = robot.client("agent")
    drive(client, 100.0)
    client.say("unsubscribe", topic="/nought", id="the id")
    robot.client("supervisor")
    call(client, "/gate/stop")
    records = [vars(record) for record in caplog.records if record.name == "rwt.bridge"]
    named = [record for record in records if record.get("client") == "rosbridge:1"]
    assert any(record["op_id"] == "the id" for record in named)
    assert any(record["message"].startswith("gate: stop") for record in named)
    assert {record["client"] for record in records} == {"rosbridge:1", "rosbridge:2"}
    assert "rosbridge:1" in {line.get("client") for line in _lines(robot, file)}


def test_a_place_that_floods_the_log_is_cut_and_counted_and_another_is_not() -> None:
    written = io.StringIO()
    handler = logging.StreamHandler(written)
    seconds = [0.0]
    handler.addFilter(LogRate(per_second=1, burst=3, monotonic=lambda: seconds[0]))
    logger = logging.Logger("flood")
    logger.addHandler(handler)
    for number in range(11):
        if number == 10:
            seconds[0] = 60.0
            logger.warning("of another place, with 100 %")
        logger.warning("line %d of %s", number, "a client")
    assert written.getvalue().splitlines() == [
        *(f"line {number} of a client" for number in range(3)),
        "of another place, with 100 %",
        "line 10 of a client (7 lines like it were left out)",
    ]
