"""CBOR frames, out by splicing and in as the same ops."""

from __future__ import annotations

import json
import math
import random
import struct
from collections.abc import Callable
from typing import Any

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.codecs.base import DecodeFailure
from rwt_protocol.codecs.cbor import CborCodec, publish_frame, publish_prefix
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Direction, Publish, ServiceResponse, Subscribe
from rwt_protocol.payloads import FEW_BYTES, Decoded, RawJson
from rwt_protocol.session import Refusal, Session
from tests.conftest import counted
from tests.core.protocol.wire_examples import EXAMPLES, CborFrame, only


def one(data: bytes) -> object:
    (found,) = Session().decode(data, True, 0.0)
    return found


def reason(data: bytes) -> str:
    found = only(Session().decode(data, True, 0.0), Refusal)
    return found.reason


@pytest.mark.parametrize("example", EXAMPLES.cbor, ids=lambda example: str(example.name))
def test_the_shared_frames_are_built_by_splicing(example: CborFrame) -> None:
    whole = bytes.fromhex(example.hex)
    prefix = publish_prefix(example.decoded["topic"])
    body = whole[len(prefix) :]
    frame = publish_frame(prefix, body)
    assert frame.binary
    assert frame.data == whole
    assert frame.parts[1] is body


_PAYLOADS: dict[str, dict[str, object]] = {
    "cbor-string": {"data": "hi"},
    "cbor-uint8-array": {"data": b"\x00\x01\x02\xff"},
    "cbor-float32-array": {"ranges": [1.0, 2.5, math.inf]},
    "cbor-int64-array": {"v": [-1, 9007199254740993]},
    "cbor-time-ros1": {"data": {"secs": 5, "nsecs": 7}},
    "cbor-time-ros2": {"sec": 5, "nanosec": 7},
    "cbor-raw-ros1-string": {"secs": 5, "nsecs": 7, "bytes": b"\x02\x00\x00\x00hi"},
    "cbor-raw-ros2-string": {"secs": 5, "nsecs": 7, "bytes": b"\x00\x01\x00\x00\x03\x00\x00\x00hi\x00"},
}


@pytest.mark.parametrize("example", EXAMPLES.cbor, ids=lambda example: str(example.name))
def test_the_shared_frames_are_read(example: CborFrame) -> None:
    whole = bytes.fromhex(example.hex)
    payload = Decoded(_PAYLOADS[example.name])
    assert one(whole) == Publish(topic=example.decoded["topic"], msg=payload)
    for end in range(1, len(whole)):
        assert reason(whole[:end]).startswith("not CBOR: malformed")
    assert reason(whole + b"\x01") == "not CBOR: more than one value in the frame"


