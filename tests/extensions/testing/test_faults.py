"""Faults between clients and the bridge, and the transcript of what passed."""

from __future__ import annotations

import pytest

from rwt.extensions.testing import ObservedGraph, ObservedWire, ScriptError
from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph import Node, SimulatedClock
from rwt_transports.endpoint import PeerInfo, Traffic
from rwt_transports.errors import Refused
from tests.core.rosbridge.recording_client import Client


class WiredClient(Client):
    """A client that comes in through the observed wire."""

    def __init__(self, wire: ObservedWire, bridge: Bridge) -> None:
        self.frames = []
        self.flows = {}
        self.traffic = Traffic()
        self.received = 0
        self.close_code = None
        self.close_reason = ""
        self.endpoint = wire.middleware(bridge.accept)(self, PeerInfo("memory", address="127.0.0.1"))


class Setup:
    """A robot with one topic and one service, a bridge, and the wire in front."""

    def __init__(self, graph: ObservedGraph) -> None:
        self.bridge = Bridge(graph, Settings())
        self.wire = ObservedWire(graph)
        self.faults = self.wire.faults
        self.node = Node(graph, "robot")
        self.topic = self.node.advertise("/count", "std_msgs/Int32")
        self.other = self.node.advertise("/other", "std_msgs/Int32")
        self.calls = 0

        def handle(request: object) -> dict[str, object]:
            self.calls += 1
            return {"success": True}

        self.node.advertise_service("/beep", "std_srvs/Trigger", handle)

    def client(self) -> WiredClient:
        return WiredClient(self.wire, self.bridge)

    def listener(self) -> WiredClient:
        client = self.client()
        client.say("subscribe", topic="/count")
        client.say("subscribe", topic="/other")
        client.heard()
        return client

    def count(self, *numbers: int) -> None:
        for number in numbers:
            self.topic.publish({"data": number})


@pytest.fixture
def setup(graph: ObservedGraph) -> Setup:
    return Setup(graph)


def data(client: WiredClient, topic: str = "/count") -> list[int]:
    return [message["data"] for message in client.heard_of(topic)]


def test_without_faults_all_passes(setup: Setup) -> None:
    client = setup.listener()
    setup.count(1, 2)
    assert data(client) == [1, 2]
    client.say("call_service", service="/beep", id="1")
    assert [message["id"] for message in client.heard()] == ["1"]


def test_drop_touches_what_its_globs_say(setup: Setup) -> None:
    client = setup.listener()
    fault = setup.faults.drop("/cou*", op="publish", to="client")
    setup.count(1)
    setup.other.publish({"data": 5})
    assert data(client, "/other") == [5]
    fault.remove()
    setup.count(2)
    assert data(client) == [2]
    assert fault.hits == 1


def test_count_and_every(setup: Setup) -> None:
    client = setup.listener()
    with setup.faults.drop("/count", every=2, count=2) as fault:
        setup.count(1, 2, 3, 4, 5, 6)
    assert data(client) == [1, 3, 5, 6]
    assert fault.hits == 2
    setup.count(7)
    assert data(client) == [7]


@pytest.mark.parametrize("name", ["/beep", "beep"])
def test_a_message_to_the_server_is_lost(setup: Setup, name: str) -> None:
    client = setup.client()
    with setup.faults.drop("/beep", op="call_service", to="server"):
        client.say("call_service", service=name, id="1")
    assert (setup.calls, client.heard()) == (0, [])
    client.say("call_service", service=name, id="2")
    assert (setup.calls, len(client.heard())) == (1, 1)


def test_a_service_that_never_answers(setup: Setup) -> None:
    client = setup.client()
    with setup.faults.drop("/beep", op="service_response"):
        client.say("call_service", service="/beep", id="1")
    assert (setup.calls, client.heard()) == (1, [])


def test_delay_in_both_directions_by_the_robots_clock(setup: Setup, clock: SimulatedClock) -> None:
    client = setup.listener()
    setup.faults.delay(1.0, "/beep", op="call_service")
    setup.faults.delay(0.5, "/count", to="client")
    client.say("call_service", service="/beep", id="1")
    setup.count(1, 2)
    assert (setup.calls, client.heard()) == (0, [])
    clock.advance(0.5)
    assert data(client) == [1, 2]
    clock.advance(0.5)
    assert (setup.calls, len(client.heard())) == (1, 1)


def test_what_is_late_does_not_reach_a_client_that_left(setup: Setup, clock: SimulatedClock) -> None:
    client = setup.listener()
    setup.faults.delay(1.0)
    setup.count(1)
    client.say("call_service", service="/beep", id="1")
    client.leave()
    clock.advance(2.0)
    assert (setup.calls, client.heard()) == (0, [])


