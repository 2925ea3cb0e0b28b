"""Messages of which nearly all is one long string: completed and encoded around it, with the same outcome as
if the whole were decoded and encoded, and without copies of it."""

from __future__ import annotations

import base64
import json
import math
import tracemalloc
from collections.abc import Callable
from functools import partial
from random import Random
from typing import Any

import cbor2
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rwt_interfaces.distro import JAZZY, NOETIC
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.field_types import Array, Message
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.serialise import json_reader, large_json, long_lists, long_strings, splice
from rwt_interfaces.steps import finished
from rwt_interfaces.structs import MessageType
from rwt_interfaces.validation.mismatch import has_lone_surrogate

REGISTRIES = {1: Registry(NOETIC), 2: Registry(JAZZY)}
for _registry in REGISTRIES.values():
    _registry.add_text(
        "Header header\nstring s\nfloat32 f\nuint8[] data\nint64 n\nfloat64[] v\nstring t", "t_msgs/Mixed"
    )
    _registry.add_text(
        "string[] s\nMixed one\nwstring w\nduration d\nuint8[<=9] few", "t_msgs/Deep"
    ) if _registry is REGISTRIES[2] else _registry.add_text("string[] s\nMixed one\ntime d", "t_msgs/Deep")
    _registry.add_text("string s\nnav_msgs/OccupancyGrid map\nfloat64[] v\nMixed[] m", "t_msgs/Holder")
NAMES = (
    "sensor_msgs/Image", "sensor_msgs/PointCloud2", "sensor_msgs/CompressedImage", "std_msgs/String",
    "std_msgs/UInt8MultiArray", "t_msgs/Mixed", "t_msgs/Deep", "sensor_msgs/LaserScan",
    "sensor_msgs/JointState", "std_msgs/UInt64MultiArray", "nav_msgs/OccupancyGrid",
    "geometry_msgs/PoseWithCovariance", "nav_msgs/Path", "sensor_msgs/PointCloud",
    "visualization_msgs/MarkerArray", "trajectory_msgs/JointTrajectory", "t_msgs/Holder",
)  # fmt: skip
TEXTS = st.lists(
    st.sampled_from(["word ", "é", "\U0001f600", "\n", '"', "\\", "/", ",", " ", "}", ":"])
    | st.integers(1, 40).map(lambda count: "AbC4" * count),
    max_size=30,
).map("".join)
CHANCES = st.integers(0, 1 << 40).map(Random)
CONTENTS = (
    st.integers(0, 700).map(lambda size: base64.b64encode(Random(size).randbytes(size)).decode()) | TEXTS
)


def numbers(chance: Random) -> list[object]:
    """Numbers of an array, most of them as they may go out."""
    count = chance.choice((0, 1, 5, 36))
    some: tuple[object, ...] = (0, 1, 2.5, -3, 0.1, 1e39, 127, 2**63, 2**64, None, "x", True)
    return chance.choices(some, weights=(40, 40, 40, 9, 1, 1, 9, 1, 1, 1, 1, 1), k=count)


def now() -> int:
    return 5_000_000_007


def scrambled(value: Any, chance: Random) -> Any:
    """The same message as somebody in a hurry writes it: fields left out, spelt otherwise, of wrong types."""
    if isinstance(value, list):
        return (
            [scrambled(each, chance) for each in value]
            if value and chance.random() < 0.8
            else numbers(chance)
        )
    if not isinstance(value, dict):
        return chance.choice((value, int(value))) if isinstance(value, float) else value
    given = [(name, scrambled(each, chance)) for name, each in value.items()]
    given = [member for member in given if chance.random() > 0.15]
    if {"sec", "secs"} & value.keys() and chance.random() < 0.3:
        given = [({"sec": "secs", "nanosec": "nsecs"}.get(name, name), each) for name, each in given]
    if "frame_id" in value and chance.random() < 0.3:
        given.append(("seq", chance.choice((None, 7))))
    if given and chance.random() < 0.1:
        place = chance.randrange(len(given))
        wrong: object = chance.choice((None, True, 2**70, "now", [], {}, [1, 2], "x" * 50, 1.5))
        given[place] = (given[place][0], wrong)
    if chance.random() < 0.03:
        given.append((chance.choice(("zz", "data", "s")), "stranger"))
    if chance.random() < 0.3:
        chance.shuffle(given)
    return dict(given)


