"""CBOR, CDR and ROS 1's own form, against independent encoders: cbor2 and rosbags."""

from __future__ import annotations

import contextlib
import math
import struct
from collections.abc import Callable
from random import Random
from typing import Any

import cbor2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from rwt_interfaces import field_types
from rwt_interfaces.distro import JAZZY, NOETIC
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.struct_fields import time_struct
from rwt_interfaces.structs import MessageType

REGISTRIES = {1: Registry(NOETIC), 2: Registry(JAZZY)}
STORES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_JAZZY)}
REGISTRIES[2].add_text(
    "string<=5[<=2] s\nuint8[<=3] u\nbyte[] b\nbool[2] f\nwstring w\nint8[] i", "t_msgs/Odd"
)
REGISTRIES[2].add_text(
    'wstring a\nwstring b "Hello world!"\nwstring c "Hellö wörld!"\nwstring d "ハローワールド"\n'
    "wstring[3] fixed\nwstring[<=3] few\nwstring[] many",
    "t_msgs/Wide",
)
REGISTRIES[2].add_text("", "t_msgs/Nothing")
REGISTRIES[2].add_text("Nothing n\nuint8 a\nNothing[] ns\nfloat64 d\nNothing m", "t_msgs/Holder")
REGISTRIES[1].add_text("time[] t\nduration d\nbyte[] b\nstring[2] s\nfloat32[2] f", "t_msgs/Old")
REGISTRIES[1].add_text("", "t_msgs/Nothing")
REGISTRIES[1].add_text("Nothing n\nNothing[] ns", "t_msgs/Holder")

FORMS: dict[str, tuple[Callable[[Payload], bytes], Callable[[MessageType, bytes], Payload]]] = {
    "cbor": (Payload.cbor, Payload.from_cbor),
    "cdr": (Payload.cdr, Payload.from_cdr),
    "ros1": (lambda payload: payload.type.to_ros1(payload.value()), Payload.from_ros1),
}


# Any message of a type


def message(kind: MessageType, chance: Random) -> Any:
    if kind.time is not None:
        return value(kind.time, chance)
    return kind.struct(*[value(slot.type, chance) for slot in kind.slots])


def value(field_type: field_types.FieldType, chance: Random) -> Any:
    match field_type:
        case field_types.Bool():
            return chance.random() < 0.5
        case field_types.Int():
            edges = (
                0,
                1,
                23,
                24,
                255,
                256,
                65535,
                65536,
                field_type.low,
                field_type.high,
                chance.randint(field_type.low, field_type.high),
            )
            return min(max(chance.choice(edges), field_type.low), field_type.high)
        case field_types.Float():
            number = chance.choice((0.0, -0.0, 1.5, -2.0, chance.uniform(-1e30, 1e30), chance.random()))
            return struct.unpack("<f", struct.pack("<f", number))[0] if field_type.code == "f" else number
        case field_types.String():
            letters = chance.choices('aé€😀\\"\n/', k=chance.choice((0, 1, 2, 3, 5, 30)))
            return "".join(letters)[: field_type.bound]
        case field_types.Time():
            return time_struct(field_type)(
                value(field_type.seconds, chance), value(field_type.nanoseconds, chance)
            )
        case field_types.Octets():
            return chance.randbytes(
                chance.choice((0, 1, 3, 30, 600)) if field_type.length is None else field_type.length
            )
        case field_types.Message():
            return message(field_type.type, chance)
        case field_types.Array():
            count = chance.randint(0, min(3 if field_type.bound is None else field_type.bound, 3))
            return [
                value(field_type.element, chance)
                for _ in range(count if field_type.length is None else field_type.length)
            ]


def every_type() -> list[Any]:
    return [
        pytest.param(version, name, id=f"{registry.distro.name}-{name}")
        for version, registry in REGISTRIES.items()
        for name in registry.names("msg")
    ]


# The oracles' view of a message


def for_cbor2(value: Any, field_type: field_types.FieldType, version: int) -> Any:
    match field_type:
        case field_types.Time():
            return {key: getattr(value, key) for key in field_type.keys}
        case field_types.Message():
            return as_mapping(value, field_type.type, version)
        case field_types.Array(element=field_types.Int(name="uint8" | "char")):
            return bytes(value)
        case field_types.Array(element=field_types.Int() | field_types.Float() as element):
            tags = {
                "int8": 72,
                "byte": 72 if version == 1 else 64,
                "uint16": 69,
                "uint32": 70,
                "uint64": 71,
                "int16": 77,
                "int32": 78,
                "int64": 79,
                "float32": 85,
                "float64": 86,
            }
            return cbor2.CBORTag(tags[element.name], struct.pack(f"<{len(value)}{element.code}", *value))
        case field_types.Array():
            return [for_cbor2(item, field_type.element, version) for item in value]
        case _:
            return value


