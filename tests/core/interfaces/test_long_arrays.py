"""Long arrays of every kind are taken and encoded in steps, to what they are encoded to at once, and what
holds very many values elsewhere is refused before it is decoded."""

from __future__ import annotations

import json
import tracemalloc
from typing import Any, cast

import pytest

from rwt_interfaces.errors import InvalidMessage, NotExact, TooManyValues
from rwt_interfaces.payload import Form, Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.serialise import json_reader, large_json
from rwt_interfaces.serialise.forms import BinaryForm
from rwt_interfaces.serialise.json import MAX_VALUES
from rwt_interfaces.steps import finished
from rwt_interfaces.validation import lenient_decoder
from tests.conftest import counted

HEADER = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "map"}
REGISTRY = Registry()
REGISTRY.add_text("builtin_interfaces/Time[] times", "t_msgs/Times")
TIME = {"sec": 3, "nanosec": 4}
POINT = {
    "positions": [0.5] * 9_000, "velocities": [], "accelerations": [], "effort": [],
    "time_from_start": TIME,
}  # fmt: skip
PAIR = {"key": "[k]", "value": "},{"}
ODD = {"key": "k]", "value": "]"}
STATUS = {"level": 1, "name": "[n", "message": "]", "hardware_id": "", "values": [PAIR] * 5_000}
POINT_3D = {"x": 1.0, "y": 2.0, "z": 0.5}
POSE = {"header": HEADER, "pose": {"position": POINT_3D, "orientation": {**POINT_3D, "w": 1.0}}}
MARKER = {"points": [{"x": 1.0, "y": 2.0, "z": 0.5}] * 2_000}

MESSAGES: dict[str, tuple[str, Any]] = {
    "texts": ("sensor_msgs/JointState", {"name": ["", ",", '","', "]", '\\"', "é"] * 3_000}),
    "one long text": ("sensor_msgs/JointState", {"name": ["a", 'x"\\' * 20_000, "b"] * 2}),
    "words": ("rcl_interfaces/ParameterValue", {"bool_array_value": [True, False] * 5_000}),
    "times": ("t_msgs/Times", {"times": [TIME] * 3_000}),
    "nulls": ("std_msgs/Float64MultiArray", {"data": [None, 0.5] * 5_000}),
    "lists in one item": ("diagnostic_msgs/DiagnosticArray", {"header": HEADER, "status": [STATUS]}),
    "lists in items": ("diagnostic_msgs/DiagnosticArray",
                       {"header": HEADER, "status": [STATUS, {**STATUS, "values": []}] * 3}),
    "texts with brackets": ("diagnostic_msgs/DiagnosticArray",
                            {"status": [{**STATUS, "values": [ODD] * 2_000}]}),
    "numbers in one item": ("trajectory_msgs/JointTrajectory", {"joint_names": ["a"], "points": [POINT]}),
    "numbers in items": ("trajectory_msgs/JointTrajectory", {"points": [POINT] * 3}),
    "an item that lacks much": ("visualization_msgs/MarkerArray", {"markers": [MARKER, {"id": 1}, MARKER]}),
    "poses": ("geometry_msgs/PoseArray", {"header": HEADER, "poses": [{"orientation": {"w": 1}}] * 500}),
    "float32s": ("sensor_msgs/LaserScan", {"ranges": [0.1] * 9_000, "intensities": [1] * 300}),
    "integers": ("nav_msgs/OccupancyGrid", {"data": [-1] * 9_000}),
    "items of items": (
        "rcl_interfaces/ParameterEvent",
        {"new_parameters": [{"name": "p", "value": {"string_array_value": ["a,b", ""] * 3_000}}]},
    ),
}  # fmt: skip


def _now() -> int:
    return 5_000_000_007