def peopled(kind: MessageType, chance: Random, deep: int = 0) -> Any:
    """A complete message in whose arrays of messages there are some."""
    message: Any = json.loads(bytes(Payload.from_value(kind, {}, now).json()))
    for slot in kind.slots:
        if isinstance(slot.type, Array) and isinstance(slot.type.element, Message) and deep < 2:
            count = chance.choice((0, 1, 3, 12))
            message[slot.name] = [peopled(slot.type.element.type, chance, deep + 1) for _ in range(count)]
        elif isinstance(slot.type, Message) and deep < 2:
            message[slot.name] = peopled(slot.type.type, chance, deep + 1)
    return message


def with_content(kind: MessageType, content: str, chance: Random) -> Any:
    """A complete message with the content in one of its strings, or octets."""
    message = peopled(kind, chance)
    spots: list[tuple[Any, Any]] = []
    level = [message]
    while level:
        each = level.pop()
        for name, value in each.items():
            if isinstance(value, dict):
                level.append(value)
            elif isinstance(value, str | list):
                spots.append((each, name))
    owner, name = chance.choice(spots)
    owner[name] = [content] if isinstance(owner[name], list) and chance.random() < 0.5 else content
    return message


def itself(payload: Payload) -> Payload:
    return payload


def outcome(take: Callable[[], Payload]) -> object:
    """A message in every form, as far as programs can tell them apart; or the refusal."""
    try:
        payload = take()
    except InvalidMessage as error:
        return str(error)
    # As text where there may be NaN.
    others = (cbor2.loads(payload.cbor()), payload.plain(), payload.value())
    return json.loads(bytes(payload.json())), payload.serialised(), payload.cdr(), *map(repr, others)


def wholly(kind: MessageType, raw: bytes) -> object:
    """Return the result of the lenient decoder for a text parsed by Python's own parser."""
    try:
        value: Any = json.loads(raw)
    except ValueError:
        return "not valid JSON"
    return outcome(lambda: Payload(kind, kind.decode_leniently(value, now)))


