"""Patterns, and the readers of what servers send."""

from __future__ import annotations

import base64
import io
import json
import struct

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from rosbridge_conformance.suite.matching import Context, Difference, Match, match_frame
from rosbridge_conformance.suite.values import Json, NarrowFloat, NotJson, Tagged, Value, read_json
from rosbridge_conformance.wire.cbor import NotCbor, read_cbor, typed_array
from rosbridge_conformance.wire.png import NotPng, read_data, read_png
from rosbridge_conformance.wire.unwrap import first_fault_of_fragment, join_fragments, open_png
from rosbridge_conformance.wire.wires import JsonCutter


@pytest.mark.parametrize(
    ("pattern", "value"),
    [
        (1, 1.0),
        ({"a": {"$any": "int"}}, {"a": 3}),
        ({"$int": 4}, 4),
        ({"$near": 4, "$within": 0.5}, 4.4),
        ({"$unordered": [1, {"$any": "string"}]}, ["x", 1]),
        ({"$contains": [2]}, [1, 2, 3]),
        ({"$each": {"$any": "text"}}, ["a", "b"]),
        ({"$regex": "^a.c$"}, "abc"),
        ({"$one_of": [1, 2]}, 2),
        ({"$not": 1}, 2),
        ({"$all": [{"$any": "int"}, {"$not": 1}]}, 2),
        ({"a": {"$absent": True}, "b": 1}, {"b": 1}),
        ({"$time": [1, 2]}, {"sec": 1, "nanosec": 2}),
        ({"$type_name": "std_srvs/srv/Empty"}, "std_srvs/srv/Empty"),
        ({"$base64": "000102"}, "AAEC"),
        ({"$bytes": "00ff"}, b"\x00\xff"),
        ({"$tag": 85, "$values": [1]}, Tagged(85, struct.pack("<f", 1))),
        ({"$json": {"a": 1}}, '{"a": 1}'),
        ({"$float": "NaN"}, float("nan")),
        ({"a": 1, "$open": True}, {"a": 1, "b": 2}),
    ],
)
def test_what_fits(pattern: Json, value: Value) -> None:
    assert isinstance(match_frame({"v": pattern}, {"v": value}, Context()), Match)


@pytest.mark.parametrize(
    ("pattern", "value"),
    [
        (1, True),
        (True, 1),
        (None, 0),
        ({"$int": 4}, 4.0),
        ({"$any": "int"}, True),
        ({"$any": "text"}, ""),
        ({"a": 1}, {"a": 1, "b": 2}),
        ({"a": 1}, {}),
        ([1], [1, 2]),
        ({"$contains": [4]}, [1, 2, 3]),
        ({"$unordered": [1, 1]}, [1, 2]),
        ({"$time": [1, 2]}, {"secs": 1, "nsecs": 2}),
        ({"$now": True}, {"sec": 5, "nanosec": 0}),
        ({"$tag": 85}, Tagged(81, b"1234")),
        ({"$float": 0.5}, NarrowFloat(0.5)),
        ({"$json": 1}, "x"),
        ({"$use": "never bound"}, 1),
    ],
)
def test_what_does_not_fit(pattern: Json, value: Value) -> None:
    assert isinstance(match_frame({"v": pattern}, {"v": value}, Context()), Difference)


def test_a_difference_names_its_place() -> None:
    found = match_frame({"msg": {"a": [1, {"b": 2}]}}, {"msg": {"a": [1, {"b": 3}]}}, Context())
    assert str(found) == "at msg.a[1].b: expected 2, got 3"


def test_extra_keys_of_the_frame_are_told_and_inside_it_refused() -> None:
    assert match_frame({"op": "x"}, {"op": "x", "id": 1}, Context()) == Match(("id",))
    assert isinstance(match_frame({"op": {}}, {"op": {"id": 1}}, Context()), Difference)


def test_what_is_bound_can_be_used_and_a_failed_match_binds_nothing() -> None:
    context = Context()
    match_frame({"a": {"$bind": "x"}, "b": 2}, {"a": 1, "b": 3}, context)
    assert not context.names
    match_frame({"a": {"$bind": "x"}, "b": 2}, {"a": 1, "b": 2}, context)
    assert isinstance(match_frame({"a": {"$use": "x"}}, {"a": 1}, context), Match)
    assert isinstance(match_frame({"a": {"$use": "x"}}, {"a": "1"}, context), Difference)


