"""Leases: one client at a time drives, and the robot stands when that falls silent, leaves or gives it up."""

from __future__ import annotations

from typing import Any

import pytest

from rwt.access.gate.gate import MAX_LEASES
from rwt.access.gate.node import MAX_LISTED, REQUEST_SECONDS
from rwt.access.roles import Role
from rwt.access.settings import RoleSettings
from rwt_participant.qos import LATCHED
from tests.core.access.gated_robot import CLIENT, DRIVE, GATE, TWIST, GatedRobot, call, drive
from tests.core.rosbridge.recording_client import Client

STOPS = [(0.0, GATE)]


def _leases(robot: GatedRobot) -> list[tuple[str, str]]:
    """Return the current entries of `/gate/leases`: topics and holders."""
    return [(each.topic, each.holder) for each in _heard(robot)]


def _heard(robot: GatedRobot, seconds: float = 0.0) -> list[Any]:
    """Leases that `/gate/leases` lists after some time."""
    leases: list[Any] = robot.latest("/gate/leases", seconds).leases
    return leases


@pytest.fixture
def robot() -> GatedRobot:
    return GatedRobot({"drive": DRIVE})


@pytest.fixture
def client(robot: GatedRobot) -> Client:
    return robot.client()


def test_without_rules_there_is_no_gate() -> None:
    robot = GatedRobot({})
    assert robot.access.gate is None
    assert robot.graph.service("/gate/stop") is None
    assert drive(robot.client(), 1.0) == ""
    assert robot.take() == [(1.0, CLIENT)]


def test_who_publishes_first_holds_it_and_others_hear_who_does(robot: GatedRobot) -> None:
    first, second = robot.client(), robot.client()
    assert drive(first, 0.3) == ""
    refused = drive(second, -0.3)
    assert "/cmd_vel is held by rosbridge:1 (role operator) (gate.rules.drive.lease)" in refused
    assert robot.take() == [(0.3, CLIENT)]
    robot.clock.advance(0.01)
    assert _leases(robot) == [("/cmd_vel", "rosbridge:1")]


@pytest.mark.parametrize("spelling", ["cmd_vel", "//cmd_vel/", "/cmd_vel"])
def test_another_spelling_is_the_same_topic(spelling: str) -> None:
    robot = GatedRobot({"drive": DRIVE})
    drive(robot.client(), 0.3)
    assert "is held by" in drive(robot.client(), -0.3, spelling)
    assert robot.take() == [(0.3, CLIENT)]


def test_silence_stops_the_robot_within_the_leases_time_and_again_until_its_own_time_out() -> None:
    robot = GatedRobot({"drive": {**DRIVE, "stop": {"repeat_seconds": 1.0}}})
    client = robot.client()
    for _ in range(10):
        drive(client, 0.5)
        robot.clock.advance(0.4)
    assert {node for _, node in robot.take()} == {CLIENT}
    robot.clock.advance(0.099)
    assert robot.take() == []
    robot.clock.advance(0.001)
    assert robot.take() == STOPS
    robot.clock.advance(1.5)
    repeated = robot.take()
    assert repeated == STOPS * 10
    stamps = [sample.stamp_ns for sample in robot.samples if sample.node == GATE]
    assert 0.9 <= (stamps[-1] - stamps[0]) / 1e9 <= 1.0
    assert drive(robot.client(), 0.1) == ""


def test_a_message_of_the_next_holder_ends_the_stop_messages(robot: GatedRobot, client: Client) -> None:
    drive(client, 0.5)
    robot.clock.advance(0.6)
    drive(robot.client(), 0.2)
    robot.take()
    robot.clock.advance(0.4)
    assert robot.take() == []


@pytest.mark.parametrize("how", ["connection lost", "unadvertised", "a role that may not publish"])
def test_a_holder_that_goes_stops_the_robot_at_once(robot: GatedRobot, client: Client, how: str) -> None:
    client.say("advertise", topic="/cmd_vel", type=TWIST, id="a")
    drive(client, 0.5)
    if how == "connection lost":
        client.leave()
    elif how == "unadvertised":
        client.say("unadvertise", topic="/cmd_vel", id="a")
    else:
        client.peer.take_role(robot.access.admission.roles["viewer"])
    assert robot.take() == [(0.5, CLIENT), (0.0, GATE)]
    assert drive(robot.client(), 0.1) == ""