def as_mapping(value: Any, kind: MessageType, version: int) -> Any:
    if kind.time is not None:
        return for_cbor2(value, kind.time, version)
    return {slot.name: for_cbor2(getattr(value, slot.attribute), slot.type, version) for slot in kind.slots}


def for_rosbags(value: Any, field_type: field_types.FieldType, store: Any) -> Any:
    match field_type:
        case field_types.Time():
            name = "Duration" if field_type.is_duration else "Time"
            # rosbags has one time for both versions of ROS: the same bytes, with other signs.
            unsigned = [getattr(value, key) % 2**32 for key in field_type.keys]
            halves = struct.unpack("<iI", struct.pack("<II", *unsigned))
            return store.types[f"builtin_interfaces/msg/{name}"](*halves)
        case field_types.Octets():
            return np.frombuffer(value, np.uint8)
        case field_types.Int(name="byte"):
            return (value + 128) % 256 - 128  # rosbags takes ROS 2's byte for a signed one.
        case field_types.Message():
            return rosbags_message(value, field_type.type, store)
        case field_types.Array(element=field_types.Int() | field_types.Float() as element):
            return np.array(value, element.code)
        case field_types.Array(element=field_types.Bool()):
            return np.array(value, np.bool_)
        case field_types.Array():
            return [for_rosbags(item, field_type.element, store) for item in value]
        case _:
            return value


def rosbags_message(value: Any, kind: MessageType, store: Any) -> Any:
    if kind.time is not None:
        return for_rosbags(value, kind.time, store)
    fields = [for_rosbags(getattr(value, slot.attribute), slot.type, store) for slot in kind.slots]
    return store.types[kind.name.replace("/", "/msg/")](*fields)


@pytest.mark.parametrize(("version", "name"), every_type())
def test_every_standard_message_in_every_form(version: int, name: str) -> None:
    kind = REGISTRIES[version].message(name)
    chance = Random(name)
    for given_message in (kind.struct(), *(message(kind, chance) for _ in range(3))):
        check_every_form(version, kind, given_message)


def check_every_form(version: int, kind: MessageType, given_message: Any) -> None:
    store = STORES[version]
    payload = Payload.from_value(kind, given_message)
    assert payload.cbor() == cbor2.dumps(as_mapping(given_message, kind, version))
    full_name = kind.name.replace("/", "/msg/")
    if full_name in store.types:
        oracle = rosbags_message(given_message, kind, store)
        serialise = store.serialize_ros1 if version == 1 else store.serialize_cdr
        assert payload.serialised() == bytes(serialise(oracle, full_name))
    for encode, decode in FORMS.values():
        assert decode(kind, encode(payload)).value() == given_message
    arrived = Payload.from_json(kind, payload.json())
    assert arrived.json() is payload.json()
    assert arrived.value() == given_message


# Vectors. The first six are the messages of `cbor_frames` in the protocol's examples (spec_examples.json).
# The rest was worked out by hand from RFC 8949, RFC 8746 and the CDR rules.

CBOR_VECTORS = [
    (2, "std_msgs/String", {"data": "hi"}, "a16464617461626869"),
    (2, "std_msgs/UInt8MultiArray#data", b"\x00\x01\x02\xff", "44000102ff"),
    (2, "sensor_msgs/LaserScan#ranges", [1.0, 2.5, math.inf], "d8554c0000803f000020400000807f"),
    (2, "std_msgs/Int64MultiArray#data", [-1, 9007199254740993], "d84f50ffffffffffffffff0100000000002000"),
    (1, "std_msgs/Time", {"data": {"secs": 5, "nsecs": 7}}, "a16464617461a2647365637305656e7365637307"),
    (2, "builtin_interfaces/Time", {"sec": 5, "nanosec": 7}, "a26373656305676e616e6f73656307"),
    (2, "std_msgs/Float64", {"data": math.nan}, "a16464617461fb7ff8000000000000"),
    (2, "std_msgs/Float32", {"data": -math.inf}, "a16464617461fbfff0000000000000"),
    (2, "std_msgs/Int8", {"data": -1}, "a1646461746120"),
    (2, "std_msgs/UInt64", {"data": 2**64 - 1}, "a164646174611bffffffffffffffff"),
    (2, "std_msgs/Byte", {"data": 200}, "a1646461746118c8"),
    (2, "std_msgs/Empty", {}, "a0"),
    (2, "t_msgs/Odd#u", [1, 2], "420102"),
    (2, "t_msgs/Odd#b", [200], "d84041c8"),
    (2, "t_msgs/Odd#i", [-1], "d84841ff"),
    (2, "t_msgs/Odd#f", [True, False], "82f5f4"),
    (2, "t_msgs/Odd#s", ["a", "é"], "82616162c3a9"),
    (1, "t_msgs/Old#b", [-56], "d84841c8"),
    (1, "t_msgs/Old#t", [{"secs": 1, "nsecs": 2}], "81a2647365637301656e7365637302"),
]


