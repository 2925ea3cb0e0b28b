"""The emergency stop: latched, for topics, calls and goals, and released by those who may."""

from __future__ import annotations

from typing import Any

import pytest

from rwt.access.gate import topic
from rwt.access.gate.node import SERVICES
from rwt.observability.metrics import ServerMetrics
from rwt.rosapi import Rosapi
from rwt_graph.api import GoalEvents
from rwt_interfaces.payload import Payload
from tests.core.access.gated_robot import CLIENT, FIBONACCI, GATE, GatedRobot, call, drive, errors

RULES = {
    "drive": {"topics": ["/cmd_vel"], "emergency": True, "stop": {}},
    "acts": {"services": ["/blink"], "actions": ["/count"], "emergency": True},
}


def _state(robot: GatedRobot) -> Any:
    return robot.latest("/gate/stopped", 0.001)


def _count(client: Any) -> str:
    client.say("send_action_goal", action="/count", action_type=FIBONACCI, args={"order": 9})
    return str(client.heard())


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
def test_it_stops_what_moves_and_lets_nothing_through_until_it_is_released(distro: str) -> None:
    robot = GatedRobot(RULES, distro)
    robot.offer("/blink", "/time")
    _, cancelled = robot.accept_goals("/count")
    client, admin = robot.clients("operator", "admin")
    assert drive(client, 0.5) == ""
    assert _count(client) == "[]"
    # A goal of the robot's own programs is movement like any other.
    own = Payload.from_value(robot.graph.registry.action(FIBONACCI).goal, {"order": 1})
    robot.graph.participant("/own").send_goal("/count", own, GoalEvents(lambda *_: None))

    assert call(client, "/gate/stop", reason="a child")["success"]
    assert robot.take() == [(0.5, CLIENT), (0.0, GATE)]
    assert len(cancelled) == len(set(cancelled)) == 2
    state = _state(robot)
    assert (state.stopped, state.by, state.reason) == (True, "rosbridge:1 (role operator)", "a child")
    refused = drive(client, 0.5)
    who = "rosbridge:1 (role operator)"
    assert f"the emergency stop is on: stopped by {who} (gate.rules.drive.emergency)" in refused
    assert "the emergency stop is on" in drive(client, 0.0)
    client.say("call_service", service="/blink", args={})
    assert "gate.rules.acts.emergency" in client.heard()[0]["values"]
    assert "gate.rules.acts.emergency" in _count(client)
    assert "gate.rules.acts.emergency" in _count(admin)
    assert call(client, "/time")["success"]
    robot.clock.advance(60)
    told = robot.take()
    assert set(told) == {(0.0, GATE)}
    # Again and again: what the robot's own programs publish does not pass here.
    assert len(told) >= 590

    answer = call(client, "/gate/release_stop", reason="gone")
    assert "role 'operator' may not release the robot (gate.emergency.release_roles)" in answer["message"]
    assert call(admin, "/gate/release_stop", reason="gone")["success"]
    assert not _state(robot).stopped
    assert call(client, "/blink")["success"]
    assert _count(client) == "[]"
    robot.clock.advance(2)
    robot.take()
    robot.clock.advance(2)
    assert robot.take() == []


def test_who_went_on_driving_meanwhile_does_not_move_the_robot_by_its_release() -> None:
    robot = GatedRobot(RULES)
    client, admin = robot.clients("operator", "admin")
    call(admin, "/gate/stop")
    drive(client, 0.5)
    call(admin, "/gate/release_stop")
    for _ in range(30):
        assert "be silent for 1 s, or send the stop message first" in drive(client, 0.5)
        robot.clock.advance(0.1)
    assert {speed for speed, _ in robot.take()} == {0.0}
    assert drive(client, 0.0) == ""
    assert drive(client, 0.5) == ""


def test_a_message_on_its_topic_is_a_press_too() -> None:
    robot = GatedRobot(RULES)
    robot.node.publish("/gate/stop", {}, "std_msgs/Empty")
    state = _state(robot)
    assert (state.stopped, state.reason) == (True, "by a message of /robot on /gate/stop")
    robot = GatedRobot(RULES, emergency={"stop_roles": ["operator"]})
    agent, operator = robot.client("agent"), robot.client()
    agent.say("publish", topic="/gate/stop", type="std_msgs/Empty", msg={})
    assert "gate.emergency.stop_roles" in agent.heard()[0]["msg"]
    assert "gate.emergency.stop_roles" in call(agent, "/gate/stop")["message"]
    assert not _state(robot).stopped
    operator.say("publish", topic="/gate/stop", type="std_msgs/Empty", msg={})
    assert _state(robot).stopped


def test_a_viewer_sees_it_and_may_press_it_without_a_right_to_call() -> None:
    robot = GatedRobot(RULES)
    Rosapi(robot.graph)
    viewer = robot.client("agent")
    viewer.peer.graph.take_role(robot.access.admission.roles["viewer"])
    shown = call(viewer, "/rosapi/services")["services"]
    assert {name for name in shown if name.startswith("/gate")} == set(SERVICES)
    assert call(viewer, "/gate/stop")["success"]