@pytest.mark.parametrize("indent", [None, 1])
@pytest.mark.parametrize("name", MESSAGES)
def test_steps_come_to_what_is_made_at_once(
    name: str, indent: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind, message = MESSAGES[name]
    type = REGISTRY.message(kind)
    whole = Payload(type, type.decode_leniently(message, _now))
    raw = json.dumps(message, indent=indent).encode()
    monkeypatch.setattr(json_reader, "WHOLE_BYTES", 1 << 14)
    monkeypatch.setattr(large_json, "CHUNK_BYTES", 1 << 14)
    payload, steps = counted(Payload.from_json_in_steps(type, raw, _now))
    assert steps >= len(raw) // 64_000
    finished(payload.prepare({"json"}))
    assert json.loads(bytes(payload.json())) == json.loads(bytes(whole.json()))
    for prepared, make in (({"cbor"}, Payload.cbor), ({"serialised"}, Payload.serialised)):
        _, steps = counted(payload.prepare(cast("set[Form]", prepared)))
        assert steps >= 2 or name == "one long text"
        assert make(payload) == make(whole)


@pytest.mark.parametrize("wrong", [(), (256,)])
def test_octets_are_taken_as_a_long_list_of_numbers(wrong: tuple[int, ...]) -> None:
    image = {"height": 1, "data": [*range(256)] * 2_000 + [*wrong]}
    type, raw = REGISTRY.message("sensor_msgs/Image"), json.dumps(image).encode()
    if not wrong:
        value: Any = Payload.from_json(type, raw).value()
        assert (value.height, value.data) == (1, bytes(range(256)) * 2_000)
        return
    with pytest.raises(InvalidMessage) as caught:
        Payload.from_json(type, raw)
    assert caught.value.path == "data[512000]"


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("std_msgs/String", '{"data":"","x":[%s]}'),  # no field of the type
        ("sensor_msgs/JointState", '{"name":[%s,x]}'),  # not JSON
        ("sensor_msgs/JointState", '{"name":[%s'),
        ("std_msgs/String", "[%s]"),  # no message
        ("sensor_msgs/JointState", '{"x":{"name":[%s]}}'),
    ],
)
def test_very_many_values_elsewhere_are_refused_before_they_are_decoded(kind: str, text: str) -> None:
    raw = (text % ",".join(['""'] * (MAX_VALUES + 2))).encode()
    with pytest.raises(TooManyValues, match="more than 262144 values"):
        Payload.from_json(REGISTRY.message(kind), raw)
    with pytest.raises(NotExact):
        finished(Payload.from_json_in_steps(REGISTRY.message(kind), raw, is_dense=True))