_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**64), 2**64 - 1)
    | st.floats(allow_nan=False)
    | st.text()
    | st.binary(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)


@given(_VALUES)
def test_cbor_is_read_as_another_library_writes_it(value: object) -> None:
    data = cbor2.dumps(value)
    if not data.startswith((b"\xc2", b"\xc3")):
        assert read_cbor(data) == value


@given(st.binary(max_size=40))
def test_any_bytes_are_cbor_or_refused(data: bytes) -> None:
    try:
        read_cbor(data)
    except NotCbor as error:
        assert str(error)


@pytest.mark.parametrize(
    "data", [b"", b"\xbf\xff", b"\x9f\xff", b"\x5f\xff", b"\xa1\x01\x02", b"\x01\x02", b"\xff", b"\x61\xff"]
)
def test_cbor_that_clients_cannot_read_is_refused(data: bytes) -> None:
    with pytest.raises(NotCbor):
        read_cbor(data)


def test_every_cut_of_a_cbor_frame_is_refused() -> None:
    data = cbor2.dumps({"op": "publish", "msg": {"a": [1.5, b"xyz"], "b": cbor2.CBORTag(85, b"\0" * 8)}})
    assert read_cbor(data)
    for end in range(len(data)):
        with pytest.raises(NotCbor):
            read_cbor(data[:end])


def test_typed_arrays_have_whole_elements() -> None:
    assert typed_array(Tagged(77, b"\xff\xff\x01\x00")) == [-1, 1]
    assert typed_array(Tagged(77, b"\xff")) is None
    assert typed_array(Tagged(1, b"")) is None


def _picture(mode: str = "RGB", size: tuple[int, int] = (4, 6), data: bytes | None = None) -> str:
    file = io.BytesIO()
    Image.frombytes(mode, size, data or bytes(size[0] * size[1] * len(mode))).save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode()


@given(st.binary(min_size=72, max_size=72))
def test_pictures_of_another_library_are_read(pixels: bytes) -> None:
    picture = read_data(_picture(data=pixels))
    assert (picture.width, picture.height, picture.pixels) == (4, 6, pixels)


def test_pictures_that_clients_cannot_read_are_refused() -> None:
    with pytest.raises(NotPng, match="PNG-02"):
        read_data(_picture("RGBA"))
    with pytest.raises(NotPng, match="PNG-04"):
        read_data(_picture() + "\n")
    with pytest.raises(NotPng, match="signature"):
        read_png(b"GIF89a")
    data = base64.b64decode(_picture())
    for end in range(len(data) - 12):
        with pytest.raises(NotPng):
            read_png(data[:end])


def test_a_picture_of_wrong_size_is_told() -> None:
    text = b'{"op":"publish"}'.ljust(72, b"\n")
    found = open_png({"op": "png", "data": _picture(size=(2, 12), data=text)})
    assert isinstance(found, Difference)


def test_fragments_are_checked_one_by_one_and_together() -> None:
    good: dict[str, Value] = {"op": "fragment", "id": "f", "data": "ab", "num": 0, "total": 2}
    assert first_fault_of_fragment(good, 0, 2) is None
    for wrong in (
        {"id": 0},
        {"id": ""},
        {"total": 2.0},
        {"num": 1},
        {"num": 0.0},
        {"data": "abc"},
        {"data": ""},
    ):
        assert first_fault_of_fragment({**good, **wrong}, 0, 2) is not None
    assert join_fragments([good, {**good, "data": "cd"}], 2) == "abcd"
    assert isinstance(join_fragments([good, {**good, "id": "g"}], 2), Difference)
    assert isinstance(join_fragments([good], 2), Difference)


@pytest.mark.parametrize("text", ["NaN", '{"a": -Infinity}', "", "{", "x"])
def test_text_that_is_not_json_is_refused(text: str) -> None:
    with pytest.raises(NotJson):
        read_json(text)


@given(st.lists(st.dictionaries(st.text(), st.text() | st.none(), max_size=3), max_size=4), st.integers(1, 9))
def test_a_stream_is_cut_into_its_objects(objects: list[dict[str, str | None]], step: int) -> None:
    text = " \n".join(json.dumps(item, ensure_ascii=False) for item in objects)
    cutter = JsonCutter()
    cut = [piece for start in range(0, len(text), step) for piece in cutter.feed(text[start : start + step])]
    assert [json.loads(piece) for piece in cut] == objects
