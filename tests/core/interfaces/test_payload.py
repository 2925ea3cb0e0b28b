"""Payloads made from Python's values, and their forms."""

from __future__ import annotations

import json
import math
import struct as struct_module
import subprocess
import sys
from array import array
from dataclasses import dataclass, field
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_interfaces.distro import DISTROS, NOETIC
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.steps import finished

REGISTRY = Registry()
TWIST = REGISTRY.message("geometry_msgs/Twist")
SCAN = REGISTRY.message("sensor_msgs/LaserScan")
IMAGE = REGISTRY.message("sensor_msgs/Image")
STRING = REGISTRY.message("std_msgs/String")


def struct(name: str) -> Any:
    return REGISTRY.message(name).struct


def make(name: str, value: object) -> Any:
    return Payload.from_value(REGISTRY.message(name), value, lambda: 3_000_000_004)


def sent(name: str, value: object) -> Any:
    return json.loads(bytes(make(name, value).json()))


def test_a_struct_a_mapping_and_a_mixture_say_the_same() -> None:
    vector = struct("geometry_msgs/Vector3")
    whole = TWIST.struct(vector(1.0, 2.0, 3.0), vector())
    mapping = {"linear": {"x": 1, "y": 2, "z": 3}}
    mixture = TWIST.struct(linear={"x": 1, "y": 2.0, "z": np.float32(3)})
    for value in (whole, mapping, mixture, {"linear": vector(1.0, 2.0, 3.0)}):
        assert make("geometry_msgs/Twist", value).value() == whole
        assert sent("geometry_msgs/Twist", value)["linear"] == {"x": 1.0, "y": 2.0, "z": 3.0}


def test_a_dataclass_will_do() -> None:
    @dataclass
    class Linear:
        x: float = 1.0
        y: float = 0.0
        z: float = 0.0

    @dataclass
    class Command:
        linear: Linear = field(default_factory=Linear)

    assert sent("geometry_msgs/Twist", Command())["linear"]["x"] == 1.0


def test_positional_values_fill_fields_in_order() -> None:
    """SRV-02: a short list leaves the rest at its default, what is too much is ignored."""
    request = "example_interfaces/AddTwoInts_Request"
    assert sent(request, [7]) == {"a": 7, "b": 0}
    assert sent(request, (7, 8, 9)) == {"a": 7, "b": 8}


@pytest.mark.parametrize(
    ("raw", "expected"),
    [
        (b'{"a":1,"b":2}', {"a": 1, "b": 2}),
        (b' {"b":2}', {"a": 0, "b": 2}),
        (b"[3, 4, 5]", {"a": 3, "b": 4}),
        (b"[]", {"a": 0, "b": 0}),
        (b'"text"', {"a": 0, "b": 0}),
        (b"null", {"a": 0, "b": 0}),
        (None, {"a": 0, "b": 0}),
    ],
)
def test_arguments_of_a_service(raw: bytes | None, expected: object) -> None:
    request = REGISTRY.message("example_interfaces/AddTwoInts_Request")
    assert json.loads(bytes(Payload.from_args(request, raw).json())) == expected


def test_arguments_that_do_not_fit_are_refused() -> None:
    request = REGISTRY.message("example_interfaces/AddTwoInts_Request")
    for raw in (b"[1.5]", b'{"c":1}', b"[", b"\xff"):
        with pytest.raises(InvalidMessage):
            Payload.from_args(request, raw)


def test_what_the_caller_does_afterwards_changes_nothing() -> None:
    ranges = [1.0, 2.0]
    message: Any = SCAN.struct(ranges=ranges)
    incomplete: Any = {
        "header": {"frame_id": "laser"},
        "ranges": ranges,
        "intensities": np.ones(2, np.float32),
    }
    payloads = [Payload.from_value(SCAN, message), make("sensor_msgs/LaserScan", incomplete)]
    ranges.append(3.0)
    message.header.frame_id = "changed"
    incomplete["intensities"] *= 2.0
    for payload in payloads:
        value: Any = payload.value()
        assert value.ranges == [1.0, 2.0]
        assert value.header.frame_id != "changed"
        assert b"changed" not in bytes(payload.json())
        assert list(value.intensities) in ([], [1.0, 1.0])


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview, list, tuple, partial(array, "B"), "numpy"])
def test_octets_come_in_many_forms_and_are_kept_as_bytes(kind: Any) -> None:
    data = np.frombuffer(b"\x00\x01\xff", np.uint8) if kind == "numpy" else kind(b"\x00\x01\xff")
    payload = Payload.from_value(IMAGE, IMAGE.struct(data=data))
    if isinstance(data, bytearray):
        data[0] = 9
    value: Any = payload.value()
    assert value.data == b"\x00\x01\xff" and type(value.data) is bytes
    assert json.loads(bytes(payload.json()))["data"] == "AAH/"