@pytest.mark.parametrize("size", [0, 23, 24, 255, 256, 65535, 65536])
def test_topics_of_any_length(size: int) -> None:
    topic = "é" * (size // 2) + "x" * (size % 2)
    frame = publish_frame(publish_prefix(topic), cbor2.dumps({}))
    assert cbor2.loads(frame.data) == {"op": "publish", "topic": topic, "msg": {}}


@pytest.mark.parametrize(
    ("tag", "code"),
    [(65, ">H"), (66, ">I"), (67, ">Q"), (69, "<H"), (70, "<I"), (71, "<Q"), (72, "<b"), (73, ">h"),
     (74, ">i"), (75, ">q"), (77, "<h"), (78, "<i"), (79, "<q"), (80, ">e"), (81, ">f"), (82, ">d"),
     (84, "<e"), (85, "<f"), (86, "<d")],
)  # fmt: skip
def test_typed_arrays_of_both_byte_orders(tag: int, code: str) -> None:
    data = struct.pack(f"{code[0]}3{code[1]}", 1, 2, 3)
    message = {"op": "publish", "topic": "/a", "msg": {"v": cbor2.CBORTag(tag, data)}}
    op = only(Session().decode(cbor2.dumps(message), True, 0.0), Publish)
    assert op.msg == Decoded({"v": [1, 2, 3]})
    if struct.calcsize(code) > 1:
        message["msg"] = {"v": cbor2.CBORTag(tag, data[1:])}
        assert reason(cbor2.dumps(message)).startswith("not CBOR: malformed")


@pytest.mark.parametrize(
    "message",
    [
        {"op": "subscribe", "topic": "/a", "id": 5},
        {"op": "subscribe", "topic": "/a", "id": 5, b"7": 8, "x": b""},
    ],
)
def test_any_op_is_read(message: dict[Any, Any]) -> None:
    assert one(cbor2.dumps(message)) == Subscribe(topic="/a", id=5)


@pytest.mark.parametrize("key", [7, 1 << 70, -(1 << 70), (1, 2), 0.5, None, True])
def test_keys_that_are_no_strings_are_refused_before_they_can_collide(key: object) -> None:
    message = {"op": "publish", "topic": "/a", "msg": {"data": {key: 1}}}
    assert reason(cbor2.dumps(message)).startswith("not CBOR: malformed, nested too deeply, with a key")


_ITEMS = [b"\xa0", b"\x80", b"\x81\x80", b"\xa1\x60\x80", b"\x61a", b"\x59\x03\x00" + bytes(768)]


@pytest.mark.parametrize("item", _ITEMS)
def test_small_items_are_bounded_in_bytes_and_long_strings_are_not(item: bytes) -> None:
    count = 95_000 // len(item)
    data = b"\xa3\x62op\x67publish\x65topic\x62/a\x63msg\x9a" + count.to_bytes(4, "big") + item * count
    most = WireLimits(structure_bytes=90_000)
    assert only(Session(limits=most).decode(data, True, 0.0), Refusal).reason == (
        "more than 90000 bytes beside long strings and typed arrays, or more than 15000 arrays and maps"
        " (limits.structure_bytes)"
    )
    more = WireLimits(structure_bytes=600_000)
    only(Session(limits=more).decode(data, True, 0.0), Publish)
    octets = {"a": bytes(200_000), "b": cbor2.CBORTag(70, bytes(200_000))}
    message = cbor2.dumps({"op": "publish", "topic": "/a", "msg": octets})
    only(Session(limits=most).decode(message, True, 0.0), Publish)


_HEAD = b"\xa3\x62op\x67publish\x65topic\x62/a\x63msg\x9a"


@pytest.mark.parametrize(
    ("item", "count", "is_taken"),
    [
        (b"\x81" * 95 + b"\x80", 2_600, False),
        (b"\x81\x80", 40_000, False),
        (b"\x81\x80", 20_000, True),
        (b"\xf8\x20", 60_000, False),  # simple values
        (b"\x9f\xff", 70_000, False),  # of indefinite length
        (b"\xb9\x00\x00", 70_000, False),
        (b"\xa1\x61x\xfb\x80\x90\xa0\xb0\xc0\xd0\x80\x90", 20_000, True),  # numbers that look like heads
        (b"\xfb\x80\x90\xa0\xb0\xc0\xd0\x80\x90", 29_000, True),
        (b"\x63\xe6\xbc\xa2", 60_000, True),  # texts that do
    ],
)
def test_arrays_and_maps_are_bounded_in_number(item: bytes, count: int, is_taken: bool) -> None:
    (found,) = Session().decode(_HEAD + count.to_bytes(4, "big") + item * count, True, 0.0)
    assert isinstance(found, Publish) is is_taken


def test_the_text_of_a_failure() -> None:
    message = {"op": "service_response", "service": "/s", "values": "why", "result": False, "id": "a"}
    assert one(cbor2.dumps(message)) == ServiceResponse(service="/s", values="why", result=False, id="a")


def test_what_is_wrong_is_addressed() -> None:
    found = one(cbor2.dumps({"op": "call_service", "service": b"/s", "id": 3}))
    assert isinstance(found, Refusal)
    assert (found.op, found.id) == ("call_service", 3)
    assert found.reason.startswith("call_service.service: expected a string, got ")


@pytest.mark.parametrize("tag", [*range(64), 76, 83, *range(87, 300), 1004, 43000, 55800])
def test_tags_that_ros_has_not_are_refused(tag: int) -> None:
    if tag in (2, 3):
        return
    values: list[object] = [1, "a", b"a", [1, 2], {}]
    for value in values:
        found = one(b"\xa2\x62op\x67publish\x63msg" + _tagged(tag, value))
        assert isinstance(found, Refusal)


def _tagged(tag: int, value: object) -> bytes:
    if tag < 24:
        return bytes((0xC0 | tag,)) + cbor2.dumps(value)
    head = b"\xd8" + bytes((tag,)) if tag < 256 else b"\xd9" + tag.to_bytes(2, "big")
    return head + cbor2.dumps(value)


def test_a_shared_reference_cannot_make_a_cycle() -> None:
    cycle: list[object] = []
    cycle.append(cycle)
    data = cbor2.dumps({"op": "publish", "topic": "/a", "msg": cycle}, value_sharing=True)
    assert isinstance(one(data), Refusal)


@pytest.mark.parametrize("data", [b"\xa1" * 200_000, b"\xa1\x61a" + b"\x81" * 200_000, b"\xbb" + b"\xff" * 8])
def test_bombs_are_refused(data: bytes) -> None:
    assert reason(data).startswith("not CBOR: malformed")


@given(st.binary(max_size=60), st.sampled_from(EXAMPLES.cbor), st.integers(0, 60))
def test_any_damaged_frame_is_an_op_or_a_refusal(damage: bytes, example: CborFrame, place: int) -> None:
    whole = bytes.fromhex(example.hex)
    assert len(Session().decode(whole[:place] + damage + whole[place + len(damage) :], True, 0.0)) <= 1001
    assert len(CborCodec().split(b"\xa1" + damage, WireLimits())) == 1


@given(st.text(), st.dictionaries(st.text(), st.integers(-(2**63), 2**64 - 1) | st.text() | st.booleans()))
def test_what_is_written_is_read_back(topic: str, members: dict[str, object]) -> None:
    op = Publish(topic=topic, id="i", msg=RawJson(json.dumps(members, separators=(",", ":")).encode()))
    frame = CborCodec().encode(op)
    assert frame.binary
    found = only(Session(direction=Direction.TO_CLIENT).decode(frame.data, True, 0.0), Publish)
    assert (found.topic, found.msg) == (topic, Decoded(members))


_SCALARS = (1, -500, 2.5, "short", "x" * 300, b"y" * 3000, True, None, 2**40)


def _random_value(source: random.Random, level: int, most: int) -> object:
    if level > 3 or source.random() < 0.3:
        return source.choice(_SCALARS)
    inside = [_random_value(source, level + 1, 12) for _ in range(source.randrange(most))]
    return inside if source.random() < 0.5 else {str(n): each for n, each in enumerate(inside)}


def _endless(value: object) -> bytes:
    """CBOR whose arrays and maps have no length."""
    if isinstance(value, list):
        return b"\x9f" + b"".join(map(_endless, value)) + b"\xff"
    if isinstance(value, dict):
        pairs = (cbor2.dumps(name) + _endless(each) for name, each in value.items())
        return b"\xbf" + b"".join(pairs) + b"\xff"
    return cbor2.dumps(value)


def _nested(levels: int, inside: object) -> object:
    return inside if levels == 0 else _nested(levels - 1, [inside, 1])


_SOURCE = random.Random(5)
_LARGE_VALUES: dict[str, object] = {
    **{f"random {n}": [_random_value(_SOURCE, 1, 30) for _ in range(40)] for n in range(2)},
    "numbers": [1.5] * 20_000,
    "large in large": [[n] * 9_000 for n in range(13)],
    "names": {str(n): n for n in range(12_000)},
    "deep": _nested(40, [7] * 70_000),
}


@pytest.mark.parametrize("write", [cbor2.dumps, _endless], ids=["lengths", "no lengths"])
@pytest.mark.parametrize("kind", _LARGE_VALUES)
def test_a_large_frame_in_steps_is_what_it_is_at_once(kind: str, write: Callable[[object], bytes]) -> None:
    message = {"op": "publish", "topic": "/a", "msg": {"a": _LARGE_VALUES[kind], "b": 1}}
    data = write(message)
    assert len(data) > FEW_BYTES
    (members,), count = counted(CborCodec().split_in_steps(data, WireLimits(structure_bytes=1 << 24)))
    assert count > 1 and isinstance(members, dict)
    assert members["msg"] == Decoded(message["msg"])
    only(CborCodec().split(data[:-3], WireLimits(structure_bytes=1 << 24)), DecodeFailure)
    (doubled,) = CborCodec().split(data + b"\x01", WireLimits(structure_bytes=1 << 24))
    assert isinstance(doubled, DecodeFailure) and "more than one value" in doubled.reason


def test_no_step_reads_much() -> None:
    data = cbor2.dumps({"op": "publish", "topic": "/a", "msg": {"a": _LARGE_VALUES["large in large"]}})
    assert len(list(CborCodec().split_in_steps(data, WireLimits()))) > len(data) // 8192


def test_what_is_too_deep_is_refused_in_steps_too() -> None:
    data = cbor2.dumps({"op": "publish", "topic": "/a", "msg": {"a": _LARGE_VALUES["deep"]}})
    only(CborCodec().split(data, WireLimits(max_depth=40)), DecodeFailure)