@pytest.mark.parametrize(("version", "name", "value", "expected"), CBOR_VECTORS)
def test_cbor_vectors(version: int, name: str, value: Any, expected: str) -> None:
    name, _, field = name.partition("#")
    kind = REGISTRIES[version].message(name)
    payload = Payload.from_value(kind, {field: value} if field else value)
    whole = payload.cbor()
    if field:
        key = cbor2.dumps(field)
        assert key + bytes.fromhex(expected) in whole
    else:
        assert whole.hex() == expected


PACKED_VECTORS = [
    (1, "ros1", "std_msgs/String", {"data": "hi"}, "020000006869"),
    (2, "cdr", "std_msgs/String", {"data": "hi"}, "00010000 03000000686900"),
    (2, "cdr", "std_msgs/Empty", {}, "00010000 00"),
    (1, "ros1", "std_msgs/Empty", {}, ""),
    (2, "cdr", "std_msgs/Float64MultiArray", {"data": [1.0]},
     "00010000 00000000 00000000 01000000 00000000 000000000000f03f"),
    (2, "cdr", "t_msgs/Holder", {"a": 1, "ns": [{}, {}], "d": 1.0},
     "00010000 00 01 0000 02000000 00 00 000000000000 000000000000f03f 00"),
    (
        2,
        "cdr",
        "t_msgs/Odd",
        {"s": ["a"], "u": [1], "b": [2], "w": "é😀", "i": []},
        (
            "00010000 01000000 02000000 6100 0000 01000000 01 000000 01000000 02 00 00 00 "
            "03000000 e90000003dd8000000de0000 00000000"
        ),
    ),
    (
        # Recorded from rclpy of Kilted and of Jazzy, with rmw_fastrtps_cpp: `test_msgs/WStrings`.
        2,
        "cdr",
        "t_msgs/Wide",
        {"a": "a😀b\0c", "fixed": ["", "x", "a😀b\0c"], "few": ["b"], "many": ["a😀b\0c"]},
        (
            "00010000 06000000 610000003dd8000000de0000620000000000000063000000"
            "0c000000 48000000650000006c0000006c0000006f000000"
            "20000000770000006f000000720000006c0000006400000021000000"
            "0c000000 48000000650000006c0000006c000000f6000000"
            "2000000077000000f6000000720000006c0000006400000021000000"
            "07000000 cf300000ed300000fc300000ef300000fc300000eb300000c9300000"
            "00000000 01000000 78000000 06000000 610000003dd8000000de0000620000000000000063000000"
            "01000000 01000000 62000000 01000000 06000000 610000003dd8000000de0000620000000000000063000000"
        ),
    ),
    (1, "ros1", "t_msgs/Old", {"t": [{"secs": 1, "nsecs": 2}], "d": {"secs": -1}, "b": [-1], "f": [1, 2]},
     "01000000 01000000 02000000 ffffffff 00000000 01000000 ff 00000000 00000000 0000803f 00000040"),
    (1, "ros1", "t_msgs/Holder", {"ns": [{}, {}]}, "02000000"),
]  # fmt: skip


@pytest.mark.parametrize(("version", "form", "name", "value", "expected"), PACKED_VECTORS)
def test_packed_vectors(version: int, form: str, name: str, value: Any, expected: str) -> None:
    kind = REGISTRIES[version].message(name)
    payload = Payload.from_value(kind, value)
    whole = FORMS[form][0](payload)
    assert whole.hex() == expected.replace(" ", "")
    check_whole_cut_and_followed(form, kind, whole)


def check_whole_cut_and_followed(form: str, kind: MessageType, whole: bytes) -> None:
    decode, encode = FORMS[form][1], FORMS[form][0]
    again = decode(kind, whole)
    assert encode(Payload.from_value(kind, again.value())) == whole
    for length in range(len(whole)):
        with pytest.raises(InvalidMessage):
            decode(kind, whole[:length])
    for rest in (b"\x01", b"\xff" * 9, b"\0" * 8):
        with pytest.raises(InvalidMessage):
            decode(kind, whole + rest)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    "name", ["nav_msgs/Odometry", "diagnostic_msgs/DiagnosticArray", "sensor_msgs/JointState"]
)
def test_messages_the_reference_never_delivers(form: str, name: str) -> None:
    """CBR-07: fixed arrays, string arrays, bytes; whole, cut at each byte, and with something after."""
    kind = REGISTRIES[2].message(name)
    value: Any = {
        "nav_msgs/Odometry": {"child_frame_id": "base", "pose": {"covariance": list(range(36))}},
        "diagnostic_msgs/DiagnosticArray": {"status": [{"level": 2, "name": "n", "values": [{"key": "k"}]}]},
        "sensor_msgs/JointState": {"name": ["a", "bc"], "position": [1.0, 2.0]},
    }[name]
    check_whole_cut_and_followed(form, kind, FORMS[form][0](Payload.from_value(kind, value, lambda: 5)))


