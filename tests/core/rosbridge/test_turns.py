"""No client keeps the event loop: beyond its share of a turn its messages wait, and it is read no further."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from typing import Any

import cbor2
import pytest

from rwt import Settings
from rwt.access.roles import Role
from rwt.access.settings import RoleSettings
from rwt.gateways.base import ALONE_BYTES, client_scheduler
from rwt.rosbridge.bridge import Bridge
from rwt_graph.api import Sample
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_participant.handles import Publisher
from rwt_participant.qos import LATCHED
from rwt_protocol.codecs import png
from rwt_transports.api import FlowControl
from rwt_transports.scheduler import MESSAGES
from tests.core.rosbridge.recording_client import Client


class BusyClock(SimulatedClock):
    """A clock on which work takes time: each message that the graph hands on takes 2 ms."""

    def __init__(self) -> None:
        super().__init__(1_700_000_000_000_000_000)
        self.worked = self.tick = 0.0

    def monotonic(self) -> float:
        self.worked += self.tick
        return super().monotonic() + self.worked


class Reading(FlowControl):
    """Flow control of a connection."""

    def __init__(self) -> None:
        self.paused = False

    def pause(self) -> None:
        self.paused = True

    def resume(self) -> None:
        self.paused = False

    def when_empty(self, callback: Callable[[], None]) -> None:
        raise AssertionError("a client that waits for its turn needs no such call")


@pytest.fixture
def clock() -> BusyClock:
    return BusyClock()


@pytest.fixture
def heard(graph: MemoryGraph, clock: BusyClock) -> list[str]:
    """Messages received through the graph, each after 2 ms of work."""
    heard: list[str] = []

    def work(sample: Sample) -> None:
        clock.worked += EACH
        string: Any = sample.payload.value()
        heard.append(string.data)

    graph.participant("/listener").subscribe("/t", work)
    return heard


EACH = 0.4 * MESSAGES.share
"""Seconds that each message takes."""


def _publish(text: str) -> dict[str, object]:
    return {"op": "publish", "topic": "/t", "type": "std_msgs/String", "msg": {"data": text}}


def _read(client: Client, *frames: object) -> None:
    """Several frames in one read of the connection."""
    client.received += 1
    for frame in frames:
        client.endpoint.receive(json.dumps(frame).encode(), False)


def test_a_large_message_waits_for_a_turn_of_its_own(
    clock: BusyClock, client: Client, heard: list[str]
) -> None:
    reading = Reading()
    client.peer.set_flow_control(reading)
    _read(client, _publish("a"), _publish("x" * ALONE_BYTES), _publish("b"))
    assert heard == ["a"] and reading.paused  # To receive it has taken time that nobody counted.
    clock.advance(0.0)
    assert [text[0] for text in heard] == ["a", "x", "b"] and not reading.paused


def test_what_is_beyond_the_share_of_a_turn_waits_for_the_next(
    clock: BusyClock, client: Client, other: Client, heard: list[str]
) -> None:
    reading = Reading()
    client.peer.set_flow_control(reading)
    _read(client, *(_publish(f"a{number}") for number in range(8)))
    assert heard == ["a0", "a1", "a2"]
    assert reading.paused
    _read(other, _publish("b"))
    assert heard[3:] == ["b"], "another client is served before the rest"
    _read(client, _publish("a8"))
    assert len(heard) == 4, "what comes later does not overtake it"
    clock.advance(0.0)
    assert heard[4:] == ["a3", "a4", "a5", "a6", "a7", "a8"]
    assert not reading.paused


def test_what_is_too_large_waits_behind_what_came_before_it(
    clock: BusyClock, client: Client, heard: list[str]
) -> None:
    _read(client, *(_publish(str(number)) for number in range(4)), {"op": "set_level", "level": "none"})
    client.peer.oversized(10**8, 10**7, b'{"op":"publish","id":"p"')
    client.peer.oversized(10**8, 10**7, b'{"no":"op"')
    assert client.close_code is None
    clock.advance(0.0)
    assert heard == ["0", "1", "2", "3"]
    assert client.heard() == [], "it wants to hear of nothing"
    assert client.close_code == 1009


def test_a_new_read_is_a_new_turn(client: Client, heard: list[str]) -> None:
    for number in range(8):
        _read(client, _publish(str(number)))
    assert len(heard) == 8


def test_a_thousand_messages_in_one_frame_are_not_one_turn(
    clock: BusyClock, client: Client, heard: list[str]
) -> None:
    client.received += 1
    client.endpoint.receive(
        "".join(json.dumps(_publish(str(number))) for number in range(50)).encode(), False
    )
    assert heard == ["0", "1", "2"]
    for _ in range(20):
        clock.advance(0.0)
    assert heard == [str(number) for number in range(50)]
    assert client.peer.messages == 50


def test_a_turn_that_many_have_filled_takes_small_messages_and_no_more(
    clock: BusyClock, connect: Callable[[], Client], heard: list[str]
) -> None:
    many = round(MESSAGES.turn / MESSAGES.share)
    clients = [connect() for _ in range(many + 3)]
    for number, client in enumerate(clients):
        _read(client, *(_publish(f"{number}{letter}") for letter in "abcd"))
    full = len(heard) - 3
    assert clock.worked - 3 * EACH >= MESSAGES.turn > clock.worked - 4 * EACH
    begun = [f"{number}{letter}" for number in range(many) for letter in "abc"]
    assert heard[:full] == begun[:full]
    assert heard[full:] == [f"{number}a" for number in range(many, many + 3)], "a small one of each"
    large = connect()
    _read(large, _publish("large" * 1000))
    assert "large" * 1000 not in heard
    heard.clear()
    clock.advance(0.0)
    late = [f"{number}{letter}" for number in range(many + 3) for letter in "abcd"]
    rest = [each for each in late if each not in begun[:full] and each[1] != "a"]
    assert heard == [*rest, "large" * 1000], "first come, first served"


def test_many_who_have_little_each_fill_a_turn(
    clock: BusyClock, connect: Callable[[], Client], heard: list[str]
) -> None:
    clients = [connect() for _ in range(40)]
    for client in clients:  # Each less than its share.
        _read(client, *(_publish(letter) for letter in "ab"))
    assert heard.count("b") * 2 * EACH <= MESSAGES.turn
    assert heard.count("a") > heard.count("b"), "a small one of others, too"
    assert clock.worked <= 2 * MESSAGES.turn + EACH, "until the turn is twice full"
    clock.advance(0.0)
    assert (heard.count("a"), heard.count("b")) == (40, 40)


def test_a_small_message_that_found_the_turn_overfull_is_the_first_of_the_next(
    clock: BusyClock, connect: Callable[[], Client], heard: list[str]
) -> None:
    flooding = [connect() for _ in range(40)]
    for client in flooding:
        _read(client, *(_publish(letter) for letter in "aab"))
    other = connect()
    _read(other, _publish("other"))
    assert "other" not in heard
    at = len(heard)
    clock.advance(0.0)
    before = heard[at : heard.index("other")]
    assert before.count("b") * MESSAGES.share <= MESSAGES.turn, (
        "it waits for the first messages of others only"
    )
    assert heard.count("a") == 80 and heard.count("b") == 40


def test_a_message_that_is_rejected_counts_like_any_other(clock: BusyClock, client: Client) -> None:
    reading = Reading()
    client.peer.set_flow_control(reading)
    clock.tick = EACH / 2  # The clock is asked more than once for each message.
    _read(client, *({"op": "publish", "topic": "/unknown", "msg": {}} for _ in range(8)))
    read = client.peer.messages
    assert reading.paused and read < 8
    clock.tick = 0.0
    clock.advance(0.0)
    assert client.peer.messages == 8


def test_those_who_wait_have_a_turn_each(clock: BusyClock, connect: Callable[[], Client]) -> None:
    scheduler = client_scheduler(clock)
    done: list[str] = []
    for name in "abc":
        scheduler.wait(partial(done.append, name))
    clock.call_later(0.0, partial(done.append, "another timer"))
    clock.advance(0.0)
    assert done[:2] == ["a", "another timer"]
    assert done[2:] == ["b", "c"]


def test_what_waits_is_thrown_away_with_the_connection(
    clock: BusyClock, client: Client, heard: list[str]
) -> None:
    _read(client, *(_publish(str(number)) for number in range(8)))
    client.leave()
    clock.advance(0.0)
    assert heard == ["0", "1", "2"]


def test_the_rate_counts_messages_and_not_frames(graph: MemoryGraph) -> None:
    settings = Settings.model_validate({"limits": {"messages_per_second": 10, "messages_burst": 10}})
    client = Client(Bridge(graph, settings))
    seen: list[Sample] = []
    graph.participant("/listener").subscribe("/t", seen.append)
    client.say_raw("".join(json.dumps(_publish(str(number))) for number in range(1000)))
    assert len(seen) == 10
    assert client.close_reason == "more than 10 messages a second (limits.messages_per_second)"


class SteppingClock(SimulatedClock):
    """A clock on which each look at it takes the share of a turn, so that a turn has one step."""

    def __init__(self) -> None:
        super().__init__(1_700_000_000_000_000_000)
        self.looks = 0

    def monotonic(self) -> float:
        self.looks += 1
        return super().monotonic() + 1.01 * MESSAGES.share * self.looks


def _long_path(**first: object) -> dict[str, object]:
    pose = {
        "position": {"x": 1.5, "y": 2.5, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }
    header = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "map"}
    poses = [{"header": header, "pose": pose} for _ in range(3000)]
    path = {"header": header, "poses": [poses[0] | first, *poses]}
    return {"op": "publish", "topic": "/path", "type": "nav_msgs/Path", "msg": path, "id": "long"}


class TestALargeMessage:
    """Check a message in steps, with at most its share of each turn."""

    @pytest.fixture
    def clock(self) -> SteppingClock:
        return SteppingClock()

    @pytest.fixture
    def seen(self, graph: MemoryGraph) -> list[str]:
        """The topics of what has come through the graph."""
        seen: list[str] = []
        for topic in ("/path", "/t"):
            graph.participant("/listener").subscribe(topic, lambda sample: seen.append(sample.topic))
        return seen

    def test_it_waits_between_its_steps_and_others_go_on(
        self, clock: SteppingClock, client: Client, other: Client, seen: list[str]
    ) -> None:
        reading = Reading()
        client.peer.set_flow_control(reading)
        _read(client, _long_path())
        assert (seen, reading.paused) == ([], True)
        _read(client, _publish("after it"))
        _read(other, _publish("of somebody else"))
        assert seen == ["/t"], "what the same client sends next does not overtake it"
        clock.advance(0.0)
        assert seen == ["/t", "/path", "/t"]
        assert not reading.paused

    def test_success_is_told_once_and_at_its_end(self, clock: SteppingClock, client: Client) -> None:
        client.say("set_level", level="info")
        client.heard()
        _read(client, _long_path())
        assert client.heard() == []
        clock.advance(0.0)
        assert [message["msg"] for message in client.heard()] == ["publish: done"]

    def test_a_fault_in_it_is_told_as_in_a_small_one(
        self, clock: SteppingClock, client: Client, seen: list[str]
    ) -> None:
        client.say("set_level", level="error")
        _read(client, _long_path(pose={"position": {"x": "far"}}))
        clock.advance(0.0)
        (answer,) = client.heard()
        assert answer["msg"] == 'publish.msg.poses[0].pose.position.x: expected float64, got "far"'
        assert (answer["id"], seen) == ("long", [])

    def test_it_is_thrown_away_with_the_connection(
        self, clock: SteppingClock, client: Client, seen: list[str]
    ) -> None:
        _read(client, _long_path())
        client.leave()
        clock.advance(0.0)
        assert seen == []

    def test_a_publisher_who_may_no_longer_is_refused_at_its_end(
        self, clock: SteppingClock, client: Client, seen: list[str]
    ) -> None:
        client.say("set_level", level="error")
        _read(client, _long_path())
        client.peer.take_role(Role("guest", RoleSettings(publish=[])))
        clock.advance(0.0)
        assert seen == []
        (answer,) = client.heard()
        assert answer["level"] == "error"


class TestALongSample:
    """Encode in steps, once for all clients of an encoding, while later messages of the topic wait."""

    @pytest.fixture
    def clock(self) -> SteppingClock:
        return SteppingClock()

    @pytest.fixture
    def robot(self, graph: MemoryGraph) -> Publisher:
        return graph.node("robot").advertise("/numbers", "std_msgs/Float64MultiArray", qos=LATCHED)

    def test_its_topic_keeps_its_order(
        self, clock: SteppingClock, robot: Publisher, client: Client, other: Client
    ) -> None:
        for each, compression in ((client, "none"), (other, "cbor")):
            each.say("subscribe", topic="/numbers", compression=compression)
        robot.publish({"data": [0.5] * 100_000})
        robot.publish({"data": [1.5]})
        assert client.frames == other.frames == []
        clock.advance(0.0)
        assert [len(message["data"]) for message in client.heard_of("/numbers")] == [100_000, 1]
        long, short = (cbor2.loads(frame.data)["msg"]["data"] for frame, _ in other.frames)
        assert (long.tag, len(long.value), len(short.value)) == (86, 800_000, 8)

    def test_each_encoding_is_made_once(self, clock: SteppingClock, robot: Publisher, bridge: Bridge) -> None:
        clients = [Client(bridge) for _ in range(10)]
        for each in clients:
            each.say("subscribe", topic="/numbers", compression="cbor-raw")
        robot.publish({"data": [0.5] * 100_000})
        clock.advance(0.0)
        (frame,) = {id(frame): frame for each in clients for frame, _ in each.frames}.values()
        assert frame.size > 800_000

    def test_a_picture_is_made_in_steps(
        self, clock: SteppingClock, graph: MemoryGraph, client: Client, other: Client
    ) -> None:
        robot = graph.node("robot").advertise("/texts", "std_msgs/String")
        client.say("subscribe", topic="/texts")
        other.say("subscribe", topic="/texts", compression="png")
        for text in ("0123456789abcdef" * 30_000, "short"):
            robot.publish({"data": text})
        assert client.frames == other.frames == []
        clock.advance(0.0)
        assert [message["data"] for message in client.heard_of("/texts")][1] == "short"
        pictures = [
            json.loads(png.decode(json.loads(frame.data)["data"], 10**6)) for frame, _ in other.frames
        ]
        assert [len(picture["msg"]["data"]) for picture in pictures] == [480_000, 5]

    def test_who_joins_meanwhile_hears_it_once(
        self, clock: SteppingClock, robot: Publisher, client: Client, other: Client
    ) -> None:
        client.say("subscribe", topic="/numbers")
        robot.publish({"data": [0.5] * 100_000})
        other.say("subscribe", topic="/numbers")
        clock.advance(0.0)
        assert len(client.heard_of("/numbers")) == len(other.heard_of("/numbers")) == 1

    def test_a_robot_that_is_quicker_than_its_encoding_is_waited_for(
        self, clock: SteppingClock, robot: Publisher, client: Client
    ) -> None:
        client.say("subscribe", topic="/numbers")
        for number in range(20):
            robot.publish({"data": [number + 0.5] * 10_000})
        heard = len(client.frames)
        assert 10 <= heard < 20
        clock.advance(0.0)
        assert [message["data"][0] for message in client.heard_of("/numbers")] == [n + 0.5 for n in range(20)]
