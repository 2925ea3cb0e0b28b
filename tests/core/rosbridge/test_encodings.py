"""Messages of a subscriber for each `compression`: by the shared frames and by independent decoders."""

from __future__ import annotations

import base64
import io
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cbor2
import numpy as np
import pytest
from PIL import Image
from rosbags.typesys import Stores, get_typestore

from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from rwt_protocol import codecs
from rwt_protocol.codecs import ENCODINGS, Encoding
from rwt_protocol.codecs.base import PublishEncoder
from rwt_protocol.frames import Frame
from rwt_protocol.payloads import PublishedMessage
from tests.core.rosbridge.recording_client import Client

SHARED = json.loads((Path(__file__).parents[1] / "protocol" / "examples.json").read_text())
STORES = {"noetic": get_typestore(Stores.ROS1_NOETIC), "jazzy": get_typestore(Stores.ROS2_JAZZY)}

#: By the name of a shared frame: distribution, type, and the message as a client publishes it.
PUBLISHED: dict[str, tuple[str, str, dict[str, object]]] = {
    "cbor-string": ("jazzy", "std_msgs/String", {"data": "hi"}),
    "cbor-uint8-array": ("jazzy", "t_msgs/Octets", {"data": "AAEC/w=="}),
    "cbor-float32-array": ("jazzy", "t_msgs/Ranges", {"ranges": [1.0, 2.5, math.inf]}),
    "cbor-int64-array": ("jazzy", "t_msgs/Longs", {"v": [-1, 9007199254740993]}),
    "cbor-time-ros1": ("noetic", "std_msgs/Time", {"data": {"secs": 5, "nsecs": 7}}),
    "cbor-time-ros2": ("jazzy", "builtin_interfaces/Time", {"sec": 5, "nanosec": 7}),
    "cbor-raw-ros1-string": ("noetic", "std_msgs/String", {"data": "hi"}),
    "cbor-raw-ros2-string": ("jazzy", "std_msgs/String", {"data": "hi"}),
}


def bridge_of(distro: str, start_ns: int = 1_700_000_000_000_000_000) -> Bridge:
    registry = Registry(DISTROS[distro])
    registry.add_text("uint8[] data", "t_msgs/Octets", "msg")
    registry.add_text("float32[] ranges", "t_msgs/Ranges", "msg")
    registry.add_text("int64[] v", "t_msgs/Longs", "msg")
    return Bridge(MemoryGraph(registry=registry, clock=SimulatedClock(start_ns=start_ns)), Settings())


def frames_of(client: Client) -> list[Frame]:
    taken = [frame for frame, _ in client.frames]
    client.frames.clear()
    return taken


def text_in_picture(frame: Frame) -> str:
    message = json.loads(frame.data)
    assert message.keys() == {"op", "data"} and message["op"] == "png"
    with Image.open(io.BytesIO(base64.b64decode(message["data"], validate=True))) as image:
        assert image.mode == "RGB" and image.info == {}
        width, height = image.size
        pixels = image.tobytes()
    text = pixels.decode("ascii")
    inner = text.rstrip("\n")
    assert width == math.floor(math.sqrt(len(inner) / 3))
    assert height == math.ceil(len(inner) / 3 / width)
    return inner


def decoded(compression: str, frame: Frame) -> dict[str, Any]:
    """The message in a frame, read by somebody else's decoder."""
    assert frame.binary is compression.startswith("cbor")
    found: dict[str, Any]
    if compression.startswith("cbor"):
        found = cbor2.loads(frame.data, tag_hook=lambda tag, immutable: typed(tag))
    else:
        found = json.loads(text_in_picture(frame) if compression == "png" else frame.data)
    return found


def typed(tag: cbor2.CBORTag) -> list[float]:
    kinds = {64: "u1", 69: "<u2", 70: "<u4", 71: "<u8", 72: "i1", 77: "<i2", 78: "<i4", 79: "<i8",
             85: "<f4", 86: "<f8"}  # fmt: skip
    numbers: list[float] = np.frombuffer(tag.value, kinds[tag.tag]).tolist()
    return numbers


@pytest.mark.parametrize("example", SHARED["cbor"], ids=lambda example: str(example["name"]))
def test_the_shared_frames_to_the_byte(example: dict[str, Any]) -> None:
    distro, type_name, message = PUBLISHED[example["name"]]
    client = Client(bridge_of(distro, 5_000_000_007))
    topic = example["decoded"]["topic"]
    compression = "cbor-raw" if "raw" in example["name"] else "cbor"
    client.say("subscribe", topic=topic, type=type_name, compression=compression)
    client.say("advertise", topic=topic, type=type_name)
    if "float32" in example["name"]:
        # Infinity is not JSON, so this one is said in CBOR.
        op = {"op": "publish", "topic": topic, "msg": message}
        client.say_raw(cbor2.dumps(op), binary=True)
    else:
        client.say("publish", topic=topic, msg=message)
    (frame,) = frames_of(client)
    assert frame.data.hex() == example["hex"]
    assert frame.binary