def test_numpy_arrays_are_kept_as_such_and_sent_as_lists() -> None:
    payload = Payload.from_value(SCAN, SCAN.struct(ranges=np.array([0.1, math.inf, math.nan])))
    value: Any = payload.value()
    assert value.ranges.dtype == np.float32 and not value.ranges.flags.writeable
    assert json.loads(bytes(payload.json()))["ranges"] == [0.10000000149011612, None, None]
    grid = sent("nav_msgs/OccupancyGrid", {"data": np.array([[0, 100], [-1, 50]])})
    assert grid["data"] == [0, 100, -1, 50]


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("geometry_msgs/Twist", {"linear": {"x": "fast"}}, 'linear.x: expected float64, got "fast"'),
        ("geometry_msgs/Twist", {"linear": {"x": np.bool_(True)}}, "linear.x: expected float64, got bool"),
        ("geometry_msgs/Twist", 5, "expected a geometry_msgs/Twist object, got 5"),
        ("geometry_msgs/Twist", None, "expected a geometry_msgs/Twist object, got null"),
        ("std_msgs/Int32", {"data": np.float64(1.0)}, "data: expected int32, got 1.0"),
        ("std_msgs/String", {"data": b"x"}, "data: expected string, got bytes"),
        ("std_msgs/UInt8MultiArray", {"data": [1, -1]},
         "data[1]: expected uint8, got -1, which is out of range"),
        ("std_msgs/UInt8MultiArray", {"data": np.array([300])},
         "data: expected uint8 elements, got a numpy array with values out of range"),
        ("std_msgs/Int32MultiArray", {"data": np.array([0.5])},
         "data: expected int32 elements, got a numpy array of float64"),
        ("std_msgs/Float32MultiArray", {"data": np.array([1e39])},
         "data: expected float32 elements, got a numpy array with values out of range"),
        ("geometry_msgs/PoseWithCovariance", {"covariance": np.zeros(35)},
         "covariance: expected 36 elements, got 35"),
    ],
)  # fmt: skip
def test_a_misfit_is_refused_and_named(name: str, value: object, text: str) -> None:
    with pytest.raises(InvalidMessage) as refused:
        make(name, value)
    assert str(refused.value) == text


def test_a_spoilt_struct_is_refused_too() -> None:
    spoilt: Any = TWIST.struct()
    spoilt.linear.x = "fast"
    with pytest.raises(InvalidMessage, match=r"^linear\.x: "):
        Payload.from_value(TWIST, spoilt)
    with pytest.raises(InvalidMessage, match=r"^angular: "):
        Payload.from_value(TWIST, TWIST.struct(angular=None))
    with pytest.raises(InvalidMessage, match="lone surrogate"):
        Payload.from_value(STRING, STRING.struct("\udc80"))
    labels = [{"label": "ok"}, {"label": "\udc80"}]
    layout = REGISTRY.message("std_msgs/MultiArrayLayout")
    with pytest.raises(InvalidMessage, match=r"^dim\[1\]\.label: "):
        Payload.from_value(
            layout, {"dim": [{"size": 1, "stride": 1, **one} for one in labels], "data_offset": 0}
        )


def test_a_mappings_header_is_stamped_and_a_structs_is_kept() -> None:
    stamp = {"sec": 3, "nanosec": 4}
    assert sent("sensor_msgs/LaserScan", {})["header"]["stamp"] == stamp
    assert sent("sensor_msgs/LaserScan", {"header": {"stamp": "now"}})["header"]["stamp"] == stamp
    assert sent("sensor_msgs/LaserScan", SCAN.struct())["header"]["stamp"] == {"sec": 0, "nanosec": 0}