def test_by_service_it_is_taken_given_back_and_passed_on() -> None:
    robot = GatedRobot({"drive": {**DRIVE, "lease": {"take": "service"}}})
    one, two = robot.client(), robot.client()
    assert "take it by /gate/take_lease first (gate.rules.drive.lease.take)" in drive(one, 0.5)
    assert call(one, "/gate/take_lease", topic="cmd_vel") == {
        "success": True, "message": "", "client": "rosbridge:1", "holder": "rosbridge:1", "seconds": 0.5,
    }  # fmt: skip
    assert drive(one, 0.5) == ""
    refused = call(two, "/gate/take_lease", topic="/cmd_vel")
    assert (refused["success"], refused["client"]) == (False, "rosbridge:2")
    assert "held by rosbridge:1" in refused["message"]
    assert not call(two, "/gate/pass_lease", topic="/cmd_vel", to="rosbridge:2")["success"]
    assert not call(two, "/gate/release_lease", topic="/cmd_vel")["success"]
    assert robot.take() == [(0.5, CLIENT)]
    assert "no client 'nobody'" in call(one, "/gate/pass_lease", topic="/cmd_vel", to="nobody")["message"]
    assert call(one, "/gate/pass_lease", topic="/cmd_vel", to="rosbridge:2")["success"]
    assert robot.take() == STOPS
    assert "held by rosbridge:2" in drive(one, 0.5)
    assert drive(two, 0.7) == ""
    assert call(two, "/gate/release_lease", topic="/cmd_vel")["success"]
    assert robot.take() == [(0.7, CLIENT), (0.0, GATE)]
    assert "take it by /gate/take_lease first" in drive(two, 0.5)


def test_a_stronger_role_takes_it_from_a_weaker_one() -> None:
    rule = {**DRIVE, "lease": {"precedence": ["supervisor", "operator"]}}
    robot = GatedRobot({"drive": rule})
    agent, operator, supervisor = (robot.client(role) for role in ("agent", "operator", "supervisor"))
    assert drive(agent, 0.1) == ""
    assert drive(operator, 0.2) == ""
    assert "held by rosbridge:2 (role operator)" in drive(agent, 0.3)
    assert drive(supervisor, 0.4) == ""
    assert "held by rosbridge:3 (role supervisor)" in drive(operator, 0.5)
    other = robot.client("supervisor")
    assert "held by rosbridge:3" in drive(other, 0.6)
    assert [speed for speed, _ in robot.take()] == [0.1, 0.2, 0.4]


def test_who_takes_it_from_another_by_service_stops_what_that_one_said_last() -> None:
    robot = GatedRobot({"drive": {**DRIVE, "lease": {"precedence": ["supervisor"]}}})
    drive(robot.client(), 0.5)
    assert call(robot.client("supervisor"), "/gate/take_lease", topic="/cmd_vel")["success"]
    assert robot.take() == [(0.5, CLIENT), (0.0, GATE)]


def test_a_role_that_may_not_publish_gets_no_lease(robot: GatedRobot) -> None:
    viewer = robot.client("agent")
    viewer.peer.graph.take_role(robot.access.admission.roles["viewer"])
    answer = call(viewer, "/gate/take_lease", topic="/cmd_vel")
    assert "role 'viewer' may not publish on /cmd_vel (roles.viewer.publish)" in answer["message"]
    holder = robot.client()
    drive(holder, 0.5)
    viewer.peer.graph.take_role(robot.access.admission.roles["agent"])
    viewers = robot.client()
    viewers.peer.graph.take_role(robot.access.admission.roles["viewer"])
    assert not call(holder, "/gate/pass_lease", topic="/cmd_vel", to="rosbridge:3")["success"]


def test_a_rule_for_some_roles_leaves_the_others_alone() -> None:
    robot = GatedRobot({"drive": {**DRIVE, "roles": ["agent"]}})
    assert drive(robot.client("agent"), 0.1) == ""
    assert "is held by" in drive(robot.client("agent"), 0.1)
    assert drive(robot.client("operator"), 0.2) == ""


def test_messages_that_are_refused_keep_no_lease() -> None:
    robot = GatedRobot({"drive": {**DRIVE, "fields": {"linear.x": {"max": 0.5}}}})
    client = robot.client()
    drive(client, 0.5)
    for _ in range(5):
        robot.clock.advance(0.1)
        assert "linear.x: expected at most 0.5, got 0.9 (gate.rules.drive.fields)" in drive(client, 0.9)
    assert robot.take()[-1] == (0.0, GATE)


def test_a_stop_message_that_does_not_fit_the_type_is_an_error_of_the_settings() -> None:
    wrong = {**DRIVE, "stop": {"message": {"linear": {"x": "slow"}}}}
    with pytest.raises(ValueError, match=r"`gate.rules.drive.stop.message`: .*linear.x"):
        GatedRobot({"drive": wrong})
    # Of a topic that is not there yet, the first message finds it, and none passes.
    robot = GatedRobot({"drive": {**wrong, "topics": ["/later"]}})
    client = robot.client("admin")
    assert "gate.rules.drive.stop.message" in drive(client, 0.1, "/later")
    assert "gate.rules.drive.stop.message" in drive(client, 0.0, "/later")