@settings(max_examples=1000)
@given(
    st.sampled_from(NAMES),
    st.sampled_from((1, 2)),
    CONTENTS,
    CHANCES,
    st.booleans(),
    st.sampled_from((0, 7, 60)),
    st.sampled_from(((",", ":"), (", ", ": "))),
)
@example("t_msgs/Deep", 1, ",", Random(2), False, 0, (",", ":"))  # one text with a comma, in an array
@example("t_msgs/Deep", 2, "", Random(914285), False, 0, (",", ":"))  # an empty array of doubles, in steps
def test_to_splice_is_to_decode_and_encode(
    name: str,
    version: int,
    content: str,
    chance: Random,
    ascii_only: bool,
    piece: int,
    separators: tuple[str, str],
) -> None:
    kind = REGISTRIES[version].message(name)
    message = scrambled(with_content(kind, content, chance), chance)
    raw = json.dumps(message, ensure_ascii=ascii_only, separators=separators).encode()
    expected = wholly(kind, raw)
    with pytest.MonkeyPatch().context() as small:
        small.setattr(long_strings, "BASE64_PIECE_BYTES", 64)
        small.setattr(long_strings, "TEXT_PIECE_BYTES", 64)
        for limit in ("LONG_STRING_BYTES", "WHOLE_BYTES", "SLOW_BYTES", "LONG_FORMS_BYTES"):
            small.setattr(json_reader, limit, 1)
        small.setattr(large_json, "CHUNK_BYTES", piece)
        small.setattr(large_json, "SLOW_CHUNK_BYTES", piece // 2)
        small.setattr(long_strings, "LONG_PART_BYTES", piece)
        for module in (long_lists, large_json):
            small.setattr(module, "CHUNK_ITEMS", 2)
        small.setattr(long_lists, "CHUNK_NUMBERS", 3)
        small.setattr(splice, "LONG_TEXT_CHARS", 20)
        small.setattr(splice, "_TEXT_STEP_CHARS", 7)
        for take in (
            lambda: Payload.from_json(kind, raw, now),
            lambda: Payload.from_json(kind, memoryview(raw), now).detach(),
            lambda: _asked(Payload.from_json(kind, memoryview(raw), now)).detach(),
            lambda: _prepared(Payload.from_json(kind, memoryview(raw), now)),
            lambda: _prepared(Payload.from_value(kind, Payload.from_json(kind, raw, now).value())),
        ):
            assert outcome(take) == expected


def _prepared(payload: Payload) -> Payload:
    finished(payload.prepare(("json", "cbor", "serialised")))
    return payload


def _asked(payload: Payload) -> Payload:
    payload.cbor_parts()
    return payload


@given(
    st.sampled_from(NAMES),
    CONTENTS,
    CHANCES,
    st.integers(0, 255),
    st.integers(-1, 1),
)
@example("t_msgs/Holder", "e2FOQooYb0pMEW2v6A==", Random(0), 128, 0)  # Not UTF-8, behind a wrong field.
def test_one_byte_changed_is_found_wherever_it_is(
    name: str, content: str, chance: Random, change: int, length: int
) -> None:
    """Put in, in place of another, or taken out: refused, or read as Python's own parser reads it."""
    kind = REGISTRIES[2].message(name)
    raw = json.dumps(with_content(kind, content, chance)).encode()
    place = chance.randrange(len(raw))
    changed = raw[:place] + (bytes([change]) if length >= 0 else b"") + raw[place + (length != 1) :]
    with pytest.MonkeyPatch().context() as small:
        for limit in ("LONG_STRING_BYTES", "WHOLE_BYTES", "SLOW_BYTES"):
            small.setattr(json_reader, limit, 1)
        small.setattr(large_json, "CHUNK_BYTES", 8)
        spliced = outcome(lambda: Payload.from_json(kind, changed, now))
        for limit in ("LONG_STRING_BYTES", "WHOLE_BYTES", "SLOW_BYTES"):
            small.setattr(json_reader, limit, 1 << 30)
        assert spliced == outcome(lambda: Payload.from_json(kind, changed, now))


@given(
    st.sampled_from(("sensor_msgs/Image", "t_msgs/Mixed")),
    st.integers(16_380, 16_420),
    st.sampled_from((1, 2)),
)
def test_long_octets_from_python_stand_apart(name: str, size: int, version: int) -> None:
    kind = REGISTRIES[version].message(name)
    octets = Random(size).randbytes(size)
    payload = Payload.from_value(kind, {"data": octets}, now)
    whole: Any = kind.decode_leniently({"data": octets}, now)
    assert payload.json() == kind.json.encode(whole)
    assert payload.cbor() == kind.to_cbor(whole)
    assert payload.serialised() == kind.serialise(whole)
    assert Payload.deserialised(kind, payload.serialised()).json() == payload.json()
    assert payload.value() == whole


# What is not copied

IMAGE = REGISTRIES[2].message("sensor_msgs/Image")
STRING = REGISTRIES[2].message("std_msgs/String")
PIXELS = Random(1).randbytes(921_600)
#: Bytes that a message may cost beside its pixels: two pieces of base64 are checked at a time.
SMALL = 160 * 1024


def image(**header: object) -> bytes:
    data = base64.b64encode(PIXELS).decode()
    return json.dumps({"header": header, "height": 480, "width": 640, "data": data}).encode()


def allocated(action: Callable[[], object]) -> int:
    """The most bytes that Python holds at a time for an action, its outcome included."""
    tracemalloc.start()
    try:
        action()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_an_incomplete_image_is_completed_around_its_pixels() -> None:
    raw = image(frame_id="camera")
    parts = Payload.from_json(IMAGE, raw, now).json_parts()
    kept = [part for part in parts if isinstance(part, memoryview)]
    assert [part.obj for part in kept] == [raw] and kept[0].obj is raw
    assert json.loads(b"".join(parts))["header"] == {"stamp": {"sec": 5, "nanosec": 7}, "frame_id": "camera"}


@pytest.mark.parametrize("header", [{}, {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": ""}])
def test_each_encoding_of_an_image_holds_its_pixels_once(header: dict[str, Any]) -> None:
    raw = image(**header)
    warm = Payload.from_json(IMAGE, raw)
    warm.json_parts(), warm.cbor_parts(), warm.serialised_parts()

    def arrive() -> Payload:
        return Payload.from_json(IMAGE, memoryview(raw))

    assert allocated(lambda: arrive().json_parts()) < SMALL
    payload = arrive()
    assert allocated(payload.cbor_parts) < len(PIXELS) + SMALL
    assert allocated(payload.serialised_parts) < SMALL, "the octets of CBOR are those of CDR"
    pixels = {id(part) for part in (*payload.cbor_parts(), *payload.serialised_parts()) if len(part) > SMALL}
    assert len(pixels) == 1
    assert payload.cbor_parts() is payload.cbor_parts()


def test_a_long_text_goes_into_every_encoding_as_it_came() -> None:
    text = "The quick brown fox. " * 50_000
    raw = json.dumps({"data": text}).encode()
    Payload.from_json(STRING, raw).cbor_parts()

    def relay() -> object:
        payload = Payload.from_json(STRING, raw)
        return payload.json_parts(), payload.cbor_parts(), payload.serialised_parts()

    assert allocated(relay) < SMALL
    payload = Payload.from_json(STRING, raw)
    views = [part for part in (*payload.cbor_parts(), *payload.serialised_parts()) if len(part) > SMALL]
    assert all(isinstance(view, memoryview) and view.obj is raw for view in views) and len(views) == 2
    assert cbor2.loads(payload.cbor()) == {"data": text}
    assert payload.plain() == {"data": text}


def test_octets_become_base64_once() -> None:
    payload = Payload.from_value(IMAGE, {"data": PIXELS})
    first, again = payload.json_parts(), payload.json_parts()
    assert [id(part) for part in first if len(part) > SMALL] == [
        id(part) for part in again if len(part) > SMALL
    ]
    data = payload.cbor_parts()[1]
    assert data is PIXELS
    assert json.loads(bytes(payload.json()))["data"] == base64.b64encode(PIXELS).decode()


def test_a_refused_image_is_refused_in_the_same_words() -> None:
    data = base64.b64encode(PIXELS)
    for raw, words in (
        (b'{"width":-1,"data":"%b"}' % data, "width: expected uint32, got -1, which is out of range"),
        (b'{"encoding":1,"data":"%b"}' % data, "encoding: expected string, got 1"),
        (b'{"width":"%b"}' % data, f'width: expected uint32, got "{data[:40].decode()}…"'),
        (b'{"data":"%b"' % data, "not valid JSON"),
        (b'{"data":"%b","encoding":"\xff"}' % data, "not valid UTF-8"),
    ):
        with pytest.raises(InvalidMessage) as refused:
            Payload.from_json(IMAGE, raw)
        assert str(refused.value) == words


@pytest.mark.parametrize("count", [2000, 40_000])
def test_an_incomplete_scan_is_completed(count: int) -> None:
    """Numbers that are not float32 are sent as the nearest ones."""
    kind = REGISTRIES[2].message("sensor_msgs/LaserScan")
    ranges, intensities = ", ".join(["1.5", "null"] * count), ", ".join(["0.1"] * 2 * count)
    raw = f'{{"header":{{}},"ranges":[{ranges}],"angle_min":0.1,"intensities":[{intensities}]}}'.encode()
    payload = Payload.from_json(kind, memoryview(raw), now)
    sent = json.loads(bytes(payload.json()))
    assert sent["header"]["stamp"] == {"sec": 5, "nanosec": 7}
    assert sent["angle_min"] == 0.10000000149011612
    assert sent["intensities"] == [0.10000000149011612] * 2 * count
    assert payload.detach().json() == payload.json()
    value: Any = payload.value()
    assert value.ranges[0] == 1.5 and math.isnan(value.ranges[1])


@given(
    st.sampled_from(("sensor_msgs/Image", "t_msgs/Mixed", "sensor_msgs/LaserScan", "sensor_msgs/JointState")),
    CONTENTS,
    CHANCES,
    st.booleans(),
)
def test_to_number_a_message_is_to_change_its_sequence(
    name: str, content: str, chance: Random, is_large: bool
) -> None:
    kind = REGISTRIES[1].message(name)
    raw = json.dumps(scrambled(with_content(kind, content, chance), chance)).encode()
    try:
        whole: Any = kind.decode_leniently(json.loads(raw), now)
    except InvalidMessage:
        return
    whole.header.seq = 77
    with pytest.MonkeyPatch().context() as small:
        if is_large:
            for limit in ("LONG_STRING_BYTES", "WHOLE_BYTES", "SLOW_BYTES"):
                small.setattr(json_reader, limit, 1)
            small.setattr(large_json, "CHUNK_BYTES", 8)
        numbered = Payload.from_json(kind, memoryview(raw), now).numbered(77)
        again = Payload.from_value(kind, Payload.from_json(kind, raw, now).value()).numbered(77)
        expected = outcome(lambda: Payload(kind, whole))
        for each in (numbered, again, numbered.detach()):
            assert outcome(partial(itself, each)) == expected


@pytest.mark.parametrize("letter", ["a", "é", "漢", "🤖", '"', "\\", "\n", "\u2028"])
def test_a_long_text_of_a_program_is_written_in_steps(letter: str) -> None:
    kind = REGISTRIES[2].message("std_msgs/String")
    text = "x" * 65_535 + letter * splice.LONG_TEXT_CHARS
    payload = Payload.from_value(kind, {"data": text})
    assert payload.is_long
    assert len([*payload.prepare(("json", "cbor", "serialised"))]) > 4
    assert payload.json() == json.dumps({"data": text}, ensure_ascii=False, separators=(",", ":")).encode()
    assert cbor2.loads(payload.cbor()) == {"data": text}
    assert not Payload.from_value(kind, {"data": "x" * (splice.LONG_TEXT_CHARS - 1)}).is_long


@pytest.mark.parametrize("text", ["\ud83d", "a\ude00b", "\ude00\ud83d", "é\ud83dé", "漢\udfff", "🤖\ud83d"])
def test_half_a_letter_is_refused_as_utf_8_refuses_it(text: str) -> None:
    with pytest.raises(UnicodeEncodeError):
        text.encode()
    assert has_lone_surrogate(text)
    with pytest.raises(InvalidMessage):
        Payload.from_value(REGISTRIES[2].message("std_msgs/String"), {"data": text})


def test_a_long_text_with_escapes_is_made_binary_in_steps() -> None:
    kind = REGISTRIES[2].message("std_msgs/String")
    text = 'é\n"' * splice.LONG_TEXT_CHARS
    raw = json.dumps({"data": text}, ensure_ascii=False, separators=(",", ":")).encode()
    payload = Payload.from_json(kind, raw)
    assert payload.is_long
    assert list(payload.prepare(("json",))) == []
    assert len(list(payload.prepare(("cbor", "serialised")))) >= len(text) >> 16
    assert cbor2.loads(payload.cbor()) == {"data": text}
    through: Any = kind.deserialise(payload.serialised())
    assert through.data == text
    assert not Payload.from_json(kind, json.dumps({"data": "x" * len(text)}).encode()).is_long