ODOMETRY = {
    "header": {"frame_id": "odom"},
    "child_frame_id": "base",
    "pose": {"pose": {"position": {"x": 1.5}}, "covariance": [float(n) for n in range(36)]},
}
IMU = {"header": {"frame_id": "imu"}, "orientation_covariance": [0.5] * 9, "linear_acceleration": {"z": 9.81}}
JOINTS = {"header": {"frame_id": ""}, "name": ["left", "größe"], "position": [0.25, -1.0], "velocity": []}
GRID = {"header": {"frame_id": "map"}, "info": {"width": 3, "height": 1}, "data": [-1, 0, 100]}
CLOUD = {
    "header": {"frame_id": "lidar"},
    "width": 2,
    "fields": [{"name": "x", "datatype": 7, "count": 1}],
    "data": "AAECAwQFBgc=",
}
STANDARD: dict[str, dict[str, Any]] = {
    "nav_msgs/Odometry": ODOMETRY,
    "sensor_msgs/Imu": IMU,
    "sensor_msgs/JointState": JOINTS,
    "nav_msgs/OccupancyGrid": GRID,
    "sensor_msgs/PointCloud2": CLOUD,
}


def octets_as_text(value: object) -> object:
    """The same as JSON has it."""
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if isinstance(value, dict):
        return {key: octets_as_text(each) for key, each in value.items()}
    return [octets_as_text(each) for each in value] if isinstance(value, list) else value


@pytest.mark.parametrize("distro", ["jazzy", "noetic"])
@pytest.mark.parametrize("type_name", list(STANDARD))
def test_each_encoding_carries_the_same_message(distro: str, type_name: str) -> None:
    bridge = bridge_of(distro)
    listeners = {name: Client(bridge) for name in ("none", "png", "cbor", "cbor-raw")}
    for name, listener in listeners.items():
        listener.say("subscribe", topic="/t", type=type_name, compression=name)
    listeners["none"].say("publish", topic="/t", msg=STANDARD[type_name])
    ((plain,), (picture,), (cbor,), (raw,)) = (frames_of(listener) for listener in listeners.values())
    said = decoded("none", plain)
    assert said["msg"]["header"]["frame_id"] == STANDARD[type_name]["header"]["frame_id"]
    assert decoded("png", picture) == said
    assert octets_as_text(decoded("cbor", cbor)) == said
    found = decoded("cbor-raw", raw)
    assert list(found) == ["op", "topic", "msg"] and list(found["msg"]) == ["secs", "nsecs", "bytes"]
    assert (found["msg"]["secs"], found["msg"]["nsecs"]) == (1_700_000_000, 0)
    store = STORES[distro]
    name = type_name.replace("/", "/msg/")
    data = found["msg"]["bytes"]
    message: Any = (
        store.deserialize_ros1(data, name) if distro == "noetic" else store.deserialize_cdr(data, name)
    )
    again = store.serialize_ros1(message, name) if distro == "noetic" else store.serialize_cdr(message, name)
    assert bytes(again) == data
    if distro == "jazzy":
        assert data[:4] == b"\0\1\0\0"
    assert message.header.frame_id == said["msg"]["header"]["frame_id"]


def test_a_latched_message_comes_in_the_encoding_that_was_asked_for(client: Client, other: Client) -> None:
    other.say("advertise", topic="/s", type="std_msgs/String", latch=True)
    other.say("publish", topic="/s", msg={"data": "kept"})
    client.say("subscribe", topic="/s", compression="cbor")
    (frame,) = frames_of(client)
    assert decoded("cbor", frame)["msg"] == {"data": "kept"}


def test_one_encode_for_each_encoding_whatever_the_number_of_clients(
    monkeypatch: pytest.MonkeyPatch, connect: Callable[[], Client]
) -> None:
    encoded: list[str] = []

    def counting(encoding: Encoding) -> Encoding:
        def encoder(topic: str) -> PublishEncoder:
            encode = encoding.publish_encoder(topic)

            def count(sample: PublishedMessage) -> Frame:
                encoded.append(encoding.name)
                return encode(sample)

            return count

        return replace(encoding, publish_encoder=encoder)

    table = {name: counting(each) for name, each in ENCODINGS.items() if each.exclusive is None}
    monkeypatch.setattr(codecs, "ENCODINGS", table)
    listeners = [connect() for _ in range(9 * len(table))]
    for number, listener in enumerate(listeners):
        compression = list(table)[number % len(table)]
        size = 10 if number % 3 else 20
        listener.say(
            "subscribe", topic="/n", type="std_msgs/Int32", compression=compression, fragment_size=size
        )
    for number in range(3):
        listeners[0].say("publish", topic="/n", msg={"data": number})
    assert sorted(encoded) == sorted(list(table) * 3)
    for number, listener in enumerate(listeners):
        twin = listeners[(number + 3 * len(table)) % len(listeners)]
        ours, theirs = ([frame for frame, _ in each.frames] for each in (listener, twin))
        assert ours and all(one is same for one, same in zip(ours, theirs, strict=True))