def test_padding_after_cdr_is_let_pass() -> None:
    kind = REGISTRIES[2].message("std_msgs/String")
    assert Payload.from_cdr(kind, bytes.fromhex("00010000 03000000686900 00")).json() == b'{"data":"hi"}'
    with pytest.raises(InvalidMessage):
        Payload.from_cdr(kind, bytes.fromhex("00010000 03000000686900 01"))


def test_an_empty_string_may_come_without_its_zero() -> None:
    kind = REGISTRIES[2].message("std_msgs/String")
    assert Payload.from_cdr(kind, bytes.fromhex("00010000 00000000")).json() == b'{"data":""}'


@pytest.mark.parametrize(
    ("form", "name", "data", "text"),
    [
        ("cbor", "std_msgs/String", "a1", "not CBOR with typed arrays"),
        ("cbor", "std_msgs/String", "a16464617461d04100", "not CBOR with typed arrays"),
        ("cbor", "std_msgs/String", "a1646461746101", "data: expected string, got 1"),
        ("cbor", "sensor_msgs/LaserScan", "a16672616e676573d8554100", "not CBOR with typed arrays"),
        ("cdr", "std_msgs/String", "00000000 03000000686900", "expected little-endian CDR"),
        ("cdr", "std_msgs/String", "00010000 03000000686961", "data: a string without its closing zero"),
        ("cdr", "std_msgs/String", "00010000 02000000ff00", "data: text that is not valid UTF-8"),
        ("cdr", "std_msgs/String", "00010000 ffffffff00", "data: data cut short"),
        ("cdr", "std_msgs/Empty", "00010000", "data cut short"),
        ("cdr", "t_msgs/Odd", "00010000 03000000", "s: expected at most 2 elements, got 3"),
        ("cdr", "t_msgs/Odd", "00010000 01000000 0700000061616161616100",
         "s[0]: expected at most 5 characters"),
        ("cdr", "t_msgs/Wide", "00010000 01000000 00f60100", "a: a wstring with a unit of more than 16 bits"),
        ("cdr", "t_msgs/Wide", "00010000 01000000 3dd80000", "a: text that is not valid UTF-16"),
        ("ros1", "geometry_msgs/PoseArray", "00" * 16 + "ffffffff", "poses: data cut short"),
        ("ros1", "geometry_msgs/PoseArray", "00" * 16 + "02000000" + "00" * 60,
         "poses[1].position.x: data cut"),
        ("ros1", "t_msgs/Holder", "00" + "ffffffff", "ns: expected at most 16 elements"),
    ],
)  # fmt: skip
def test_malformed_data_is_refused(form: str, name: str, data: str, text: str) -> None:
    kind = REGISTRIES[1 if form == "ros1" else 2].message(name)
    with pytest.raises(InvalidMessage) as refused:
        FORMS[form][1](kind, bytes.fromhex(data))
    assert text in str(refused.value)


def test_numpy_arrays_go_straight_in() -> None:
    scan = REGISTRIES[2].message("sensor_msgs/LaserScan")
    ranges = np.array([1.0, np.nan, np.inf])
    payload = Payload.from_value(scan, {"ranges": ranges})
    listed = Payload.from_value(scan, {"ranges": ranges.tolist(), "header": {"stamp": {"sec": 1}}})
    value: Any = payload.value()
    same = Payload.from_value(scan, {"ranges": ranges, "header": {"stamp": value.header.stamp}})
    assert np.float32(ranges).tobytes() in payload.cbor()
    assert np.float32(ranges).tobytes() in listed.cdr()
    assert same.cbor() == payload.cbor()


@pytest.mark.parametrize("form", FORMS)
@given(
    st.sampled_from(["geometry_msgs/PoseArray", "t_msgs/Holder", "std_msgs/String"]), st.binary(max_size=60)
)
def test_any_bytes_give_a_message_or_a_payload_error(form: str, name: str, data: bytes) -> None:
    kind = REGISTRIES[1 if form == "ros1" else 2].message(name)
    with contextlib.suppress(InvalidMessage):
        FORMS[form][1](kind, b"\0\1\0\0" * (form == "cdr") + data).value()
