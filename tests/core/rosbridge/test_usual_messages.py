"""A usual small message becomes a light op, and nothing else is different."""

from __future__ import annotations

import json
from collections.abc import Sequence

import pytest

from rwt import Settings
from rwt.access.errors import GateRefused, QuotaExceeded
from rwt.access.roles import Role
from rwt.access.settings import RoleSettings
from rwt.rosbridge.bridge import Bridge
from rwt_graph.api import Sample
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.nodes.node import Node
from rwt_interfaces.registry import Registry
from rwt_protocol.codecs.quick_frames import PARSED_BYTES
from rwt_protocol.frames import Frame
from rwt_protocol.ops import Op
from rwt_protocol.session import Refusal
from tests.core.rosbridge.recording_client import Client

Decoded = tuple[Client, list[bytes]]

GOOD = '{"op":"publish","id":"1","topic":"/t","msg":{"data":1},"latch":false}'


def _publish(topic: str = "/t", msg: object = None, **others: object) -> str:
    fields = {"op": "publish", "topic": topic, "msg": {"data": 1} if msg is None else msg, **others}
    return json.dumps(fields, separators=(",", ":"))


@pytest.fixture(params=[0, 1_000], ids=["no rate limit", "a rate limit"])
def decoded(request: pytest.FixtureRequest, graph: MemoryGraph, monkeypatch: pytest.MonkeyPatch) -> Decoded:
    """A client, and how often its frames were read."""
    settings = Settings.model_validate({"limits": {"messages_per_second": request.param}})
    client = Client(Bridge(graph, settings))
    frames: list[bytes] = []
    real = client.peer._decode

    def decode(data: bytes, binary: bool, now: float) -> Sequence[Op | Refusal]:
        frames.append(data)
        return real(data, binary, now)

    monkeypatch.setattr(client.peer, "_decode", decode)
    return client, frames


@pytest.mark.parametrize(
    ("type_", "message"),
    [("std_msgs/Int32", {"data": 1}), ("std_msgs/Header", {"frame_id": "map"})],
    ids=["an exact message", "a message that is completed"],
)
def test_a_frame_is_read_once(decoded: Decoded, graph: MemoryGraph, type_: str, message: object) -> None:
    client, frames = decoded
    received: list[object] = []
    Node(graph, "robot").subscribe("/t", received.append, type_)
    client.say("advertise", topic="/t", type=type_)
    frames.clear()
    for _ in range(100):
        client.say_raw(_publish(msg=message))
    assert len(frames) == len(received) == 100


FRAMES = {
    "exact ones": [GOOD] * 3,
    "one that is completed": [GOOD, _publish(msg={}), GOOD],
    "one that is spelt otherwise": [GOOD, _publish(msg={"data": 1.0}), GOOD, GOOD],
    "one of a wrong type": [GOOD, _publish(msg={"data": "one"}, id="wrong"), GOOD],
    "one that is cut short": [GOOD, GOOD[:-20] + "}}", GOOD],
    "one with a member behind its payload": [GOOD, GOOD[:-15] + ',"topic":"/u","x":{"y":1}}', GOOD],
    "one with two payloads": [GOOD, '{"op":"publish","topic":"/t","msg":{"data":1},"msg":{"data":2}}'],
    "a member behind the payload of an unknown topic": [
        '{"op":"publish","topic":"/v","type":"std_msgs/Int32","msg":{"data":1},"type":"x","x":{"y":1}}'
    ],
    "a latched one": [GOOD, GOOD.replace("false", "true"), GOOD],
    "one that is nested too deeply": [GOOD, _publish(msg={"x": 1}).replace("1", "[" * 120 + "]" * 120)],
    "an id that is too long": [GOOD, GOOD.replace('"1"', f'"{"x" * 5000}"'), GOOD],
    "two in one frame": [GOOD, _publish() + _publish(msg={"data": 2}), GOOD],
    "NaN": [GOOD, GOOD.replace("1}", "NaN}")],
    "an unknown topic": [GOOD, _publish("/unknown")],
    "another topic": [GOOD, _publish("/u", {"data": 5}), GOOD, _publish("/u", {"data": 6})],
    "policies": [GOOD, _publish(qos={"depth": 5}), GOOD, GOOD],
    "a level between": [GOOD, '{"op":"set_level","level":"info"}', GOOD, _publish(msg={}), GOOD],
    "warnings between": [GOOD, '{"op":"set_level","level":"warning"}', GOOD, _publish(msg={}), GOOD],
    "an advertisement taken back": [GOOD, '{"op":"unadvertise","topic":"/t"}', GOOD, GOOD],
    "another type": [
        GOOD,
        '{"op":"unadvertise","topic":"/t"}',
        '{"op":"advertise","topic":"/t","type":"std_msgs/String"}',
        GOOD,
        _publish(msg={"data": "text"}),
        _publish(msg={"data": "text"}),
    ],
}