# CBOR from clients


def test_a_client_may_publish_in_cbor(client: Client) -> None:
    client.say("subscribe", topic="/o", type="nav_msgs/Odometry")
    covariance = cbor2.CBORTag(86, np.arange(36, dtype="<f8").tobytes())
    message = {"pose": {"covariance": covariance, "pose": {"position": {"x": 1, "y": math.nan}}}}
    client.say_raw(cbor2.dumps({"op": "publish", "topic": "/o", "msg": message}), binary=True)
    (heard,) = client.heard_of("/o")
    assert heard["pose"]["covariance"] == list(range(36))
    assert heard["pose"]["pose"]["position"] == {"x": 1.0, "y": None, "z": 0.0}


def test_octets_in_cbor_and_not_a_number_reach_cbor_subscribers_as_they_are(client: Client) -> None:
    client.say("subscribe", topic="/o", type="sensor_msgs/LaserScan", compression="cbor")
    ranges = cbor2.CBORTag(85, np.array([1, math.nan, math.inf], "<f4").tobytes())
    client.say_raw(cbor2.dumps({"op": "publish", "topic": "/o", "msg": {"ranges": ranges}}), binary=True)
    (frame,) = frames_of(client)
    one, nan, infinity = decoded("cbor", frame)["msg"]["ranges"]
    assert one == 1 and math.isnan(nan) and infinity == math.inf


def test_any_op_may_come_in_cbor(client: Client, graph: MemoryGraph) -> None:
    asked = {"op": "subscribe", "topic": "/s", "type": "std_msgs/String", "compression": "cbor"}
    client.say_raw(cbor2.dumps(asked), binary=True)
    client.say_raw(json.dumps({"op": "publish", "topic": "/s", "msg": {"data": "x"}}), binary=True)
    (frame,) = frames_of(client)
    assert decoded("cbor", frame)["msg"] == {"data": "x"}
    for id_, args in (("by name", {"a": 1, "b": 2}), ("by place", [1, 2]), ("none", None)):
        call = {"op": "call_service", "service": "/add", "id": id_, "args": args}
        graph.node("adder").advertise_service(
            "/add", "example_interfaces/AddTwoInts", lambda request: {"sum": request.a + request.b}
        )
        client.say_raw(cbor2.dumps(call), binary=True)
        (answer,) = client.heard()
        assert answer["result"] is True and answer["id"] == id_
        assert answer["values"] == {"sum": 0 if args is None else 3}


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        ({"data": 5}, "publish.msg.data: expected string, got 5"),
        ({"data": b"x"}, "publish.msg.data: expected string, got bytes"),
        ({"data": cbor2.undefined}, "publish.msg.data: expected string, got UndefinedType"),
        ({"bogus": 1}, 'publish.msg: std_msgs/String has no field "bogus"; it has data'),
        (["x"], "publish.msg: expected an object, got an array"),
        ("x", "publish.msg: expected an object, got a string"),
        (None, "publish.msg: expected an object, got null"),
    ],
)
def test_what_does_not_fit_is_refused_by_its_path(client: Client, message: object, reason: str) -> None:
    client.say("set_level", level="error")
    client.say("advertise", topic="/s", type="std_msgs/String")
    client.say_raw(cbor2.dumps({"op": "publish", "topic": "/s", "msg": message}), binary=True)
    (status,) = client.heard()
    assert status["msg"] == reason


def test_a_service_of_a_client_may_answer_in_cbor(client: Client, other: Client) -> None:
    client.say("advertise_service", service="/s", type="std_srvs/Trigger")
    for values, result, told in (
        ({"success": True, "message": "ok"}, True, {"success": True, "message": "ok"}),
        ("no power", False, "no power"),
        ({"code": 7}, False, '{"code":7}'),
        ({}, False, "the service failed and gave no reason"),
    ):
        other.say("call_service", service="/s", id="c")
        (call,) = client.heard()
        response = {"op": "service_response", "service": "/s", "id": call["id"], "values": values}
        client.say_raw(cbor2.dumps(response | {"result": result}), binary=True)
        (answer,) = other.heard()
        assert (answer["result"], answer["values"]) == (result, told)
