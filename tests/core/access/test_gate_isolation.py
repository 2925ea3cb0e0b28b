"""Isolation: whatever clients of one credential do, those of others are served, and stay in the audit."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from rwt.access.audit import Audit
from rwt.access.gate.approvals import MAX_PENDING
from rwt.access.gate.audit.file import read_audit
from rwt.access.gate.audit.verification import verify_audit
from rwt.access.gate.gate import MAX_LEASES
from rwt.access.gate.record import DECISIONS, Actor, Recorder
from rwt.access.roles import Role
from rwt.access.settings import AuditSettings, RoleSettings
from rwt_graph import SimulatedClock
from tests.core.access.gated_robot import DRIVE, TWIST, GatedRobot, call, drive
from tests.core.rosbridge.recording_client import Client

APPROVAL = {"roles": ["supervisor"], "seconds": 600}
RULES: dict[str, Any] = {
    "drive": {**DRIVE, "topics": ["/cmd_vel", "/held", "/x/*"], "type": TWIST, "lease": {"seconds": 60}},
    "rated": {"topics": ["/rated"], "type": TWIST, "messages_per_second": 5},
    "limit": {"topics": ["/rated"], "roles": ["agent"], "fields": {"linear.x": {"max": 1}}},
    "asked": {"topics": ["/rated"], "roles": ["agent"], "approval": APPROVAL},
    "called": {"services": ["/blink", "/spawn"], "approval": APPROVAL},
}


class Attackers:
    """Two clients of one credential, which may do everything but stop."""

    def __init__(self, robot: GatedRobot, victim: str) -> None:
        self._one, self._other = robot.client("agent"), robot.client("agent")
        self._victim = victim

    def publish_without_approval(self, number: int) -> None:
        drive(self._one, 0.5 if number % 2 else 5.0, "/rated")

    def hold(self, number: int) -> None:
        drive(self._one, 0.1, f"/x/{number}")

    def pass_on(self, number: int) -> None:
        drive(self._one, 0.1, f"/x/{number}")
        call(self._one, "/gate/pass_lease", topic=f"/x/{number}", to=self._victim)

    def request_lease(self, number: int) -> None:
        drive(self._one, 0.1, f"/x/{number}")
        call(self._other, "/gate/request_lease", topic=f"/x/{number}")
        call(self._other, "/gate/request_lease", topic="/held")

    def ask(self, number: int) -> None:
        client = self._other if number % 2 else self._one
        client.say("call_service", service="/blink" if number % 3 else "/spawn", args={})
        client.heard()  # Rejections beyond the limit.

    def take(self, number: int) -> None:
        call(self._one, "/gate/take_lease", topic="/cmd_vel")
        call(self._one, "/gate/release_lease", topic="/cmd_vel")


ACTS: tuple[Callable[[Attackers, int], None], ...] = (
    Attackers.publish_without_approval,
    Attackers.hold,
    Attackers.pass_on,
    Attackers.request_lease,
    Attackers.ask,
    Attackers.take,
)


@pytest.mark.parametrize("act", ACTS, ids=lambda act: act.__name__)
def test_one_act_in_plenty_takes_nothing_from_another_credential(
    act: Callable[[Attackers, int], None],
) -> None:
    _attack([(act, MAX_PENDING if act is Attackers.ask else 2 * MAX_LEASES)])


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(st.sampled_from(ACTS), st.integers(1, 80)), max_size=6))
def test_no_sequence_of_acts_takes_anything_from_another_credential(
    acts: list[tuple[Callable[[Attackers, int], None], int]],
) -> None:
    _attack(acts)


def _attack(acts: list[tuple[Callable[[Attackers, int], None], int]]) -> None:
    robot = GatedRobot(RULES)
    robot.offer("/blink", "/spawn")
    for topic in ("/cmd_vel", "/held", *(f"/x/{number}" for number in range(3 * MAX_LEASES))):
        robot.node.advertise(topic, TWIST)
    victim, holder = robot.clients("operator", "admin")
    assert drive(holder, 0.1, "/held") == ""
    name = call(victim, "/gate/take_lease", topic="/cmd_vel")["client"]
    call(victim, "/gate/release_lease", topic="/cmd_vel")
    attackers = Attackers(robot, name)
    for act, times in acts:
        for number in range(times):
            act(attackers, number)
    victim.heard()
    _require_service(robot, victim)


def _require_service(robot: GatedRobot, victim: Client) -> None:
    assert drive(victim, 0.5, "/rated") == "", "its rate"
    taken = [call(victim, "/gate/take_lease", topic=f"/x/{2 * MAX_LEASES + each}") for each in range(8)]
    assert all(each["success"] for each in taken), "its room for leases"
    asked = call(victim, "/gate/request_lease", topic="/held")
    assert asked["success"], asked["message"]
    victim.say("call_service", service="/blink", args={}, id="own")
    pending = {each.client.role for each in robot.gate.approvals.pending}
    assert "operator" in pending, "its slot for requests"
    assert "operator" in {each.client.role for each in robot.gate.approvals.listed(100)}, (
        "its place in the list"
    )


EVENTS = st.tuples(
    st.integers(1, 20),
    st.sampled_from(sorted(set(DECISIONS) - {"opened", "closed", "left out"})),
    st.integers(1, 100),
    st.integers(0, 1500),
)


@settings(max_examples=25, deadline=None)
@example([(host, "refused", 50, 1500) for host in range(20)])
@given(st.lists(EVENTS, min_size=1, max_size=12))
def test_no_sequence_of_events_rotates_away_those_of_another_credential(events: list[Any]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file, clock = Path(folder) / "audit.jsonl", SimulatedClock(1_700_000_000 * 10**9)
        # Room for the burst of a credential, not for that of each of its addresses.
        recorder = Recorder(AuditSettings(file=file, file_bytes=128 * 1024, files=2), Audit(), clock)
        operator = Actor("rosbridge:1", Role("pilot", RoleSettings()).given_by("joystick"), "192.0.2.7")
        own, expected = 0, 0
        for host, decision, times, size in events:
            recorder.note("stop", "stop", "", operator, f"event {own}", before="released", after="stopped")
            own += 1
            role = Role("guest", RoleSettings()).given_by("viewer")
            for number in range(times):
                actor = Actor(f"rosbridge:{number}", role, f"198.51.100.{host}")
                recorder.note(decision, "call", f"/{own}/{number}", actor, "x" * size)
            expected += times
            clock.advance(0.5)
        recorder.close()
        lines: list[Any] = list(read_audit(file))
        assert verify_audit(file).faults == []
    kept = [line for line in lines if line.get("credential") == "joystick"]
    assert [line["text"] for line in kept] == [f"event {number}" for number in range(own)]
    assert all(line["client"] == "rosbridge:1" and line["after"] == "stopped" for line in kept)
    others = [line for line in lines if line.get("role") == "guest"]
    assert all(line["client"] and line["address"].startswith("198.51.100.") for line in others)
    counts = [
        line["text"].removeprefix("over the budget: ") for line in lines if line["decision"] == "left out"
    ]
    left_out = sum(int(each.split()[0]) for text in counts for each in text.split(", "))
    assert len(others) + left_out == expected, "each event is written or counted"
