"""Commands that waited in a stalled connection do not drive the robot, whatever the client does meanwhile."""

from __future__ import annotations

import json
import random
from typing import Any

import pytest

from rwt_graph.api import Sample
from rwt_interfaces.payload import Payload
from tests.core.access.gated_robot import DRIVE, GATE, GatedRobot, drive

PERIOD = 0.05
LEASE = 0.5


class Link:
    """Connection of a client that sends a command every 50 ms, and may stall.

    Attributes:
        robot: robot that the client drives.
        client: client at the other end.
        speed: speed that the client's control asks for; None: the client sends nothing.
    """

    def __init__(self) -> None:
        self.robot = GatedRobot({"drive": DRIVE})
        self.speed: float | None = None
        self.client = self.robot.client()
        self._queue: list[float] = []

    def run(self, seconds: float, *, is_stalled: bool = False) -> list[float]:
        """Let time pass, and return the speeds of the client's commands that reached the robot."""
        self.robot.take()
        for _ in range(round(seconds / PERIOD)):
            if self.speed is not None:
                self._queue.append(self.speed)
            if not is_stalled:
                self.deliver()
            self.robot.clock.advance(PERIOD)
        return [speed for speed, node in self.robot.take() if node != GATE]

    def deliver(self, interval: float = 0.0005) -> None:
        """Deliver what is queued, as a recovering connection does."""
        while self._queue:
            drive(self.client, self._queue.pop(0))
            if self._queue:
                self.robot.clock.advance(interval)


@pytest.mark.parametrize("before", [0.15, 0.4, 2.0])
@pytest.mark.parametrize("seconds", [1.0, 3.0, 10.0, 45.0])
def test_a_control_that_is_held_through_a_stall_requires_a_new_grip(seconds: float, before: float) -> None:
    link = Link()
    link.speed = 0.3
    assert set(link.run(before)) == {0.3}
    assert link.run(seconds, is_stalled=True) == []
    assert link.run(5) == []
    link.speed = 0.0
    assert set(link.run(0.2)) == {0.0}
    link.speed = 0.2
    assert link.run(1) == [0.2] * 20


def test_a_stall_shorter_than_the_lease_changes_nothing() -> None:
    link = Link()
    link.speed = 0.3
    link.run(2)
    link.run(0.4, is_stalled=True)
    assert set(link.run(1)) == {0.3}


def test_a_control_released_during_a_stall_leaves_the_robot_standing() -> None:
    link = Link()
    link.speed = 0.3
    link.run(2)
    link.run(1, is_stalled=True)
    link.speed = 0.0
    link.run(1, is_stalled=True)
    assert set(link.run(2)) == {0.0}
    link.speed = 0.3
    assert 0.3 in link.run(0.2)


def test_a_control_taken_again_during_a_stall_does_not_count() -> None:
    link = Link()
    link.speed = 0.3
    link.run(2)
    for speed in (0.3, 0.0, 0.4):
        link.speed = speed
        link.run(1, is_stalled=True)
    assert set(link.run(3)) <= {0.0}


def test_a_control_taken_during_a_stall_stops_the_robot_at_once() -> None:
    link = Link()
    link.speed = 0.3
    link.run(2)
    link.speed = 0.0
    link.run(0.2)
    link.speed = None
    link.run(1)
    link.speed = 0.4
    link.run(2, is_stalled=True)
    link.robot.take()
    link.deliver()
    heard = link.robot.take()
    # The first ones cannot be told from a new grip.
    assert [speed for speed, node in heard if node != GATE] == [0.4, 0.4]
    assert heard[-1] == (0.0, GATE)
    assert link.run(3) == []


def test_after_a_pause_without_a_stop_message_commands_at_their_usual_pace_count() -> None:
    link = Link()
    link.speed = 0.3
    link.run(2)
    link.speed = None
    link.run(2)
    link.speed = 0.4
    assert link.run(1) == []
    link.speed = None
    link.run(1)
    link.speed = 0.5
    assert set(link.run(1)) == {0.5}


def test_a_client_that_has_sent_the_stop_message_lets_go_by_it_only() -> None:
    link = Link()
    link.speed = 0.0
    link.run(0.2)
    link.speed = 0.3
    link.run(2)
    link.run(1, is_stalled=True)
    for _ in range(3):
        assert link.run(1) == []
        link.speed = None  # A page that is too busy to send.
        link.run(1)
        link.speed = 0.3
    assert "send the stop message and begin again" in drive(link.client, 0.3)
    link.speed = 0.0
    link.run(0.2)
    link.speed = 0.2
    assert link.run(1) == [0.2] * 20