def _outcome(frames: list[str], distro_latch: bool, *, in_full: bool) -> list[object]:
    """Return the effects of frames: messages to the subscriber, answers to the client, and counts.

    Args:
        in_full: True to send them in binary frames, which do not become light ops.
    """
    clock = SimulatedClock(start_ns=1_700_000_000_000_000_000)
    bridge = Bridge(MemoryGraph(registry=Registry(), clock=clock), Settings())
    client, reader = Client(bridge), Client(bridge)
    for topic in ("/t", "/u"):
        client.say("advertise", topic=topic, type="std_msgs/Int32", latch=distro_latch)
        reader.say("subscribe", topic=topic)
    client.say("set_level", level="error")
    for frame in frames:
        client.say_raw(frame, binary=in_full)
    counted = {
        name: (counts.received, counts.received_bytes)
        for name, counts in client.peer.graph.counters.topics.items()
    }
    return [reader.heard(), client.heard(), counted, client.peer.messages]


def _with_long_ids(frame: str) -> str:
    """Return a frame whose `publish` is only matched at its ends."""
    return frame.replace('"id":"1",', "").replace('"publish",', f'"publish","id":"{"1" * PARSED_BYTES}",', 1)


@pytest.mark.parametrize("is_long", [False, True], ids=["short", "long"])
@pytest.mark.parametrize("latch", [False, True], ids=["volatile", "latched"])
@pytest.mark.parametrize("name", FRAMES)
def test_the_outcome_is_that_of_reading_in_full(name: str, latch: bool, is_long: bool) -> None:
    frames = [_with_long_ids(frame) for frame in FRAMES[name]] if is_long else FRAMES[name]
    quick, full = (_outcome(frames, latch, in_full=each) for each in (False, True))
    assert quick == full