def test_a_stop_message_is_stamped_and_says_what_the_setting_says() -> None:
    rule = {
        "topics": ["/target"], "lease": {},
        "stop": {"message": {"header": {"frame_id": "base_link"}, "twist": {"angular": {"z": -0.0}}}},
    }  # fmt: skip
    robot = GatedRobot({"drive": rule})
    heard = robot.hear("/target", "geometry_msgs/TwistStamped")
    client = robot.client()
    client.say(
        "publish", topic="/target", type="geometry_msgs/TwistStamped", msg={"twist": {"linear": {"x": 1}}}
    )
    robot.clock.advance(0.5)
    assert [each.twist.linear.x for each in heard] == [1.0, 0.0]
    assert heard[-1].header.frame_id == "base_link"
    assert heard[-1].header.stamp.sec == 1_700_000_000


def test_observing_refuses_nothing_stops_nothing_and_says_what_it_would_have(caplog: Any) -> None:
    robot = GatedRobot({"drive": DRIVE}, mode="observe")
    with caplog.at_level("INFO", "rwt.bridge"):
        assert drive(robot.client(), 0.5) == ""
        assert drive(robot.client(), -0.5) == ""
        robot.clock.advance(5.0)
    assert robot.take() == [(0.5, CLIENT), (-0.5, CLIENT)]
    assert (
        "gate: would refuse: publish /cmd_vel by rosbridge:2 (role operator): /cmd_vel is held by"
        in caplog.text
    )


def test_a_client_cannot_speak_for_the_gate(robot: GatedRobot) -> None:
    client = robot.client("admin")
    client.say("publish", topic="/gate/leases", type="rwt_gate_msgs/Leases", msg={})
    client.say("advertise", topic="gate/stopped", type="rwt_gate_msgs/EmergencyStop")
    client.say("advertise_service", service="/gate/stop", type="rwt_gate_msgs/Stop")
    client.say("advertise_action", action="/gate/stop", type="example_interfaces/Fibonacci")
    assert [each["level"] for each in client.heard()] == ["error"] * 4
    info = robot.graph.service("/gate/stop")
    assert info is not None and info.node == GATE


def test_a_topic_that_a_stop_is_for_is_not_latched_by_clients(robot: GatedRobot, client: Client) -> None:
    for fields in ({"latch": True}, {"qos": {"durability": "transient_local"}}):
        client.say("advertise", topic="/cmd_vel", type=TWIST, **fields)
        client.say("publish", topic="/cmd_vel", type=TWIST, msg={}, **fields)
        refused = [each["msg"] for each in client.heard() if each["level"] == "error"]
        assert len(refused) == 2
        assert all("/cmd_vel may not be latched" in text for text in refused)
    assert robot.take() == []
    client.say("advertise", topic="/other", type=TWIST, latch=True)
    assert client.heard() == []


def test_only_roles_that_may_see_a_topic_are_told_who_holds_it() -> None:
    robot = GatedRobot({"drive": DRIVE, "all": {"topics": ["/arm/*"], "lease": {}, "stop": {}}})
    holder, spy = robot.client(), robot.client("agent")
    drive(holder, 0.1)
    robot.clock.advance(0.001)
    spy.peer.graph.take_role(Role("spy", RoleSettings(subscribe=("/gate/*", "/arm/*"))))
    answer = call(spy, "/gate/take_lease", topic="/cmd_vel")
    assert (answer["success"], answer["holder"]) == (False, "")
    assert "rosbridge" not in answer["message"]
    spy.say("subscribe", topic="/gate/leases")
    assert "may not see /cmd_vel, whose holder /gate/leases names" in str(spy.heard())
    for hidden in ("/arm/x", "/arm/x*", "/arm/?"):
        spy.peer.graph.take_role(Role("spy", RoleSettings(subscribe=("/gate/*", "/cmd_vel", hidden))))
        spy.say("subscribe", topic="/gate/leases")
        assert "may not see /arm/*" in str(spy.heard()), hidden
    spy.peer.graph.take_role(Role("spy", RoleSettings(subscribe=("/gate/*", "/cmd_vel", "/arm/*"))))
    spy.say("subscribe", topic="/gate/leases")
    assert "rosbridge:1" in str(spy.heard())


