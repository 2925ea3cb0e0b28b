"""Honest messages of up to 10 MB are taken in full, however many objects they hold."""

from __future__ import annotations

import json
import struct
import tracemalloc

import bson
import cbor2
import pytest

from rwt import Settings
from rwt.rosbridge.bridge import Bridge
from rwt_graph.memory.graph import MemoryGraph
from tests.core.rosbridge.recording_client import Client

pytestmark = pytest.mark.slow

LARGEST = 10_000_000

STAMP = {"sec": 1, "nanosec": 2}
HEADER = {"stamp": STAMP, "frame_id": "map"}
POSE = {"position": {"x": 0.25, "y": 0.5, "z": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
STATUS = {
    "level": 0, "name": "motor", "message": "ok", "hardware_id": "",
    "values": [{"key": "volts", "value": "24.1"}, {"key": "amps", "value": "1.5"}],
}  # fmt: skip


def _publish(kind: str, members: str) -> bytes:
    return f'{{"op":"publish","topic":"/large","type":"{kind}","msg":{members}}}'.encode()


def _repeated(kind: str, name: str, item: object, count: int, header: object = HEADER) -> bytes:
    items = ",".join([json.dumps(item, separators=(",", ":"))] * count)
    return _publish(kind, f'{{"header":{json.dumps(header)},"{name}":[{items}]}}')


LARGE = {
    "Path": _repeated("nav_msgs/Path", "poses", {"header": HEADER, "pose": POSE}, 64_000),
    "PoseArray": _repeated("geometry_msgs/PoseArray", "poses", POSE, 112_000),
    "DiagnosticArray": _repeated("diagnostic_msgs/DiagnosticArray", "status", STATUS, 70_000),
    "PointCloud": _repeated("sensor_msgs/PointCloud", "points", {"x": 0.5, "y": 0.25, "z": -1.0}, 300_000)
    .replace(b'"points":', b'"channels":[],"points":'),
}  # fmt: skip


@pytest.fixture
def pair(bridge: Bridge) -> tuple[Client, Client]:
    """Publisher and subscriber."""
    publisher, subscriber = Client(bridge), Client(bridge)
    publisher.say("set_level", level="error")
    return publisher, subscriber


@pytest.mark.parametrize("kind", LARGE)
def test_a_message_of_very_many_objects_is_delivered_as_it_came(
    kind: str, pair: tuple[Client, Client]
) -> None:
    publisher, subscriber = pair
    data = LARGE[kind]
    assert 7_000_000 < len(data) < LARGEST
    start = data.index(b'"type":"') + 8
    subscriber.say("subscribe", topic="/large", type=data[start : data.index(b'"', start)].decode())
    publisher.say_raw(data)
    ((frame, topic),) = subscriber.frames
    assert topic == "/large" and publisher.heard() == []
    assert frame.data.endswith(data[data.index(b',"msg":') :])


def test_it_takes_memory_in_proportion_to_its_size(pair: tuple[Client, Client]) -> None:
    publisher, _ = pair
    tracemalloc.start()
    try:
        publisher.say_raw(LARGE["Path"])
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 6 * len(LARGE["Path"])


def test_one_that_must_be_completed_is_refused_by_the_setting(pair: tuple[Client, Client]) -> None:
    publisher, _ = pair
    publisher.say_raw(_repeated("nav_msgs/Path", "poses", {"header": HEADER, "pose": POSE}, 30_000, {}))
    (status,) = publisher.heard()
    assert status["msg"] == (
        "publish.msg: more than 262144 brackets (limits.structure_bytes): so many are taken only in a message"
        " that has every field of nav_msgs/Path, each as ROS writes it"
    )


def test_it_is_completed_where_the_setting_allows_it(graph: MemoryGraph) -> None:
    limits = {"structure_bytes": 1_000_000}
    bridge = Bridge(graph, Settings.model_validate({"limits": limits}))
    publisher, subscriber = Client(bridge), Client(bridge)
    subscriber.say("subscribe", topic="/large", type="nav_msgs/Path")
    publisher.say_raw(_repeated("nav_msgs/Path", "poses", {"header": HEADER, "pose": POSE}, 30_000, {}))
    ((frame, _),) = subscriber.frames
    assert len(json.loads(frame.data)["msg"]["poses"]) == 30_000


def test_a_text_of_brackets_is_a_text(pair: tuple[Client, Client]) -> None:
    publisher, subscriber = pair
    subscriber.say("subscribe", topic="/large", type="rcl_interfaces/Log")
    publisher.say("set_level", level="warning")
    publisher.say_raw(_publish("rcl_interfaces/Log", '{"name":"n","msg":"' + "[{" * 1_000_000 + '"}'))
    assert publisher.heard() == []
    ((frame, _),) = subscriber.frames
    assert json.loads(frame.data)["msg"]["msg"] == "[{" * 1_000_000


@pytest.mark.parametrize(("tag", "code"), [(84, "<e"), (85, "<f"), (81, ">f"), (86, "<d")])
def test_a_long_typed_array_takes_memory_in_proportion_to_its_size(
    tag: int, code: str, pair: tuple[Client, Client]
) -> None:
    publisher, subscriber = pair
    each = struct.pack(code, 0.5)
    count = 4_000_000 // len(each)
    kind = "std_msgs/Float32MultiArray"
    msg = {"data": cbor2.CBORTag(tag, each * count)}
    data = cbor2.dumps({"op": "publish", "topic": "/large", "type": kind, "msg": msg})
    tracemalloc.start()
    try:
        publisher.say_raw(data, binary=True)
        subscriber.say("subscribe", topic="/large", type=kind)
        publisher.say_raw(data, binary=True)
        ((frame, _),) = subscriber.frames
        size = frame.size
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert publisher.heard() == []
    assert 4 * count < size < 4 * count + 200
    assert peak < 30 * count + LARGEST


def test_a_document_of_bson_is_bounded_before_it_is_decoded(graph: MemoryGraph) -> None:
    bridge = Bridge(graph, Settings.model_validate({"bson_only_mode": True}))
    client = Client(bridge)

    def answer(value: object) -> str:
        message = {"op": "publish", "topic": "/a", "type": "std_msgs/String", "msg": {"data": value}}
        client.say_raw(bson.encode({"op": "set_level", "level": "error"}), binary=True)
        client.say_raw(bson.encode(message), binary=True)
        told = [bson.decode(frame.data)["msg"] for frame, _ in client.frames]
        client.frames.clear()
        return str(told)

    assert answer("x" * 5_000_000) == "[]"
    assert "expected string" in answer([0.5] * 100_000)
    assert "(limits.structure_bytes)" in answer([{}] * 100_000)
    assert "(limits.structure_bytes)" in answer([[]] * 100_000)
    assert "(limits.structure_bytes)" in answer({str(number): None for number in range(100_000)})
    assert "(limits.structure_bytes)" in answer([bson.Timestamp(1, 1)] * 100_000)
    assert "not BSON" in answer([bson.Code("")] * 10_000)