@pytest.mark.parametrize(
    ("error", "answered"),
    [
        (RuntimeError("the network is gone"), "internal error"),
        (QuotaExceeded("too many bytes are kept"), "publish: too many bytes are kept"),
        (GateRefused("/t is stopped"), "publish: /t is stopped"),
    ],
    ids=["what is no refusal", "a quota", "the gate"],
)
def test_what_a_publisher_raises_is_answered(
    client: Client, error: Exception, answered: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.say("set_level", level="error")
    client.say("advertise", topic="/t", type="std_msgs/Int32")
    client.say_raw(GOOD)
    (publisher,) = client.peer.topics._publishers.values()

    def fail(payload: object) -> None:
        raise error

    monkeypatch.setattr(publisher, "publish", fail)
    client.heard()
    client.say_raw(GOOD)
    (answer,) = client.heard()
    assert (answer["level"], answer["id"], answer["msg"]) == ("error", "1", answered)


def test_a_role_that_may_not_publish_any_more_is_refused(graph: MemoryGraph, client: Client) -> None:
    seen: list[Sample] = []
    graph.participant("/listener").subscribe("/t", seen.append)
    client.say("set_level", level="error")
    client.say("advertise", topic="/t", type="std_msgs/Int32")
    client.say_raw(GOOD)
    client.say_raw(GOOD)
    client.peer.take_role(Role("guest", RoleSettings(publish=[])))
    client.say_raw(GOOD)
    assert len(seen) == 2
    assert [message["level"] for message in client.heard()] == ["error"]


def test_the_bytes_go_out_as_they_came(client: Client, other: Client) -> None:
    client.say("advertise", topic="/t", type="std_msgs/Int32")
    other.say("subscribe", topic="/t")
    for _ in range(2):
        client.say_raw('{"op":"publish","topic":"/t","msg":{ "data" : 1 }}')
    frames: list[Frame] = [frame for frame, _ in other.frames]
    assert [frame.data for frame in frames] == [b'{"op":"publish","topic":"/t","msg":{ "data" : 1 }}'] * 2


CALL = '{"op":"call_service","id":"7","service":"/add","args":{"a":1,"b":2}}'
CALLS = {
    "exact ones": [CALL] * 3,
    "no id": [CALL.replace('"id":"7",', "")],
    "an id that is null": [CALL.replace('"7"', "null")],
    "an id that is a number": [CALL.replace('"7"', "7")],
    "an id in the name": [CALL.replace('"id":"7",', "").replace("/add", "/add#9")],
    "no arguments": ['{"op":"call_service","id":"7","service":"/add"}'],
    "arguments by position": [CALL.replace('{"a":1,"b":2}', "[1,2]")],
    "arguments that are null": [CALL.replace('{"a":1,"b":2}', "null")],
    "arguments that do not fit": [CALL.replace("2", '"two"')],
    "arguments that are completed": [CALL.replace(',"b":2', "")],
    "arguments that are no JSON": [CALL.replace('"b"', '"\\b\\q"')],
    "NaN": [CALL.replace("2", "NaN")],
    "a type, which has no effect": [CALL.replace('"args"', '"type":"std_srvs/Trigger","args"')],
    "a timeout": [CALL.replace('"args"', '"timeout":3.5,"args"')],
    "a member that nobody knows": [CALL.replace('"args"', '"colour":"red","args"')],
    "two ids": [CALL.replace('"id":"7"', '"id":"7","id":"8"')],
    "two in one frame": [CALL + CALL],
    "no such service": [CALL.replace("/add", "/subtract")],
    "a service of a client": [CALL.replace("/add", "/remote")] * 2,
    "a name in another spelling": [CALL.replace("/add", "remote")],
    "cut short": [CALL[:-1]],
}
RESPONSE = '{"op":"service_response","id":"ID","service":"/remote","values":{"sum":3},"result":true}'
RESPONSES = {
    "an exact one": RESPONSE,
    "without a result": RESPONSE.replace(',"result":true', ""),
    "a failure": RESPONSE.replace("true", "false").replace('{"sum":3}', '"no"'),
    "a failure with an object": RESPONSE.replace("true", "false"),
    "values that do not fit": RESPONSE.replace("3", '"three"'),
    "values that are completed": RESPONSE.replace('"sum":3', ""),
    "values that are null": RESPONSE.replace('{"sum":3}', "null"),
    "an unknown id": RESPONSE.replace("ID", "other"),
    "an id that is a number": RESPONSE.replace('"ID"', "1"),
    "another service": RESPONSE.replace("/remote", "/add"),
}


def _answered(calls: list[str], response: str, *, in_full: bool) -> list[object]:
    """Return the effects of calls, and of the provider's answers; `in_full` as above."""
    clock = SimulatedClock(start_ns=1_700_000_000_000_000_000)
    graph = MemoryGraph(registry=Registry(), clock=clock)
    bridge = Bridge(graph, Settings())
    node = Node(graph, "adder")
    node.advertise_service(
        "/add", "example_interfaces/AddTwoInts", lambda request: {"sum": request.a + request.b}
    )
    client, provider = Client(bridge), Client(bridge)
    provider.say("advertise_service", service="/remote", type="example_interfaces/AddTwoInts")
    for each in (client, provider):
        each.say("set_level", level="error")
        each.heard()
    heard: list[object] = []
    for call in calls:
        client.say_raw(call, binary=in_full)
        for asked in provider.heard():
            heard.append(asked)
            provider.say_raw(response.replace("ID", asked["id"]), binary=in_full)
        clock.advance(100.0)
        heard += [client.heard(), provider.heard(), client.peer.messages, provider.peer.messages]
    return heard


@pytest.mark.parametrize("name", CALLS)
def test_the_outcome_of_a_call_is_that_of_reading_in_full(name: str) -> None:
    quick, full = (_answered(CALLS[name], RESPONSE, in_full=each) for each in (False, True))
    assert quick == full


@pytest.mark.parametrize("name", RESPONSES)
def test_the_outcome_of_a_response_is_that_of_reading_in_full(name: str) -> None:
    call = CALLS["a service of a client"]
    quick, full = (_answered(call, RESPONSES[name], in_full=each) for each in (False, True))
    assert quick == full
    assert len(quick) == 2 * 5  # The provider was asked twice.
