"""Commands that waited, in a stalled connection or while the machine was paused, do not drive the robot."""

from __future__ import annotations

import json
import random

import pytest

from rwt.access.gate.lease import WakeWatch
from rwt.access.settings import SettingsError
from rwt_graph import SimulatedClock
from rwt_interfaces.payload import Payload
from tests.core.access.gated_robot import CLIENT, DRIVE, GATE, GatedRobot, call, drive, errors, settings_of

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


@pytest.fixture
def link() -> Link:
    """Link over which a client drives."""
    link = Link()
    link.speed = 0.3
    link.run(2)
    return link


@pytest.mark.parametrize("before", [0.15, 0.4, 2.0])
@pytest.mark.parametrize("seconds", [1.0, 3.0, 10.0, 45.0])
def test_a_control_that_is_held_through_a_stall_requires_a_new_grip(seconds: float, before: float) -> None:
    link = Link()
    link.speed = 0.3
    assert set(link.run(before)) == {0.3}
    assert link.run(seconds, is_stalled=True) == []
    assert link.run(5) == []
    text = drive(link.client, 0.3)
    assert "waited in a stalled connection for more than 0.5 s: send the stop message" in text
    assert "(gate.rules.drive.lease)" in text
    link.speed = 0.0
    assert set(link.run(0.2)) == {0.0}
    link.speed = 0.2
    assert link.run(1) == [0.2] * 20


@pytest.mark.parametrize(
    ("speeds", "seconds", "driven"),
    [
        pytest.param((0.3,), 0.4, 0.3, id="a stall shorter than the lease changes nothing"),
        pytest.param((0.3, 0.0), 1, 0.0, id="released meanwhile"),
        pytest.param((0.3, 0.0, 0.4), 1, 0.0, id="released and taken again meanwhile"),
    ],
)
def test_what_a_control_does_during_a_stall(
    link: Link, speeds: tuple[float, ...], seconds: float, driven: float
) -> None:
    for speed in speeds:
        link.speed = speed
        link.run(seconds, is_stalled=True)
    assert set(link.run(3)) == {driven}
    if speeds[-1] == 0.0:
        link.speed = 0.3
        assert 0.3 in link.run(0.2)


def test_a_control_taken_during_a_stall_stops_the_robot_at_once(link: Link) -> None:
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


def test_after_a_pause_without_a_stop_message_commands_at_their_usual_pace_count(link: Link) -> None:
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


def test_a_second_stall_is_no_pause(link: Link) -> None:
    for _ in range(4):
        link.run(1, is_stalled=True)
        assert link.run(0.3) == []


def test_single_and_first_commands_are_never_queued_ones() -> None:
    robot = GatedRobot({"drive": DRIVE})
    client, other = robot.clients("operator", "agent")
    for _ in range(5):
        assert drive(client, 0.3) == ""
        robot.clock.advance(3)
    assert [drive(other, 0.3) for _ in range(20)] == [""] * 20


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
    heard = robot.hear("/drive", STAMPED)
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
    speeds = [each.twist.linear.x for each in heard]
    assert 8 <= len([speed for speed in speeds if speed]) <= 12
    assert speeds[-1] == 0.0


