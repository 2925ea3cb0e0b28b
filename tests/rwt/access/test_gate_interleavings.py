"""Whatever several clients do in whatever order: no message of one that does not hold the lease is heard."""

from __future__ import annotations

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, initialize, invariant, rule

from tests.rwt.access.gated_robot import CLIENT, GATE, GatedRobot, call, drive
from tests.rwt.gateways.rosbridge.recording_client import Client

pytestmark = pytest.mark.slow

SECONDS = 0.5
PRECEDENCE = ("supervisor", "operator")
ROLES = ("agent", "operator", "supervisor")
REST = 1.0


class Interleavings(RuleBasedStateMachine):
    """A robot behind a gate, with a second opinion on who holds the lease, kept by the words of the docs."""

    clients = Bundle("clients")

    @initialize(take=st.sampled_from(["publish", "service"]))
    def start(self, take: str) -> None:
        self.by_service = take == "service"
        lease = {"seconds": SECONDS, "take": take, "precedence": PRECEDENCE}
        rules = {"topics": ["/cmd_vel"], "lease": lease, "stop": {}, "emergency": True}
        self.robot = GatedRobot({"drive": rules}, emergency={"release_roles": ["*"]})
        self.now = 0.0
        self.holder: Client | None = None
        self.heard_at = 0.0
        self.stopped = False
        self.refused_while_stopped: dict[Client, float] = {}
        self.said = 0
        self.roles: dict[Client, str] = {}
        # So that the type is known before anybody has published.
        self.robot.node.advertise("/cmd_vel", "geometry_msgs/Twist")

    def _rank(self, client: Client) -> int:
        role = self.roles[client]
        return PRECEDENCE.index(role) if role in PRECEDENCE else len(PRECEDENCE)

    def _may_take(self, client: Client) -> bool:
        return client is self.holder or self.holder is None or self._rank(client) < self._rank(self.holder)

    def _lose(self) -> None:
        self.holder = None
        assert self.robot.heard[-1:] == [(0.0, GATE)], "a lease is lost, and the robot was not told to stop"

    @rule(target=clients, role=st.sampled_from(ROLES))
    def connect(self, role: str) -> Client:
        client = self.robot.client(role)
        self.roles[client] = role
        return client

    @rule(client=clients, is_stop=st.booleans())
    def publish(self, client: Client, is_stop: bool) -> None:
        self.said += 1
        speed = 0.0 if is_stop else float(self.said)
        self.robot.take()
        refusal = drive(client, speed)
        passes = not self.stopped
        passes &= client is self.holder or (self._may_take(client) and not self.by_service)
        refused_at = self.refused_while_stopped.get(client)
        if self.stopped:
            self.refused_while_stopped[client] = self.now
        elif refused_at is not None:
            if self.now - refused_at < REST - 1e-9 and not is_stop:
                passes = False
                self.refused_while_stopped[client] = self.now
            else:
                del self.refused_while_stopped[client]
        assert self.robot.take() == ([(speed, CLIENT)] if passes else [])
        assert bool(refusal) is not passes
        if passes:
            self.holder, self.heard_at = client, self.now

    @rule(client=clients)
    def take(self, client: Client) -> None:
        before = self.holder
        answer = call(client, "/gate/take_lease", topic="/cmd_vel")
        assert answer["success"] is (not self.stopped and self._may_take(client)), answer
        if answer["success"]:
            self.holder, self.heard_at = client, self.now
            if before not in (None, client):
                assert self.robot.heard[-1] == (0.0, GATE)
        expected = self.holder.peer.graph.gate_name if self.holder else ""
        assert answer["holder"] == expected

    @rule(client=clients)
    def give_back(self, client: Client) -> None:
        answer = call(client, "/gate/release_lease", topic="/cmd_vel")
        assert answer["success"] is (client is self.holder)
        if answer["success"]:
            self._lose()

    @rule(client=clients, other=clients)
    def pass_on(self, client: Client, other: Client) -> None:
        answer = call(client, "/gate/pass_lease", topic="/cmd_vel", to=other.peer.graph.gate_name)
        assert answer["success"] is (client is self.holder)
        if answer["success"]:
            if other is not client:
                assert self.robot.heard[-1] == (0.0, GATE)
            self.holder, self.heard_at = other, self.now

    @rule(client=consumes(clients))
    def leave(self, client: Client) -> None:
        client.leave()
        self.refused_while_stopped.pop(client, None)
        if client is self.holder:
            self._lose()

    @rule(client=clients)
    def stop(self, client: Client) -> None:
        was_stopped = self.stopped
        assert call(client, "/gate/stop", reason="test")["success"]
        self.stopped = True
        assert was_stopped or self.robot.heard[-1] == (0.0, GATE)
        self.holder = None

    @rule(client=clients)
    def release(self, client: Client) -> None:
        assert call(client, "/gate/release_stop", reason="test")["success"]
        self.stopped = False

    @rule(milliseconds=st.integers(1, 1500))
    def wait(self, milliseconds: int) -> None:
        self.robot.take()
        # In whole steps: the clock counts nanoseconds, and this opinion does not round.
        for _ in range(milliseconds):
            self.robot.clock.advance(0.001)
            self.now = self.robot.clock.monotonic()
            if self.holder is not None and self.now >= self.heard_at + SECONDS - 1e-9:
                self._lose()
        assert all(node == GATE for _, node in self.robot.heard)

    @invariant()
    def the_gate_agrees_on_who_holds_it(self) -> None:
        holders = [topic.lease.holder for topic in self.robot.gate.topics if topic.lease]
        name = self.holder.peer.graph.gate_name if self.holder else None
        assert [each.name if each else None for each in holders] == [name] or not holders


TestInterleavings = Interleavings.TestCase
TestInterleavings.settings = settings(max_examples=40, stateful_step_count=40, deadline=None)