def test_null_for_a_float_is_nan_in_python() -> None:
    for payload in (
        Payload.from_json(TWIST, b'{"linear":{"x":null,"y":1,"z":1},"angular":{"x":1,"y":1,"z":1}}'),
        Payload.from_value(TWIST, TWIST.struct(linear={"x": None, "y": 1, "z": 1})),
    ):
        value: Any = payload.value()
        assert math.isnan(value.linear.x)
        assert b'"x":null' in bytes(payload.json())


def test_each_form_is_made_once() -> None:
    payload = Payload.from_value(TWIST, {})
    for form in (Payload.json, Payload.value, Payload.cbor, Payload.cdr, Payload.serialised):
        assert form(payload) is form(payload)
    arrived = Payload.from_json(TWIST, payload.json())
    assert arrived.json() is payload.json()
    assert arrived.value() is arrived.value()


def test_relayed_cdr_is_passed_on_as_it_is_and_read_when_asked() -> None:
    data = Payload.from_value(STRING, {"data": "hi"}).cdr()
    relayed = Payload.relayed_cdr(STRING, data)
    assert relayed.cdr() is data
    assert relayed.detach() is relayed
    assert relayed.json() == b'{"data":"hi"}'
    assert relayed.value() == Payload.from_value(STRING, {"data": "hi"}).value()
    assert relayed.cdr() is data