def test_duplicates(setup: Setup) -> None:
    client = setup.listener()
    setup.faults.duplicate("/count", copies=3)
    setup.faults.duplicate("/beep", op="call_service")
    setup.count(1)
    assert data(client) == [1, 1, 1]
    client.say("call_service", service="/beep", id="1")
    assert setup.calls == 2


def test_fragments_are_met_by_what_they_are_pieces_of(setup: Setup) -> None:
    client = setup.client()
    whole = '{"op":"call_service","service":"/beep","id":"1"}'
    with setup.faults.drop("/beep"):
        for number, piece in enumerate((whole[:20], whole[20:])):
            client.say("fragment", id="f", num=number, total=2, data=piece)
    assert setup.calls == 0


def test_disconnect_ends_every_client(setup: Setup) -> None:
    one, other = setup.client(), setup.client()
    assert setup.faults.disconnect(1012, "restarting") == 2
    assert (one.close_code, other.close_code, one.close_reason) == (1012, 1012, "restarting")
    one.leave()
    assert setup.wire.client_count == 1


def test_refused_connections(setup: Setup) -> None:
    with setup.faults.refuse(count=1) as fault:
        with pytest.raises(Refused) as refused:
            setup.client()
        assert (refused.value.status, fault.hits) == (503, 1)
        setup.client()
    setup.faults.refuse(429)
    for _ in range(2):
        with pytest.raises(Refused):
            setup.client()
    setup.faults.clear()
    setup.client()
    assert setup.wire.client_count == 2


def test_a_slow_reader_gets_the_newest_of_a_topic(setup: Setup, clock: SimulatedClock) -> None:
    client = setup.client()
    client.say("subscribe", topic="/count", queue_length=2)
    client.heard()
    setup.faults.slow_reader(1.0)
    setup.count(1, 2, 3, 4, 5)
    assert data(client) == [1]
    clock.advance(1.0)
    assert data(client) == [4]
    client.say("call_service", service="/beep", id="1")
    assert client.heard() == []
    clock.advance(1.0)
    assert data(client) == [5]
    clock.advance(1.0)
    assert [message["id"] for message in client.heard()] == ["1"]
    assert "✗ a message on /count was dropped: queue" in setup.wire.transcript.text()


def test_a_reader_that_is_slow_no_more_gets_all_that_waits(setup: Setup, clock: SimulatedClock) -> None:
    client = setup.listener()
    with setup.faults.slow_reader(1.0):
        setup.count(1, 2, 3)
        assert data(client) == [1]
    clock.advance(1.0)
    assert data(client) == [2, 3]
    setup.count(4)
    assert data(client) == [4]


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        (lambda faults: faults.drop(to="clients"), 'to` "client", "server" or "both", not \'clients\''),
        (
            lambda faults: faults.drop(op="publsh"),
            "'publsh' matches no op of a message; did you mean publish",
        ),
        (lambda faults: faults.delay(1, op="topic_*"), r"; known are action_feedback, .*, unsubscribe"),
        (lambda faults: faults.drop(every=0), "`every` must be at least 1"),
        (lambda faults: faults.delay(-1), "must not be negative"),
        (lambda faults: faults.duplicate(copies=1), "at least 2 copies"),
        (lambda faults: faults.refuse(200), "from 400 to 599"),
        (lambda faults: faults.slow_reader(0), "more than 0 messages a second"),
    ],
)
def test_a_fault_that_makes_no_sense_is_refused(setup: Setup, wrong: object, text: str) -> None:
    assert callable(wrong)
    with pytest.raises(ScriptError, match=text):
        wrong(setup.faults)


def test_the_transcript_tells_who_said_what_and_what_became_of_it(
    setup: Setup, clock: SimulatedClock
) -> None:
    client = setup.client()
    clock.advance(1.5)
    client.say("subscribe", topic="/count")
    setup.faults.drop("/count", op="publish")
    setup.count(1)
    client.say_raw(b"\x01\x02", binary=True)
    client.leave()
    lines = setup.wire.transcript.lines()
    assert lines[:4] == [
        "    0.000 s  client 1 came from 127.0.0.1 over memory",
        '    1.500 s  client 1 → {"op": "subscribe", "topic": "/count"}',
        '    1.500 s  client 1 ← (dropped by a fault) {"op":"publish","topic":"/count","msg":{"data":1}}',
        "    1.500 s  client 1 → <2 bytes>",
    ]
    assert lines[-1] == "    1.500 s  client 1 left: 1001 gone"


def test_the_transcript_is_bounded_in_lines_and_in_width(setup: Setup) -> None:
    client = setup.client()
    for _ in range(1100):
        client.say("call_service", service="/beep", args={"padding": "ü" * 1000})
    transcript = setup.wire.transcript
    assert len(transcript.lines()) == 1000
    assert max(map(len, transcript.lines())) < 350
    shown = transcript.text(10).splitlines()
    assert (len(shown), shown[0]) == (11, "… 2191 earlier lines")
    assert "bytes)" in shown[-2]
