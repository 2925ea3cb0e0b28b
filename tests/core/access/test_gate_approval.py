"""A person's yes: what waits for it, who may give it, for how long it holds, and what becomes of the rest."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rwt import Settings, SettingsError
from rwt.access.errors import GateRefused
from rwt.access.gate.approvals import MAX_OF_CREDENTIAL, MAX_PENDING, Approval
from rwt.access.gate.fields import describe_fields
from rwt.access.gate.record import CALLER, Actor
from rwt.access.settings import FieldLimit
from rwt.rosapi import Rosapi
from rwt_interfaces.payload import Payload
from tests.core.access.gated_robot import FIBONACCI, GatedRobot, call, drive, settings_of
from tests.core.rosbridge.recording_client import Client
from tests.core.rosbridge.test_auth import signed

APPROVAL = {"roles": ["supervisor"], "seconds": 10, "remember_seconds": 60}
DRIVE: Mapping[str, Any] = {"topics": ["/cmd_vel"], "emergency": True, "stop": {}}
GOAL = {"action": "/count", "action_type": FIBONACCI}


class QuietRobot(GatedRobot):
    """A robot whose clients are not told that their requests wait."""

    level = "error"


class AskedRobot(QuietRobot):
    """A robot of which everything needs a yes."""

    def __init__(self, auth: Mapping[str, Any] | None = None, **approval: Any) -> None:
        rule = {
            "services": ["/blink"],
            "actions": ["/count"],
            "parameters": ["*limit"],
            "topics": ["/cmd_vel"],
            "approval": {**APPROVAL, **approval},
        }
        super().__init__({"asked": rule}, auth=auth or {})
        self._blinks = self.offer("/blink")
        self._orders, _ = self.accept_goals("/count")
        self.node.parameters.declare("limit", 1.0)

    @property
    def done(self) -> list[object]:
        """What has happened to it."""
        return [*(each.data for each in self._blinks), *self._orders]

    def waiting(self) -> list[Any]:
        """Entries of `/gate/approvals`."""
        return list(self.latest("/gate/approvals").approvals)


@pytest.fixture
def robot() -> AskedRobot:
    return AskedRobot()


@pytest.fixture
def agent(robot: AskedRobot) -> Client:
    return robot.client("agent")


@pytest.fixture
def supervisor(robot: AskedRobot) -> Client:
    return robot.client("supervisor")


def _blink(client: Client, on: bool = True) -> None:
    client.say("call_service", service="/blink", args={"data": on}, id="b")


def _answer(client: Client, id: str, approve: bool = True, seconds: float = 0.0) -> Mapping[str, Any]:
    return call(client, "/gate/approve", id=id, approve=approve, seconds=seconds)


def test_a_call_waits_for_a_yes_and_is_made_then(
    robot: AskedRobot, agent: Client, supervisor: Client
) -> None:
    _blink(agent)
    assert (agent.heard(), robot.done) == ([], [])
    (asked,) = robot.waiting()
    assert (asked.id, asked.act, asked.name, asked.client) == ("1", "call", "/blink", "rosbridge:1")
    assert (asked.rule, asked.role) == ("gate.rules.asked", "agent")
    assert re.fullmatch(r'sha256:[0-9a-f]{16}, 14 bytes; {"data": true}', asked.content)
    message = "approved: call /blink of rosbridge:1 (role agent)"
    assert _answer(supervisor, "1") == {"success": True, "message": message}
    (reply,) = agent.heard()
    assert (reply["id"], reply["result"], robot.done) == ("b", True, [True])
    assert robot.waiting() == []
    # It was for one call.
    _blink(agent)
    assert (len(robot.waiting()), robot.done) == (1, [True])


@pytest.mark.parametrize("how", ["no", "silence", "stopped asking"])
def test_without_a_yes_nothing_happens_and_the_caller_hears_why(
    robot: AskedRobot, agent: Client, supervisor: Client, how: str
) -> None:
    _blink(agent)
    if how == "no":
        assert _answer(supervisor, "1", approve=False)["message"].startswith("denied: ")
    elif how == "silence":
        robot.clock.advance(10)
    else:
        agent.leave()
    assert (robot.waiting(), robot.done) == ([], [])
    assert agent.peer.graph.calls_in_flight == 0
    if how != "stopped asking":
        (reply,) = agent.heard()
        text = {"no": "a person said no", "silence": "no answer within 10 s"}[how]
        assert reply["result"] is False
        assert reply["values"] == f"call /blink: {text} (gate.rules.asked.approval)"
    assert "nothing waits for an answer" in _answer(supervisor, "1")["message"]


def test_who_answers_has_another_token(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("abcdefghijklmnop")
    auth = {"default_role": "supervisor", "rosauth_secret_file": secret}
    robot = AskedRobot(auth=auth, roles=["supervisor"])
    someone, other, supervisor = Client(robot.bridge), Client(robot.bridge), robot.client("supervisor")
    by_auth = Client(robot.bridge)
    by_auth.say("auth", **signed(level="supervisor"))
    for asking in (someone, by_auth, supervisor):
        _blink(asking)
    for id in "123":
        for answering in (someone, other, by_auth):
            for approve in (True, False):
                said = _answer(answering, id, approve=approve)
                assert not said["success"] and "without a token" in said["message"]
    assert "nor one of its token" in _answer(supervisor, "3")["message"]
    assert all(_answer(supervisor, id)["success"] for id in "12")
    assert robot.done == [True, True]


def test_a_client_that_gives_up_its_token_has_asked_with_it(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("abcdefghijklmnop")
    robot = AskedRobot(auth={"rosauth_secret_file": secret}, roles=["supervisor"])
    asking, other = robot.clients("supervisor", "supervisor")
    _blink(asking)
    asking.say("auth", **signed(level="supervisor"))
    assert not _answer(other, "1")["success"] and robot.done == []


def test_the_robot_itself_needs_no_token() -> None:
    robot = AskedRobot(roles=[])
    agent, admin = robot.clients("agent", "admin")
    _blink(agent)
    assert "role 'admin' may not answer" in _answer(admin, "1")["message"]
    type = robot.graph.registry.service("rwt_gate_msgs/Approve")
    request = Payload.from_value(type.request, {"id": "1", "approve": True})
    robot.graph.participant("/own").call_service("/gate/approve", request, lambda _: None)
    assert robot.done == [True]


_BOSS = {"token": "the-token-of-the-boss", "role": "admin"}
_AIDE = {"token": "the-token-of-the-aide", "role": "viewer"}


@pytest.mark.parametrize(
    ("auth", "gateways", "fits"),
    [
        ({}, (), False),
        ({"default_role": "admin"}, (), False),
        ({"tokens": {"aide": _AIDE}, "default_role": "admin"}, (), False),
        # Only the boss may approve, and nobody else can ask.
        ({"tokens": {"boss": _BOSS}}, (), False),
        ({"tokens": {"boss": _BOSS}, "default_role": "viewer"}, (), True),
        ({"tokens": {"boss": _BOSS, "aide": _AIDE}}, (), True),
        ({"tokens": {"boss": _BOSS}, "rosauth_secret_file": "secret"}, (), True),
        # The user of an agent answers.
        ({"tokens": {"boss": _BOSS}}, ("mcp",), True),
        ({}, ("mcp",), True),
        ({"tokens": {"aide": _AIDE}}, ("mcp",), False),
    ],
)
def test_a_rule_that_no_client_can_answer_is_refused(
    auth: dict[str, Any], gateways: tuple[str, ...], fits: bool
) -> None:
    def settings(roles: list[str]) -> Settings:
        rule = {"services": ["/blink"], "approval": {"roles": roles}}
        mcp = {"mcp": {"default_role": "admin"}} if gateways else {}
        return Settings(auth=auth, gateways=gateways, gate={"rules": {"asked": rule}}, **mcp)

    assert settings([]).gate.rules
    if fits:
        settings(["adm*"])
    else:
        with pytest.raises(
            SettingsError, match=r"gate\.rules\.asked\.approval\.roles`: no client can approve"
        ):
            settings(["adm*"])


def test_who_answers_is_a_role_that_may_and_not_the_one_who_asks() -> None:
    robot = AskedRobot(roles=["agent", "supervisor"])
    agent, operator, other, supervisor = robot.clients("agent", "operator", "agent", "supervisor")
    _blink(agent)
    assert "a client may not answer its own request" in _answer(agent, "1")["message"]
    assert "role 'operator' may not answer" in _answer(operator, "1")["message"]
    assert "nor one of its token" in _answer(other, "1")["message"]
    assert robot.done == []
    assert _answer(supervisor, "1")["success"]


def test_a_yes_may_hold_for_a_while(robot: AskedRobot, agent: Client, supervisor: Client) -> None:
    _blink(agent)
    assert "at most 60 s here, got 61" in _answer(supervisor, "1", seconds=61)["message"]
    assert _answer(supervisor, "1", seconds=60)["success"]
    _blink(agent)
    assert robot.done == [True, True]
    # Nobody else has it.
    _blink(robot.client("agent"))
    assert len(robot.waiting()) == 1
    robot.clock.advance(60)
    _blink(agent)
    assert robot.done == [True, True]


def test_a_goal_waits_and_runs_then(robot: AskedRobot, agent: Client, supervisor: Client) -> None:
    goal = {**GOAL, "args": {"order": 3}}
    agent.say("send_action_goal", id="g", **goal)
    assert (robot.done, agent.heard()) == ([], [])
    assert _answer(supervisor, "1")["success"]
    assert robot.done == [3]
    agent.say("send_action_goal", id="h", **goal)
    agent.say("cancel_action_goal", action="/count", id="h")
    (result,) = agent.heard()
    assert (result["id"], result["result"]) == ("h", False)
    assert "cancelled before a person had said yes" in result["values"]
    assert robot.waiting() == []
    agent.say("send_action_goal", id="i", **goal)
    assert not _answer(supervisor, "3", approve=False)["message"].startswith("approved")
    assert "a person said no" in agent.heard()[0]["values"]
    assert robot.done == [3]
    assert agent.peer.actions.goals_running == 1
    agent.say("send_action_goal", id="j", **goal)
    agent.leave()
    assert not _answer(supervisor, "4")["success"]
    assert robot.done == [3]


def test_a_parameter_waits_too_by_whichever_service_it_is_set(
    robot: AskedRobot, agent: Client, supervisor: Client
) -> None:
    value = {"type": 3, "double_value": 2.0}
    for number, service in enumerate(("set_parameters", "set_parameters_atomically"), 1):
        args = {"parameters": [{"name": "limit", "value": value}]}
        agent.say("call_service", service=f"/robot/{service}", args=args)
        assert agent.heard() == []
        (asked,) = robot.waiting()
        assert (asked.act, asked.name) == ("set_param", "/robot:limit")
        assert _answer(supervisor, str(number), approve=False)["success"]
        assert agent.heard()[0]["result"] is False
    assert robot.node.parameters.get("limit") == 1.0
    assert call(agent, "/robot/get_parameters", names=["limit"])


def test_one_yes_is_for_all_parameters_of_a_call(
    robot: AskedRobot, agent: Client, supervisor: Client
) -> None:
    robot.node.parameters.declare("speed_limit", 1.0)
    value = {"type": 3, "double_value": 2.0}
    parameters = [{"name": name, "value": value} for name in ("limit", "speed_limit")]
    agent.say("call_service", service="/robot/set_parameters", args={"parameters": parameters})
    (asked,) = robot.waiting()
    assert asked.name == "/robot:limit, /robot:speed_limit"
    assert _answer(supervisor, "1")["success"]
    assert robot.node.parameters.get("limit") == robot.node.parameters.get("speed_limit") == 2.0


def test_a_message_is_refused_until_somebody_says_yes(
    robot: AskedRobot, agent: Client, supervisor: Client
) -> None:
    text = "publishing on /cmd_vel needs a person's yes, which was asked for under id 1: send it again"
    assert text in drive(agent, 0.1)
    assert text in drive(agent, 0.1)
    assert "and another message waits for it under id 1" in drive(agent, 0.2)
    assert len(robot.waiting()) == 1
    assert _answer(supervisor, "1")["success"]
    assert drive(agent, 0.1) == ""
    assert "under id 2" in drive(agent, 0.1)
    assert _answer(supervisor, "2", seconds=60)["success"]
    assert [drive(agent, 0.1), drive(agent, 0.1)] == ["", ""]
    assert [speed for speed, _ in robot.take()] == [0.1, 0.1, 0.1]
    robot.clock.advance(60)
    assert "under id 3" in drive(agent, 0.1)
    assert _answer(supervisor, "3")["success"]
    robot.clock.advance(10)
    assert "under id 4" in drive(agent, 0.1), "an approval that is not used expires"


@pytest.mark.parametrize("seconds", [0.0, 60.0])
def test_an_approval_is_for_the_message_that_was_shown(
    robot: AskedRobot, agent: Client, supervisor: Client, seconds: float
) -> None:
    drive(agent, 0.01)
    assert _answer(supervisor, "1", seconds=seconds)["success"]
    assert "under id 2" in drive(agent, 99.0)
    assert robot.take() == []
    assert drive(agent, 0.01) == ""
    # The robot can be stopped while an approval lasts.
    assert (drive(agent, 0.0) == "") is bool(seconds)


def test_a_lasting_approval_is_for_the_same_call_and_goal(
    robot: AskedRobot, agent: Client, supervisor: Client
) -> None:
    _blink(agent)
    assert _answer(supervisor, "1", seconds=60)["success"]
    _blink(agent, False)
    agent.say("send_action_goal", id="g", **GOAL, args={"order": 3})
    assert _answer(supervisor, "3", seconds=60)["success"]
    agent.say("send_action_goal", id="h", **GOAL, args={"order": 99})
    assert robot.done == [True, 3]
    agent.say("send_action_goal", id="i", **GOAL, args={"order": 3})
    assert robot.done == [True, 3, 3]


def test_an_approval_is_for_what_remains_after_clamping() -> None:
    limit = {"min": -1, "max": 1, "beyond": "clamp"}
    rule = {"topics": ["/cmd_vel"], "approval": APPROVAL, "fields": {"linear.x": limit}}
    robot = QuietRobot({"asked": rule})
    agent, supervisor = robot.clients("agent", "supervisor")
    drive(agent, 5.0)
    (asked,) = robot.gate.approvals.pending
    assert "; linear.x = 1.0; {" in asked.content
    assert _answer(supervisor, "1")["success"]
    assert drive(agent, 7.0) == ""
    assert [speed for speed, _ in robot.take()] == [1.0]


def test_an_approval_does_not_hold_for_another_role_of_the_client(
    robot: AskedRobot, agent: Client, supervisor: Client
) -> None:
    drive(agent, 0.1)
    assert _answer(supervisor, "1", seconds=60)["success"]
    agent.peer.take_role(robot.access.admission.roles["operator"])
    assert "under id 2" in drive(agent, 0.1)
    assert robot.take() == []


def test_an_emergency_stop_ends_requests_and_approvals() -> None:
    robot = QuietRobot({"asked": {**DRIVE, "approval": APPROVAL}})
    one, two, admin, supervisor = robot.clients("agent", "agent", "admin", "supervisor")
    drive(one, 0.1)
    drive(two, 0.1)
    assert _answer(supervisor, "1", seconds=60)["success"]
    call(admin, "/gate/stop")
    assert robot.gate.approvals.pending == ()
    call(admin, "/gate/release_stop")
    robot.clock.advance(2)
    assert "under id 3" in drive(one, 0.1)


def test_a_yes_that_comes_while_the_robot_is_stopped_starts_nothing() -> None:
    asked = {"services": ["/blink"], "approval": APPROVAL, "emergency": True}
    robot = QuietRobot({"asked": asked, "drive": DRIVE})
    done = robot.offer("/blink")
    agent, supervisor = robot.clients("agent", "supervisor")
    _blink(agent)
    call(supervisor, "/gate/stop")
    _answer(supervisor, "1")
    (reply,) = agent.heard()
    assert (reply["result"], done) == (False, [])
    assert "the emergency stop is on" in reply["values"]


def test_a_yes_for_a_client_whose_right_is_gone_starts_nothing(
    robot: AskedRobot, agent: Client, supervisor: Client
) -> None:
    _blink(agent)
    agent.peer.graph.take_role(robot.access.admission.roles["viewer"])
    _answer(supervisor, "1")
    (reply,) = agent.heard()
    assert (reply["result"], robot.done) == (False, [])
    assert "call /blink: the client has another role now" in reply["values"]


def test_a_yes_for_a_service_that_has_another_type_now_starts_nothing(
    robot: AskedRobot, agent: Client, supervisor: Client
) -> None:
    _blink(agent)
    done = robot.offer("/blink", type="std_srvs/Trigger")
    _answer(supervisor, "1")
    assert "/blink is of another type now" in agent.heard()[0]["values"]
    assert (robot.done, done) == ([], [])


def test_requests_of_one_credential_do_not_take_the_slots_of_others() -> None:
    rules = {name: {"services": [f"/{name}"], "approval": APPROVAL} for name in ("blink", "time")}
    robot = QuietRobot(rules)
    robot.offer("/blink", "/time")
    agents = [robot.client("agent") for _ in range(10)]
    for agent in agents:
        for _ in range(MAX_OF_CREDENTIAL):
            _blink(agent)
    assert len(robot.gate.approvals.pending) == MAX_OF_CREDENTIAL
    assert agents[0].peer.graph.calls_in_flight == MAX_OF_CREDENTIAL
    assert f"{MAX_OF_CREDENTIAL} requests of this client wait" in agents[1].heard()[0]["values"]
    _blink(robot.client("operator"))
    agents[0].say("call_service", service="/time", args={"data": True})
    assert len(robot.gate.approvals.pending) == MAX_OF_CREDENTIAL + 2
    for agent in agents:
        agent.leave()
    assert len(robot.gate.approvals.pending) == 1


class ManyRequests:
    """Pending requests of clients at different addresses, without a server.

    Attributes:
        robot: robot whose first rule requires approval.
        approvals: requests of its gate.
    """

    def __init__(self) -> None:
        asked = {"services": ["/blink"], "approval": APPROVAL, "emergency": True}
        self.robot = QuietRobot({"asked": asked, "drive": DRIVE})
        self.approvals = self.robot.gate.approvals
        self._rule = self.robot.gate.rules.all[0]
        type = self.robot.graph.registry.service("std_srvs/SetBool")
        self._payload = Payload.from_value(type.request, {})
        self._actors: dict[str, Actor] = {}

    def ask(self, address: str) -> Approval:
        """Request approval for a client of an address."""
        if address not in self._actors:
            role = self.robot.access.admission.roles["agent"]
            self._actors[address] = self.robot.gate.join("", role, address)
        actor = self._actors[address]
        subject = self.approvals.subject(actor, "call", "/blink", self._rule, self._payload)
        return self.approvals.ask(subject, self._rule, self._payload)


def test_a_request_finds_room_where_others_have_many() -> None:
    requests = ManyRequests()
    many = [requests.ask(f"10.0.{number // 20}.1") for number in range(MAX_PENDING)]
    few = [requests.ask("10.1.0.1") for _ in range(MAX_OF_CREDENTIAL - 1)]
    assert all(each.is_pending for each in few)
    assert len(requests.approvals.pending) == MAX_PENDING
    assert sum(each.is_pending for each in many) == MAX_PENDING - len(few)
    with pytest.raises(GateRefused, match="1000 requests wait"):
        requests.ask("10.1.0.1")
    requests.robot.gate.stop(None)
    assert len(requests.approvals.pending) > MAX_PENDING - 300, "a stop denies them in turns"
    requests.robot.clock.advance(0.001)
    assert requests.approvals.pending == ()


def test_the_topic_lists_a_bounded_number_of_requests_of_each_credential_some() -> None:
    requests = ManyRequests()
    for number in range(400):
        requests.ask(f"10.0.{number // 20}.1")
    last = requests.ask("10.9.9.9")
    listed = requests.approvals.listed(100)
    assert len(listed) == 100
    assert last in listed
    assert [int(each.id) for each in listed] == sorted(int(each.id) for each in listed)


def test_the_topic_of_requests_is_bounded_in_size_and_rate() -> None:
    robot = GatedRobot({"asked": {"parameters": ["*"], "approval": APPROVAL}}, "noetic")
    Rosapi(robot.graph)
    heard = robot.hear("/gate/approvals", "rwt_gate_msgs/Approvals")
    robot.clock.advance(1.0)
    heard.clear()
    client = robot.client()
    for number in range(100):
        table = json.dumps({f"{key}{'k' * 80}": key for key in range(900)})
        client.say("call_service", service="/rosapi/set_param", args={"name": f"/{number}", "value": table})
        robot.clock.advance(0.01)
    assert 1 <= len(heard) <= 11
    (request, *_) = heard[-1].approvals
    assert len(request.name) < 600
    assert len(request.content) < 3000


@settings(max_examples=60, deadline=None)
@example(name="x" * 5000, x=99.0)
@example(name='a", x = 0.1; {"x":0.1}\u202e\u2028\n', x=99.0)
@given(name=st.text(max_size=300), x=st.floats(-100, 100, width=32))
def test_any_request_is_shown_with_its_own_values_first(name: str, x: float) -> None:
    """A reader that parses the text finds the values that the robot will receive, and no others."""
    fields = {"x": {"max": 100}, "name": {"one_of": ["turtle"]}}
    rules = {
        "asked": {"services": ["/spawn"], "roles": ["agent"], "approval": APPROVAL},
        "limits": {"services": ["/spawn"], "roles": ["operator"], "fields": fields},
    }
    robot = QuietRobot(rules)
    robot.offer("/spawn", type="turtlesim/Spawn")
    robot.client("agent").say("call_service", service="/spawn", args={"name": name, "x": x})
    (asked,) = robot.gate.approvals.pending
    found = re.match(r"sha256:[0-9a-f]{16}, \d+ bytes; x = ([^,;]+), name = ", asked.content)
    assert found is not None and float(found[1]) == x
    shown, end = json.JSONDecoder().raw_decode(asked.content, found.end())
    assert shown == name[:100]
    assert asked.content[end:].startswith('; {"x":')
    assert asked.content.isprintable() and len(asked.content) < 4000
    assert asked.content.endswith(" (cut off)") or len(name) < 2000


def test_very_long_lists_are_not_described_value_by_value() -> None:
    limit = FieldLimit.model_validate({"max": 1})
    type = GatedRobot({}).graph.registry.message("std_msgs/Float64MultiArray")
    for length, text in (
        (3, "data[] = 0.0 to 2.0 (3 values)"),
        (20_000, "data[] has more than 10000 values"),
    ):
        payload = Payload.from_value(type, {"data": [0.0] * (length - 1) + [2.0]})
        assert describe_fields(payload, {"data[]": limit}) == text


@pytest.mark.parametrize("act", ["publish", "call"])
def test_a_member_that_occurs_twice_is_approved_and_sent_once(
    robot: AskedRobot, agent: Client, supervisor: Client, act: str
) -> None:
    sent: list[bytes] = []
    type = robot.graph.registry.message("geometry_msgs/Twist")
    robot.graph.participant("/reader").subscribe(
        "/cmd_vel", lambda sample: sent.append(bytes(sample.payload.json())), type
    )
    twice = '{"linear":{"x":9.0,"y":0.0,"z":0.0,"x":0.1},"angular":{"x":0.0,"y":0.0,"z":0.0}}'
    ops = {
        "publish": f'{{"op":"publish","topic":"/cmd_vel","type":"geometry_msgs/Twist","msg":{twice}}}',
        "call": '{"op":"call_service","service":"/blink","args":{"data":true,"data":false}}',
    }
    agent.say_raw(ops[act])
    (asked,) = robot.gate.approvals.pending
    assert ("9.0" in asked.content, "true" in asked.content) == (False, False)
    _answer(supervisor, "1")
    agent.say_raw(ops[act])
    assert all(b"9.0" not in each for each in sent)
    assert len(sent) == (act == "publish")


_ASKED: Mapping[str, Any] = {"services": ["/spawn", "/blink"], "approval": APPROVAL}
_LIMITS: Mapping[str, Any] = {"services": ["/spawn"], "fields": {"x": {"max": 1}}}


@pytest.mark.parametrize(
    ("after", "kept"),
    [
        ({"asked": _ASKED}, ["/spawn", "/blink"]),
        ({"asked": _ASKED, "other": {"topics": ["/cmd_vel"], "stop": {}}}, ["/spawn", "/blink"]),
        ({"asked": _ASKED, "limits": _LIMITS}, ["/blink"]),
        ({"asked": _ASKED, "limits": {**_LIMITS, "roles": ["operator"]}}, ["/blink"]),
        ({"asked": _ASKED, "twice": {"services": ["/spawn"], "approval": APPROVAL}}, ["/blink"]),
        ({"asked": {**_ASKED, "services": ["/blink"]}}, []),
        ({"asked": {**_ASKED, "approval": {**APPROVAL, "roles": ["operator"]}}}, []),
        ({"asked": {**_ASKED, "finite": False}}, []),
        ({"asked": {**_ASKED, "roles": ["operator"]}}, []),
        ({"limits": _LIMITS}, []),
    ],
)
def test_a_reload_denies_requests_that_a_changed_rule_would_check(
    after: Mapping[str, Any], kept: list[str]
) -> None:
    robot = QuietRobot({"asked": _ASKED})
    done = robot.offer("/spawn", type="turtlesim/Spawn")
    done_too = robot.offer("/blink")
    agent, supervisor = robot.clients("agent", "supervisor")
    agent.say("call_service", service="/spawn", args={"x": 99.0})
    _blink(agent)
    robot.access.reload(settings_of({"rules": after}))
    assert [each.name for each in robot.gate.approvals.pending] == kept
    answered = [_answer(supervisor, id)["success"] for id in ("1", "2")]
    assert answered == ["/spawn" in kept, "/blink" in kept]
    assert len(done) + len(done_too) == len(kept)


def test_two_rules_want_a_yes_each() -> None:
    rule = {"services": ["/blink"], "approval": APPROVAL}
    robot = QuietRobot({"one": rule, "two": {**rule, "approval": {"roles": ["admin"]}}})
    done = robot.offer("/blink")
    agent, supervisor, admin = robot.clients("agent", "supervisor", "admin")
    _blink(agent)
    assert _answer(supervisor, "1")["success"]
    assert (done, agent.heard()) == ([], [])
    assert "gate.rules.two" in _answer(supervisor, "2")["message"]
    assert _answer(admin, "2")["success"]
    assert len(done) == 1


def test_observing_asks_nobody() -> None:
    rule = {"services": ["/blink"], "topics": ["/cmd_vel"], "approval": APPROVAL}
    robot = QuietRobot({"asked": rule}, mode="observe")
    robot.offer("/blink")
    client = robot.client("agent")
    assert call(client, "/blink", data=True)["success"]
    assert drive(client, 0.3) == ""
    assert robot.gate.approvals.pending == ()


def test_what_a_yes_sets_off_is_not_done_by_who_says_it(
    robot: AskedRobot, agent: Client, supervisor: Client
) -> None:
    callers: list[object] = []
    robot.graph.participant("/late").advertise_service(
        "/blink", robot.graph.registry.service("std_srvs/SetBool"), lambda _: callers.append(CALLER.get())
    )
    _blink(agent)
    assert _answer(supervisor, "1")["success"]
    assert callers == [None]