def test_a_server_may_begin_stopped() -> None:
    robot = GatedRobot(RULES, emergency={"at_start": True})
    assert robot.take()[0] == (0.0, GATE)
    assert "the emergency stop is on" in drive(robot.client(), 0.1)
    answer = call(GatedRobot({"drive": {"topics": ["/cmd_vel"]}}).client(), "/gate/stop")
    assert (answer["success"], "set gate.rules.NAME.emergency" in answer["message"]) == (False, True)


def test_a_gate_that_observes_says_that_it_does_not_hold() -> None:
    robot = GatedRobot(RULES, mode="observe")
    client = robot.client()
    answer = call(client, "/gate/stop")
    assert (answer["success"], "only observes" in answer["message"]) == (False, True)
    assert robot.take() == [(0.0, GATE)]
    assert not _state(robot).stopped
    assert drive(client, 0.5) == ""


def test_a_goal_cannot_come_round_by_the_services_and_topics_behind_an_action() -> None:
    robot = GatedRobot(RULES)
    client = robot.client()
    robot.offer("/count/_action/send_goal")
    call(client, "/gate/stop")
    client.say("call_service", service="/count/_action/send_goal", args={})
    assert "gate.rules.acts.emergency" in client.heard()[0]["values"]


@pytest.mark.parametrize("rule", [{"emergency": True}, {"fields": {"order": {"max": 5}}}])
def test_on_ros_1_a_goal_on_its_topic_is_a_goal(rule: Any) -> None:
    robot = GatedRobot({"acts": {"actions": ["/fib"], "emergency": True, **rule}}, distro="noetic")
    type = "actionlib_tutorials/FibonacciActionGoal"
    heard = robot.hear("/fib/goal", type)
    client, admin = robot.clients("operator", "admin")
    goal = {"topic": "/fib/goal", "type": type, "msg": {"goal": {"order": 2}}}
    if "fields" not in rule:
        client.say("publish", **goal)
        assert len(heard) == 1
        call(admin, "/gate/stop")
    client.say("publish", **goal)
    assert "gate.rules.acts" in errors(client)
    assert len(heard) == ("fields" not in rule)


def test_metrics_count_what_the_gate_does() -> None:
    robot = GatedRobot(RULES)
    client = robot.client()
    call(client, "/gate/stop")
    drive(client, 0.5)
    metrics = ServerMetrics(robot.bridge)
    lines = metrics.text().decode().splitlines()
    metrics.close()
    assert {
        'rwt_gate_events_total{decision="refused"} 1',
        'rwt_gate_events_total{decision="stop"} 1',
        "rwt_gate_stopped 1",
        "rwt_gate_audit_dropped_lines_total 0",
    } <= set(lines)


@pytest.mark.parametrize("how", ["advertise again", "another connection", "the same"])
def test_a_client_is_still_for_a_second_whatever_it_does_meanwhile(how: str) -> None:
    robot = GatedRobot(RULES)
    client, admin, other = robot.clients("operator", "admin", "agent")
    drive(client, 0.5)
    call(admin, "/gate/stop")
    drive(client, 0.5)
    call(admin, "/gate/release_stop")
    for _ in range(20):
        robot.clock.advance(0.01)
        if how == "advertise again":
            client.say("advertise", topic="/cmd_vel", type="geometry_msgs/Twist")
            client.say("unadvertise", topic="/cmd_vel")
            client.heard()
        elif how == "another connection":
            client.leave()
            client = robot.client()
        assert "be silent for 1 s" in drive(client, 0.5)
    assert {speed for speed, _ in robot.take()} == {0.5, 0.0}
    assert drive(other, 0.25) == "", "others are not paused"
    for _ in range(3):  # From the last rejected message on.
        robot.clock.advance(0.999)
        assert "be silent" in drive(client, 0.5)
    robot.clock.advance(1.0)
    assert drive(client, 0.5) == ""


@pytest.mark.parametrize("how", ["many clients", "its topic is swept"])
def test_a_pause_is_kept_for_its_second(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rules = {"drive": {"topics": ["/cmd_vel", "/x/*"], "emergency": True, "stop": {}}}
    robot = GatedRobot(rules)
    monkeypatch.setattr(topic, "MAX_PAUSED", 1)
    client, other, admin = robot.clients("operator", "agent", "admin")
    robot.node.advertise("/x/0", "geometry_msgs/Twist")
    call(admin, "/gate/stop")
    drive(client, 0.5)
    drive(client, 0.5, "/x/0")
    call(admin, "/gate/release_stop")
    robot.clock.advance(0.9)
    client.leave()
    if how == "many clients":
        drive(other, 0.5)
    else:
        for number in range(10):  # Each new topic examines two for removal.
            drive(admin, 0.5, f"/x/new{number}")
    robot.clock.advance(0.099)
    client = robot.client()
    assert "be silent for 1 s" in drive(client, 0.5)
    assert "be silent for 1 s" in drive(client, 0.5, "/x/0")