@pytest.mark.parametrize("data", [b"", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00\xff\xff\xff\xffhi", b"hi"])
def test_relayed_cdr_that_does_not_fit_is_refused_when_it_is_read(data: bytes) -> None:
    relayed = Payload.relayed_cdr(STRING, data)
    assert relayed.cdr() is data
    for form in (relayed.value, relayed.json, relayed.cbor):
        with pytest.raises(InvalidMessage):
            form()


def test_detaching_copies_a_view_and_nothing_else() -> None:
    frame = bytearray(b'{"msg":{"data":"hello"}}')
    payload = Payload.from_json(STRING, memoryview(frame)[7:-1])
    kept = payload.detach()
    frame[:] = b"x" * len(frame)
    assert kept.json() == b'{"data":"hello"}'
    assert kept.detach() is kept
    assert repr(kept) == "<Payload std_msgs/String>"


def test_large_octets_are_sent_as_base64() -> None:
    data = bytes(range(256)) * 100
    payload = Payload.from_value(IMAGE, IMAGE.struct(data=data))
    again: Any = Payload.from_json(IMAGE, payload.json()).value()
    assert again.data == data
    nested = {"markers": [{"texture": {"data": data}}]}
    array: Any = Payload.from_json(
        REGISTRY.message("visualization_msgs/MarkerArray"),
        make("visualization_msgs/MarkerArray", nested).json(),
    ).value()
    assert array.markers[0].texture.data == data


def test_relaying_json_loads_no_heavy_library() -> None:
    """numpy and the others are loaded by those who use them, so that a small server stays small."""
    program = """
import sys
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
kind = Registry().message("sensor_msgs/LaserScan")
payload = Payload.from_json(kind, b'{"ranges":[1.5,null],"header":{}}')
payload.json(), payload.value(), payload.cbor(), payload.cdr()
print([name for name in ("numpy", "cbor2", "pydantic_core", "PIL") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_messages_are_made_while_another_thread_imports_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    """The module is there before its names are."""
    monkeypatch.setitem(sys.modules, "numpy", ModuleType("numpy"))
    numbers = make("std_msgs/Float64MultiArray", {"data": [1.0, 2.0]}).cdr()
    assert numbers.endswith(struct_module.pack("<2d", 1.0, 2.0))
    with pytest.raises(InvalidMessage, match="expected bool, got 1"):
        make("std_msgs/Bool", {"data": 1})


@pytest.mark.parametrize("is_dense", [False, True])
def test_a_large_message_is_numbered_without_being_decoded_wherever_its_header_is(
    is_dense: bool,
) -> None:
    message = Registry(DISTROS["noetic"]).message("geometry_msgs/PoseArray")
    pose = {
        "position": {"x": 0.5, "y": 0.0, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }
    header = {"seq": 1, "stamp": {"secs": 1, "nsecs": 2}, "frame_id": "map"}
    text = json.dumps({"poses": [pose] * 5_000, "header": header}).encode()
    payload = finished(Payload.from_json_in_steps(message, text, is_dense=is_dense))
    numbered = payload.numbered(7)
    assert len(numbered.json_parts()) > 1  # The list is still in the very bytes that came.
    assert json.loads(bytes(numbered.json())) == {"header": {**header, "seq": 7}, "poses": [pose] * 5_000}


def test_of_two_members_of_one_name_the_last_is_taken_in_a_large_message_too() -> None:
    message = Registry(DISTROS["noetic"]).message("std_msgs/Float64MultiArray")
    layout = '"layout":{"dim":[],"data_offset":0}'
    text = f'{{{layout},"data":[1.5],"data":{[0.5] * 100_000},{layout}}}'
    payload = Payload.from_json(message, text.encode())
    finished(payload.prepare(["cbor"]))
    assert payload.cbor() == Payload.from_value(message, {"data": [0.5] * 100_000}).cbor()


ODD_FLOATS = st.floats(min_value=-3e38, max_value=3e38) | st.sampled_from(
    [0.1, -0.0, 1e-45, 5e-324, 2.0**-126, 3.4028234663852886e38, float("nan")]
)


@pytest.mark.parametrize("filler", [0.0, 0.5, 1, None])
@given(st.lists(ODD_FLOATS, max_size=4), st.integers(0, 600))
def test_long_lists_of_float32_are_rounded_whatever_is_among_them(
    filler: float | None, odd: list[float], place: int
) -> None:
    type = REGISTRY.message("std_msgs/Float32MultiArray")
    given_list = [filler] * 600
    given_list[place:place] = odd
    nearest = [float("nan") if number is None else float(np.float32(number)) for number in given_list]
    payload = Payload.from_value(type, {"layout": {"dim": [], "data_offset": 0}, "data": given_list})
    found = json.loads(bytes(payload.json()))["data"]
    assert [repr(number and float(number)) for number in found] == [
        repr(None if math.isnan(number) else number and float(number)) for number in nearest
    ]
    data: Any = payload.value()
    assert repr(data.data) == repr(nearest)


@pytest.mark.parametrize("wrong", ["x", True, 1e39, -3.5e38, 10**400, [0.5], object()])
def test_one_wrong_float32_among_many_is_found(wrong: object) -> None:
    type = REGISTRY.message("std_msgs/Float32MultiArray")
    for odd in (0.1, 0.5, float("inf")):
        with pytest.raises(InvalidMessage) as refused:
            Payload.from_value(type, {"data": [odd] * 700 + [wrong] + [0.5] * 300})
        assert refused.value.path == "data[700]"


@pytest.mark.parametrize("size", [10, 1 << 14, 1 << 18])
def test_a_relayed_view_has_every_form_and_is_detached_from_its_buffer(size: int) -> None:
    registry = Registry(NOETIC)
    registry.add_text("uint8[] first\nstring text\nuint8[] second\nuint8[2] pair", "t_msgs/Pair")
    type = registry.message("t_msgs/Pair")
    value = {"first": b"\5" * size, "text": "x", "second": b"\7" * size, "pair": b"ab"}
    made = Payload.from_value(type, value)
    data = made.serialised()

    def relayed() -> tuple[bytearray, Payload]:
        buffer = bytearray(data)
        return buffer, Payload.relayed_ros1(type, memoryview(buffer).toreadonly())

    buffer, payload = relayed()
    assert bytes(payload.json()) == bytes(made.json())
    assert payload.cbor() == made.cbor()
    assert payload.serialised() == data
    assert payload.value() == made.value()
    for read in (None, Payload.json, Payload.cbor, Payload.value, Payload.serialised_parts):
        buffer, payload = relayed()
        if read is not None:
            read(payload)
        kept = payload.detach()
        assert kept.kept_size
        del payload
        buffer.clear()  # Fails if a view is left.
        assert kept.value() == made.value()
        assert kept.serialised() == data