def test_the_clients_of_one_credential_hold_a_bounded_number_of_leases() -> None:
    robot = GatedRobot({"drive": {**DRIVE, "topics": ["/x/*"], "lease": {"seconds": 5}}})
    names = [f"/x/{number}" for number in range(MAX_LEASES + 1)]
    for name in names:
        robot.node.advertise(name, TWIST)
    one, two, other = robot.clients("operator", "operator", "agent")
    for number, name in enumerate(names[:-1]):
        assert drive((one, two)[number % 2], 0.1, name) == ""
    assert "clients of this credential hold 64 leases" in drive(one, 0.1, names[-1])
    assert "hold 64 leases" in call(two, "/gate/take_lease", topic=names[-1])["message"]
    assert drive(other, 0.1, names[-1]) == ""
    two.leave()
    assert drive(one, 0.1, names[1]) == ""


def test_messages_about_leases_are_bounded_in_size_and_rate() -> None:
    robot = GatedRobot({"drive": {**DRIVE, "topics": ["/x/*", "/cmd_vel"], "lease": {"seconds": 60}}})
    client = robot.client("admin")
    for number in range(MAX_LISTED + 50):
        client.say("advertise", topic=f"/x/{number}", type=TWIST)
    robot.clock.advance(1)
    heard = robot.hear("/gate/leases", "rwt_gate_msgs/Leases", qos=LATCHED)
    heard.clear()
    drive(client, 0.1)
    robot.clock.advance(0.001)
    (first,) = heard  # Without delay.
    assert len(first.leases) == MAX_LISTED
    assert (first.leases[0].topic, first.leases[0].holder) == ("/cmd_vel", "rosbridge:1")
    for _ in range(100):
        call(client, "/gate/release_lease", topic="/cmd_vel")
        call(client, "/gate/take_lease", topic="/cmd_vel")
        robot.clock.advance(0.01)
    assert 10 <= len(heard) <= 12
    robot.clock.advance(0.1)
    assert heard[-1].leases[0].holder == "rosbridge:1"


def test_people_recognise_the_holder_and_who_asks_for_the_lease(robot: GatedRobot) -> None:
    phone = "Mozilla/5.0 (Android 14; Mobile; rv:130.0) Gecko/130.0 Firefox/130.0"
    one = robot.client("operator", user_agent=phone)
    two = robot.client("admin", user_agent="<b>Admin</b>")
    drive(one, 0.1)
    assert call(two, "/gate/request_lease", topic="/cmd_vel")["success"]
    assert "take it" in call(one, "/gate/request_lease", topic="/cmd_vel")["message"]
    (held,) = _heard(robot, 0.2)
    assert (held.holder, held.user, held.device) == ("rosbridge:1", "operator", "Firefox, Android")
    (request,) = held.requests
    # A header can say anything: only known names are shown.
    assert (request.client, request.user, request.device) == ("rosbridge:2", "admin", "127.0.0.1")
    assert call(one, "/gate/pass_lease", topic="/cmd_vel", to=request.client)["success"]
    (held,) = _heard(robot, 0.2)
    assert (held.user, held.requests) == ("admin", [])


def test_requests_for_a_lease_expire_and_end_with_their_client() -> None:
    robot = GatedRobot({"drive": {**DRIVE, "lease": {"seconds": 60}}})
    holder, asking, leaving = robot.client(), robot.client("admin"), robot.client("operator")
    drive(holder, 0.1)
    for client in (asking, asking, leaving):
        assert call(client, "/gate/request_lease", topic="/cmd_vel")["success"]
    assert [each.client for each in _heard(robot, 0.2)[0].requests] == ["rosbridge:2", "rosbridge:3"]
    leaving.leave()
    assert call(asking, "/gate/request_lease", topic="/cmd_vel")["success"]
    assert [each.client for each in _heard(robot, 0.2)[0].requests] == ["rosbridge:2"]
    assert _heard(robot, REQUEST_SECONDS)[0].requests == []


def test_leases_that_are_passed_on_leave_room_for_the_client_s_own() -> None:
    robot = GatedRobot({"drive": {**DRIVE, "topics": ["/cmd_vel", "/x/*"], "lease": {"seconds": 60}}})
    attacker, victim = robot.client("agent"), robot.client("operator")
    name = call(victim, "/gate/take_lease", topic="/cmd_vel")["client"]
    call(victim, "/gate/release_lease", topic="/cmd_vel")
    passed = 0
    for number in range(MAX_LEASES + 10):
        topic = f"/x/{number}"
        robot.node.advertise(topic, TWIST)
        assert drive(attacker, 0.1, topic) == ""
        passed += call(attacker, "/gate/pass_lease", topic=topic, to=name)["success"]
        call(attacker, "/gate/release_lease", topic=topic)
    assert passed == MAX_LEASES // 2
    assert call(victim, "/gate/take_lease", topic="/cmd_vel")["success"]