def test_a_second_stall_is_no_pause() -> None:
    link = Link()
    link.speed = 0.3
    link.run(2)
    for _ in range(4):
        link.run(1, is_stalled=True)
        assert link.run(0.3) == []


def test_single_commands_are_never_queued_ones() -> None:
    robot = GatedRobot({"drive": DRIVE})
    client = robot.client()
    for _ in range(5):
        assert drive(client, 0.3) == ""
        robot.clock.advance(3)


def test_the_first_commands_of_a_client_may_arrive_together() -> None:
    robot = GatedRobot({"drive": DRIVE})
    client = robot.client()
    assert [drive(client, 0.3) for _ in range(20)] == [""] * 20


def test_the_text_says_what_to_do() -> None:
    link = Link()
    link.speed = 0.3
    link.run(2)
    link.run(2, is_stalled=True)
    refused = drive(link.client, 0.3)
    assert "waited in a stalled connection for more than 0.5 s: send the stop message" in refused
    assert "(gate.rules.drive.lease)" in refused


@pytest.mark.parametrize("seed", range(200))
def test_random_schedules(seed: int) -> None:
    """Stalls, suspensions, grips and releases at random: no command of before a recovery drives the robot."""
    random_ = random.Random(seed)
    link = Link()
    link.speed = 0.3
    link.run(2)
    for _ in range(6):
        stall = random_.choice((random_.uniform(0.6, 5), 1.0, 3.0, 10.0, 45.0))
        if random_.random() < 0.3:
            link.speed = None  # A suspended client sends nothing, and afterwards what it sent before.
        link.run(stall, is_stalled=True)
        link.speed = 0.3
        # Held throughout, or released and taken again while nothing arrives.
        if random_.random() < 0.5:
            link.speed = 0.0
            link.run(random_.uniform(0.1, 1), is_stalled=True)
            link.speed = 0.4
            link.run(random_.uniform(0.1, 2), is_stalled=True)
        assert set(link.run(random_.uniform(0.3, 3))) <= {0.0}
        link.speed = 0.0
        link.run(0.2)
        link.speed = 0.3
        assert link.run(1) == [0.3] * 20


STAMPED = "geometry_msgs/TwistStamped"


@pytest.mark.parametrize("ahead", [-7200.0, 0.0, 7200.0])
def test_stamped_commands_that_waited_are_dropped_though_others_follow_closely(ahead: float) -> None:
    robot = GatedRobot({"drive": {**DRIVE, "topics": ["/drive"]}})
    heard: list[float] = []

    def hear(sample: Sample) -> None:
        value: Any = sample.payload.value()
        heard.append(value.twist.linear.x)

    robot.graph.participant("/wheels").subscribe("/drive", hear, robot.graph.registry.message(STAMPED))
    client = robot.client()
    client.say("advertise", topic="/drive", type=STAMPED)

    def send(delay: float) -> None:
        made = robot.clock.time_ns() / 1e9 + ahead - delay
        stamp = {"sec": int(made), "nanosec": int(made % 1 * 1e9)}
        twist = {"linear": {"x": 0.3}}
        client.say("publish", topic="/drive", msg={"header": {"stamp": stamp}, "twist": twist})
        robot.clock.advance(PERIOD)

    for _ in range(40):
        send(0.1)
    assert len(heard) == 40
    heard.clear()
    # A link that is too slow: the queue grows, and nothing is missing.
    for count in range(40):
        send(0.1 + count * 0.05)
    moved = [speed for speed in heard if speed]
    assert 8 <= len(moved) <= 12
    assert heard[-1] == 0.0


def test_a_large_command_is_not_decoded_to_find_its_age() -> None:
    rule = {"topics": ["/wave"], "stop": {}, "lease": {"seconds": LEASE}, "finite": False}
    robot = GatedRobot({"wave": rule})
    type = robot.graph.registry.message("std_msgs/Float64MultiArray")
    robot.graph.participant("/arm").subscribe("/wave", lambda sample: None, type)
    text = json.dumps({"layout": {"dim": [], "data_offset": 0}, "data": [0.5] * 100_000}).encode()
    payload = Payload.from_json(type, text)
    assert payload.is_passthrough
    gate = robot.gate
    actor = gate.join("driver", robot.access.admission.roles["admin"], "10.0.0.1")
    heard: list[Payload] = []
    gate.join_topic(actor, "/wave", type).publish(actor, payload, heard.append)
    assert heard == [payload] and not payload.is_decoded