@pytest.mark.parametrize(
    ("name", "place", "wrong", "path"),
    [
        ("texts", "name", 1, "name[17999]"),
        ("words", "bool_array_value", 0, "bool_array_value[9999]"),
        ("lists in one item", "status", {**STATUS, "values": [PAIR] * 5_000 + [{"key": 1}]},
         "status[0].values[5000].key"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_found_where_it_is(name: str, place: str, wrong: object, path: str) -> None:
    kind, message = MESSAGES[name]
    type, given = REGISTRY.message(kind), {**message, place: [*message[place][:-1], wrong]}
    with pytest.raises(InvalidMessage) as caught:
        Payload.from_json(type, json.dumps(given).encode())
    assert caught.value.path == path
    with pytest.raises(InvalidMessage) as caught:
        finished(Payload.from_value_in_steps(type, given))
    assert caught.value.path == path


def test_a_text_of_very_many_commas_is_one_value() -> None:
    raw = json.dumps({"data": "," * (2 * MAX_VALUES)}).encode()
    assert Payload.from_json(Registry().message("std_msgs/String"), raw).json() == raw


def test_values_in_long_lists_are_completed_in_steps_beside_fixed_arrays() -> None:
    registry = Registry()
    registry.add_text("float64[100] fixed\nnav_msgs/Path path\nint8 n", "t_msgs/Fixed")
    type = registry.message("t_msgs/Fixed")
    value = {"fixed": [0.5] * 100, "path": {"poses": [{}, POSE] * 100}, "n": 1}
    payload = finished(Payload.from_value_in_steps(type, value, _now))
    assert payload.plain() == Payload.from_value(type, value, _now).plain()
    for item, n, path in ((0, 1, "path.poses[0]"), ({}, 1000, "n"), (0, 1000, "path.poses[0]")):
        wrong = {**value, "path": {"poses": [item] * 100}, "n": n}
        with pytest.raises(InvalidMessage) as caught:
            finished(Payload.from_value_in_steps(type, wrong, _now))
        assert caught.value.path == path


def test_items_that_lack_much_are_completed_a_few_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large_json, "MAX_GROWTH_BYTES", 0)
    monkeypatch.setattr(json_reader, "SLOW_BYTES", 0)
    monkeypatch.setattr(json_reader, "WHOLE_BYTES", 0)
    raw = b'{"poses":[' + b",".join([b"{}"] * 1_500) + b'],"header":{}}' + b" " * 4096
    payload, steps = counted(Payload.from_json_in_steps(REGISTRY.message("nav_msgs/Path"), raw, _now))
    value: Any = payload.value()
    assert len(value.poses) == 1_500
    assert steps > 1_500 // 64


@pytest.mark.parametrize("name", MESSAGES)
def test_a_program_s_message_becomes_the_same_in_steps_from_whatever_it_is_made(name: str) -> None:
    type_name, message = MESSAGES[name]
    type = REGISTRY.message(type_name)
    whole = Payload.from_value(type, message, _now)
    forms: tuple[BinaryForm, ...] = ("cbor", "cdr", "ros1")
    for form in forms:
        parts, _ = counted(type.step_encoder(form)(whole.value(), {}))
        assert b"".join(parts) == type.binary_encoder(form)[0](whole.value())
    for payload in (
        Payload.from_value(type, message, _now),
        Payload.from_value(type, whole.value(), _now),
        finished(Payload.from_value_in_steps(type, message, _now)),
    ):
        plain, steps = counted(payload.plain_in_steps())
        assert repr(plain) == repr(whole.plain())  # NaN is not equal to itself.
        assert steps > 0 or not payload.is_long
        finished(payload.prepare(("json", "cbor", "serialised")))
        assert (payload.json(), payload.cbor(), payload.serialised()) == (
            whole.json(),
            whole.cbor(),
            whole.serialised(),
        )
        assert type.json.decode(payload.json()).__class__ is type.struct is payload.value().__class__


def test_a_program_s_message_is_not_made_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Encoders take the very objects that the check has made; the type's own Structs are for programs."""
    type = Registry().message("nav_msgs/Path")
    payload = Payload.from_value(type, {"header": HEADER, "poses": [POSE] * 300}, _now)
    with monkeypatch.context() as patched:
        patched.setattr(Payload, "value", None)
        _, steps = counted(payload.prepare(("json", "cbor", "serialised")))
        plain, _ = counted(payload.plain_in_steps())
    assert steps >= 15
    assert plain == {"header": HEADER, "poses": [POSE] * 300}


def test_an_incomplete_message_takes_no_more_memory_than_its_text() -> None:
    """A list of its numbers would take eight times as much, for each client that sends one."""
    type = Registry().message("std_msgs/Int16MultiArray")
    text = b'{"data":[%s7]}' % (b"7," * 1_000_000)
    tracemalloc.start()
    try:
        payload = finished(Payload.from_json_in_steps(type, text))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 3 * len(text)
    joined = bytes(payload.json())
    assert text[1:-1] in joined
    assert json.loads(joined)["layout"] == {"dim": [], "data_offset": 0}


def test_an_incomplete_message_has_no_more_items_than_are_freed_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lenient_decoder, "MOST_ITEMS", 300_000)
    type = REGISTRY.message("sensor_msgs/PointCloud")

    def raw(count: int) -> bytes:
        return b'{"channels":[{"values":[%b0]}]}' % (b"0.1," * (count - 1))

    payload = finished(Payload.from_json_in_steps(type, raw(300_000), _now))
    _, steps = counted(payload.prepare({"json"}))
    assert steps > 30
    assert json.loads(bytes(payload.json()))["channels"][0]["values"][-2:] == [0.10000000149011612, 0]
    with pytest.raises(InvalidMessage, match=r"^channels\[0\].values: more than 300000 list items"):
        finished(Payload.from_json_in_steps(type, raw(300_001), _now))


def test_a_short_list_is_none() -> None:
    type = REGISTRY.message("diagnostic_msgs/DiagnosticArray")
    assert not Payload.from_value(type, {"status": [{**STATUS, "values": []}]}).is_long
    assert REGISTRY.message("geometry_msgs/Twist").holds_long_list is None


def test_numbers_are_widened_to_a_bound() -> None:
    numpy = pytest.importorskip("numpy")
    type = REGISTRY.message("std_msgs/Float64MultiArray")
    assert Payload.from_value(type, {"data": numpy.zeros(1 << 20, "<f2")})
    assert Payload.from_value(type, {"data": numpy.zeros(3 << 20, "<f4")})
    with pytest.raises(InvalidMessage, match=r"got 3145728 of float16: send so many as float64"):
        Payload.from_value(type, {"data": numpy.zeros(3 << 20, "<f2")})