def test_commands_older_than_the_largest_age_are_refused_from_the_first_on() -> None:
    rule = {"topics": ["/drive"], "stop": {}, "lease": {"seconds": LEASE, "max_age": 0.2}}
    robot = GatedRobot({"drive": rule})
    heard = robot.hear("/drive", STAMPED)
    client = robot.client()
    client.say("advertise", topic="/drive", type=STAMPED)

    def send(age: float, speed: float = 0.3) -> str:
        made = robot.clock.time_ns() - round(age * 1e9)
        stamp = {"sec": made // 10**9, "nanosec": made % 10**9}
        twist = {"linear": {"x": speed}}
        client.say("publish", topic="/drive", msg={"header": {"stamp": stamp}, "twist": twist})
        robot.clock.advance(PERIOD)
        return errors(client)

    text = send(0.35)
    assert "the command is 0.350 s old by its stamp, limit is 0.2 s (`max_age`)" in text
    assert "(gate.rules.drive.lease)" in text
    assert not [each for each in heard if each.twist.linear.x]
    assert send(0.1) == "" and heard[-1].twist.linear.x == 0.3
    assert send(9.0, 0.0) == "" and heard[-1].twist.linear.x == 0.0
    client.say("publish", topic="/drive", msg={"twist": {"linear": {"x": 0.4}}})
    assert errors(client) == "" and heard[-1].twist.linear.x == 0.4


def test_the_largest_age_needs_a_stamp() -> None:
    rule = {**DRIVE, "lease": {"seconds": LEASE, "max_age": 0.2}}
    with pytest.raises(SettingsError, match=r"drive.lease.max_age`: geometry_msgs/Twist has no header"):
        GatedRobot({"drive": rule})


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


# -- pauses of the process and suspensions of the machine ----------------------------------------------------


@pytest.mark.parametrize("take", ["publish", "service"])
def test_commands_of_a_pause_do_not_move_the_robot(take: str) -> None:
    robot = GatedRobot({"drive": {**DRIVE, "lease": {"seconds": 0.5, "take": take}}})
    client, other = robot.client(), robot.client("agent")
    call(client, "/gate/take_lease", topic="/cmd_vel")
    drive(client, 0.5)
    robot.take()
    robot.clock.suspend(2.0)
    # The messages of the time before are read before the timers run.
    for each in (client, client, other, client):
        drive(each, 0.5)
    assert robot.take() == [(0.0, GATE)]
    robot.clock.advance(0.2)
    assert "ended while this server was paused" in drive(other, 0.5)
    assert {speed for speed, _ in robot.take()} == {0.0}
    robot.clock.advance(0.06)
    if take == "publish":
        assert drive(client, 0.25) == ""
        assert robot.take()[-1] == (0.25, CLIENT)


def test_a_timer_that_comes_first_bars_them_too() -> None:
    robot = GatedRobot({"drive": DRIVE})
    client = robot.client()
    drive(client, 0.5)
    robot.clock.suspend(2.0)
    robot.clock.advance(0.0)
    assert robot.take()[:2] == [(0.5, CLIENT), (0.0, GATE)]
    assert "ended while this server was paused" in drive(client, 0.5)


def test_a_reload_does_not_admit_commands_of_a_pause() -> None:
    robot = GatedRobot({"drive": DRIVE})
    client = robot.client()
    drive(client, 0.5)
    robot.clock.suspend(2.0)
    robot.clock.advance(0.0)
    other = {**DRIVE, "fields": {"linear.x": {"max": 2.0}}}
    robot.access.reload(settings_of({"rules": {"drive": other}}))
    robot.bridge.reload_roles()
    assert "ended while this server was paused" in drive(client, 0.5)


def test_a_turn_of_the_loop_that_takes_long_is_no_pause() -> None:
    robot = GatedRobot({"drive": DRIVE})
    client = robot.client()
    drive(client, 0.5)
    robot.clock.suspend(0.6)
    assert drive(client, 0.25) == ""
    assert [speed for speed, _ in robot.take()] == [0.5, 0.0, 0.25]


class SuspendedClock(SimulatedClock):
    """A clock of a machine that is suspended now and then.

    Attributes:
        suspended: seconds for which it was.
    """

    suspended = 0.0
    is_real = True

    def boottime(self) -> float:
        """Time with suspension."""
        return self.monotonic() + self.suspended


def test_after_a_suspension_the_robot_is_stopped_at_once() -> None:
    clock = SuspendedClock(1_700_000_000 * 10**9)
    robot = GatedRobot({"drive": {**DRIVE, "lease": {"seconds": 10}}}, clock=clock)
    client = robot.client()
    drive(client, 0.5)
    clock.advance(1.0)
    assert robot.take() == [(0.5, CLIENT)]
    clock.suspended += 3600.0
    clock.advance(0.05)
    assert robot.take() == [(0.0, GATE)]
    assert "ended while this server was paused" in drive(client, 0.5)


def test_the_watch_ends_with_the_last_lease() -> None:
    clock = SuspendedClock()
    answers = iter([True, False])
    looks: list[bool] = []

    def look(was_suspended: bool) -> bool:
        looks.append(was_suspended)
        return next(answers)

    watch = WakeWatch(clock, look)
    watch.begin()
    watch.begin()
    clock.advance(1.0)
    assert (looks, clock.pending()) == ([False, False], 0)
