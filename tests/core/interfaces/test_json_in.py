"""Messages arriving as JSON: what is passed on untouched, what is completed, what is refused and how."""

from __future__ import annotations

import base64
import json
import math
from itertools import product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_interfaces.distro import JAZZY, NOETIC
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.serialise import json_reader, long_strings

REGISTRIES = {1: Registry(NOETIC), 2: Registry(JAZZY)}
REGISTRIES[2].add_text("string<=3 s\nuint8[<=2] u\nint8[] i\nbyte[] b\nchar c\nwstring w", "t_msgs/Odd")
REGISTRIES[2].add_text("Header header\nuint64 n\nstring s\nuint8[] data", "t_msgs/Long")
REGISTRIES[2].add_text("bool b\nbool[] bs\nfloat64[3] v\nuint8[4] u", "t_msgs/Fixed")

TWIST = b'{"linear":{"x":1.0,"y":0.0,"z":0.0},"angular":{"x":0.0,"y":0.0,"z":0.5}}'


def now() -> int:
    return 5_000_000_007


def take(name: str, raw: bytes | memoryview, version: int = 2) -> Payload:
    return Payload.from_json(REGISTRIES[version].message(name), raw, now)


def sent(name: str, raw: bytes, version: int = 2) -> str:
    return bytes(take(name, raw, version).json()).decode()


UNTOUCHED = [
    ("geometry_msgs/Twist", TWIST),
    ("geometry_msgs/Twist", TWIST.replace(b"1.0", b"1")),
    ("geometry_msgs/Twist", TWIST.replace(b"1.0", b"null")),
    ("geometry_msgs/Vector3", b' { "z" : 1e3, "y" : -0, "x" : 1 } '),
    ("std_msgs/String", '{"data":"\\u0000 é \\ud83d\\ude00 😀"}'.encode()),
    ("std_msgs/Int64", b'{"data":-9223372036854775808}'),
    ("std_msgs/UInt64", b'{"data":18446744073709551615}'),
    ("std_msgs/Float32", b'{"data":3.4028234663852886e38}'),
    ("std_msgs/Empty", b"{}"),
    ("std_msgs/Header", b'{"stamp":{"sec":0,"nanosec":0},"frame_id":""}'),
    ("t_msgs/Fixed", b'{"b":true,"bs":[false],"v":[1,2,3],"u":"AAAAAA=="}'),
    ("t_msgs/Odd", b'{"s":"abc","u":[1,255],"i":[-128],"b":[255],"c":7,"w":"w"}'),
]


@pytest.mark.parametrize(("name", "raw"), UNTOUCHED)
def test_a_complete_message_keeps_its_bytes(name: str, raw: bytes) -> None:
    assert take(name, raw).json() is raw


COMPLETED = [
    # JSN-26: missing fields get defaults.
    ("geometry_msgs/Vector3", b'{"y":2}', '{"x":0.0,"y":2.0,"z":0.0}'),
    ("t_msgs/Fixed", b"{}", '{"b":false,"bs":[],"v":[0.0,0.0,0.0],"u":"AAAAAA=="}'),
    # JSN-20: octets as a list; bounded ones as base64 too, but they go out as a list (JSN-02).
    ("sensor_msgs/CompressedImage", b'{"header":{"stamp":{}},"data":[1,2,3]}', '"format":"","data":"AQID"}'),
    ("t_msgs/Odd", b'{"u":"AQI="}', '"u":[1,2]'),
    # JSN-33, and what other programs make of NaN.
    ("geometry_msgs/Vector3", b'{"x":NaN,"y":-Infinity,"z":1e999}', '{"x":null,"y":null,"z":null}'),
    ("std_msgs/Float32MultiArray", b'{"data":[1,null,NaN,Infinity]}', '"data":[1.0,null,null,null]}'),
    # PUB-05, PUB-06: stamps.
    ("std_msgs/Header", b"{}", '{"stamp":{"sec":5,"nanosec":7},"frame_id":""}'),
    ("std_msgs/Header", b'{"stamp":{"sec":12}}', '{"stamp":{"sec":12,"nanosec":7},"frame_id":""}'),
    ("geometry_msgs/PointStamped", b'{"point":{}}',
     '{"header":{"stamp":{"sec":5,"nanosec":7},"frame_id":""}'),
    ("geometry_msgs/PointStamped", b'{"header":{"frame_id":"a"}}', '{"sec":5,"nanosec":7},"frame_id":"a"}'),
    ("geometry_msgs/PointStamped", b'{"header":{"stamp":{"sec":0,"nanosec":0}}}',
     '{"header":{"stamp":{"sec":0,"nanosec":0}'),
    ("nav_msgs/Path", b'{"poses":[{}]}', '"poses":[{"header":{"stamp":{"sec":5,"nanosec":7}'),
    # JSN-27: both spellings, sec wins, strangers in a time are ignored; JSN-28: "now".
    ("builtin_interfaces/Time", b'{"secs":1,"nsecs":2}', '{"sec":1,"nanosec":2}'),
    ("builtin_interfaces/Time", b'{"secs":1,"sec":3,"nsec":2,"bogus":[]}', '{"sec":3,"nanosec":2}'),
    ("builtin_interfaces/Time", b'"now"', '{"sec":5,"nanosec":7}'),
    ("builtin_interfaces/Duration", b'{"sec":-1}', '{"sec":-1,"nanosec":0}'),
    # roslibpy's Header, whatever it talks to.
    ("std_msgs/Header", b'{"seq":null,"stamp":{"secs":1,"nsecs":2},"frame_id":"a"}', '{"stamp":{"sec":1,'),
]  # fmt: skip


@pytest.mark.parametrize(("name", "raw", "expected"), COMPLETED)
def test_an_incomplete_message_is_completed(name: str, raw: bytes, expected: str) -> None:
    assert expected in sent(name, raw)


def test_ros_1_spells_time_its_own_way() -> None:
    given_text = b'{"seq":null,"stamp":{"sec":3,"nanosec":4},"frame_id":"a"}'
    assert sent("std_msgs/Header", given_text, 1) == '{"seq":0,"stamp":{"secs":3,"nsecs":4},"frame_id":"a"}'
    exact = b'{"seq":9,"stamp":{"secs":3,"nsecs":4},"frame_id":"a"}'
    assert take("std_msgs/Header", exact, 1).json() is exact
    assert sent("std_msgs/Time", b'{"data":"now"}', 1) == '{"data":{"secs":5,"nsecs":7}}'
    assert (
        sent("std_msgs/Duration", b'{"data":{"secs":-1,"nsecs":-2}}', 1) == '{"data":{"secs":-1,"nsecs":-2}}'
    )


REFUSED = [
    ("geometry_msgs/Twist", b'{"linear":{"x":"fast"}}', "linear.x", 'expected float64, got "fast"'),
    ("geometry_msgs/Twist", b'{"linear":{"x":true}}', "linear.x", "expected float64, got true"),
    ("geometry_msgs/Twist", b'{"linear":{"bogus":1}}', "linear",
     'geometry_msgs/Vector3 has no field "bogus"; it has x, y, z'),
    ("std_msgs/Empty", b'{"x":1}', "", 'std_msgs/Empty has no field "x"; it has no fields'),
    ("geometry_msgs/Twist", b"[]", "", "expected a geometry_msgs/Twist object, got a list"),
    ("geometry_msgs/Twist", b'{"linear":null}', "linear",
     "expected a geometry_msgs/Vector3 object, got null"),
    ("geometry_msgs/PoseArray", b'{"poses":[{},{},{},{"position":1}]}', "poses[3].position", None),
    ("std_msgs/Int8", b'{"data":1.0}', "data", "expected int8, got 1.0"),
    ("std_msgs/Int8", b'{"data":128}', "data", "expected int8, got 128, which is out of range"),
    ("std_msgs/Int8", b'{"data":false}', "data", "expected int8, got false"),
    ("std_msgs/Bool", b'{"data":1}', "data", "expected bool, got 1"),
    ("std_msgs/String", b'{"data":1}', "data", "expected string, got 1"),
    ("std_msgs/String", b'{"data":null}', "data", "expected string, got null"),
    ("std_msgs/Int8MultiArray", b'{"data":["\\ud800"]}', "data[0]", 'expected int8, got "?"'),
    ("std_msgs/Float32MultiArray", b'{"data":[1,"\\ud800"]}', "data[1]", 'expected float32, got "?"'),
    ("std_msgs/Float64MultiArray", b'{"data":["\\ud800"]}', "data[0]", 'expected float64, got "?"'),
    ("std_msgs/String", b'{"data":"\\ud800"}', "data", "expected string, got text with a lone surrogate"),
    ("std_msgs/UInt64", b'{"data":18446744073709551616}', "data", None),
    ("std_msgs/UInt64MultiArray", b'{"data":[1,18446744073709551616]}', "data[1]", None),
    ("std_msgs/Int64", b'{"data":9223372036854775808}', "data", None),
    ("std_msgs/Int64", b'{"data":%s}' % (b"9" * 4000), "data", None),
    ("std_msgs/Float32", b'{"data":3.5e38}', "data", "expected float32, got 3.5e+38, which is out of range"),
    ("std_msgs/Float64", b'{"data":%s}' % (b"9" * 400), "data", None),
    ("std_msgs/Float32MultiArray", b'{"data":[1,1e39]}', "data[1]", None),
    ("std_msgs/Int8MultiArray", b'{"data":"AAAA"}', "data", 'expected int8[], got "AAAA"'),
    ("std_msgs/Int8MultiArray", b'{"data":[1,2,"3"]}', "data[2]", 'expected int8, got "3"'),
    ("std_msgs/UInt8MultiArray", b'{"data":"AAA"}', "data", None),
    ("std_msgs/UInt8MultiArray", b'{"data":"AA\\nAA"}', "data", None),
    ("std_msgs/UInt8MultiArray", b'{"data":[1,256]}', "data[1]", None),
    ("std_msgs/UInt8MultiArray", b'{"data":[true]}', "data[0]", "expected uint8, got true"),
    ("std_msgs/UInt8MultiArray", b'{"data":3}', "data", "expected uint8[] as base64 or a list, got 3"),
    ("t_msgs/Fixed", b'{"v":[1,2]}', "v", "expected 3 elements, got 2"),
    ("t_msgs/Fixed", b'{"u":"AAAA"}', "u", "expected 4 elements, got 3"),
    ("t_msgs/Odd", b'{"s":"abcd"}', "s", "expected at most 3 characters, got 4"),
    ("t_msgs/Odd", b'{"u":[1,2,3]}', "u", "expected at most 2 elements, got 3"),
    ("builtin_interfaces/Time", b'{"nanosec":-1}', "nanosec", None),
    ("builtin_interfaces/Time", b'{"bogus":1}', "", 'time has no field "bogus"; it has sec, nanosec'),
    ("builtin_interfaces/Duration", b'{"x":1}', "", 'duration has no field "x"; it has sec, nanosec'),
    ("std_msgs/Header", b'{"stamp":{"bogus":1}}', "stamp", 'time has no field "bogus"; it has sec, nanosec'),
    ("builtin_interfaces/Time", b"5", "", "expected a time {sec, nanosec}, got 5"),
    ("builtin_interfaces/Duration", b'"now"', "", 'expected a duration {sec, nanosec}, got "now"'),
    ("std_msgs/Header", b'{"stamp":{"sec":1.5}}', "stamp.sec", "expected int32, got 1.5"),
    ("std_msgs/String", b"", "", "not valid JSON"),
    ("std_msgs/String", b'{"data":"', "", "not valid JSON"),
    ("std_msgs/String", b'{"data":"a"} x', "", "not valid JSON"),
    ("std_msgs/String", b'{"data":"\xff"}', "", "not valid UTF-8"),
    ("std_msgs/String", b'{"data":"\xed\xa0\x80"}', "", "not valid UTF-8"),
    ("std_msgs/String", b"[" * 100_000, "", "nested too deeply"),
    ("std_msgs/String", b'{"a":' * 100_000, "", "nested too deeply"),
    ("std_msgs/String", '{"data":"a"}'.encode("utf-16"), "", "not valid UTF-8"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "raw", "path", "reason"), REFUSED)
def test_a_misfit_is_refused_and_named(name: str, raw: bytes, path: str, reason: str | None) -> None:
    with pytest.raises(InvalidMessage) as refused:
        take(name, raw)
    assert refused.value.path == path
    if reason is not None:
        assert refused.value.reason == reason


def test_ros_1_refuses_negative_times_but_not_durations() -> None:
    with pytest.raises(InvalidMessage, match=r"^stamp\.secs: expected uint32, got -3"):
        take("std_msgs/Header", b'{"stamp":{"secs":-3}}', 1)


def test_a_misfit_is_told_in_few_words_and_encodable() -> None:
    with pytest.raises(InvalidMessage) as refused:
        take("std_msgs/Int8", json.dumps({"data": "\ud800" + "x" * 1000}).encode())
    assert len(str(refused.value).encode()) < 100


# Anything at all

_NAMES = [
    "geometry_msgs/Twist", "std_msgs/String", "t_msgs/Long", "t_msgs/Odd", "nav_msgs/Path",
    "std_msgs/UInt64",
]  # fmt: skip
_TOKENS = st.sampled_from(
    [
        b'"', b"\\", b"{", b"}", b"[", b"]", b":", b",", b"null", b"1", b"-", b"1e999", b"NaN", b'"data":',
        b'"AAAA"', b"\xff", b'"linear":', b'"header":', b'"stamp":', b'"x":', b'"now"', b"\\u", b"d800",
        b" ", b"\x00", b"9" * 30, b'"s":',
    ]
)  # fmt: skip


@given(
    st.sampled_from(_NAMES), st.one_of(st.binary(max_size=200), st.lists(_TOKENS, max_size=30).map(b"".join))
)
def test_any_bytes_give_a_payload_or_a_payload_error(name: str, raw: bytes) -> None:
    try:
        payload = take(name, raw)
    except InvalidMessage:
        return
    payload.value()
    assert isinstance(json.loads(bytes(payload.json())), dict)


@given(
    st.sampled_from(_NAMES),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.just("now"),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(
                st.sampled_from(
                    ["data", "s", "u", "header", "stamp", "sec", "nsecs", "linear", "x", "poses", "n", "zz"]
                ),
                inner,
                max_size=4,
            )
        ),
        max_leaves=12,
    ),
)
def test_any_json_gives_a_payload_or_a_payload_error(name: str, value: Any) -> None:
    raw = json.dumps(value).encode()
    try:
        payload = take(name, raw)
    except InvalidMessage:
        return
    again = take(name, payload.json())
    assert again.json() is payload.json(), "what goes out is fit to be passed on"


_COMPLETE = [
    TWIST,
    b'{"header":{"stamp":{"sec":1,"nanosec":2},"frame_id":"a\\u00e9"},"n":18446744073709551615,"s":"t","data":"AAEC"}',
    b'{"b":true,"bs":[false],"v":[1,null,3e-1],"u":"AAAAAA=="}',
]
_CHANGES = st.sampled_from(list(b'{}[]",:\\/0129-+.eEtnu \n\x00\xc3\xff='))


@given(
    st.sampled_from(
        list(zip(["geometry_msgs/Twist", "t_msgs/Long", "t_msgs/Fixed"], _COMPLETE, strict=True))
    ),
    st.integers(0, 120),
    _CHANGES,
    st.integers(-1, 1),
)
def test_a_message_with_one_byte_changed(
    message: tuple[str, bytes], place: int, change: int, length: int
) -> None:
    """Put in, in place of another, or taken out: what is still passed on, Python's own parser reads alike."""
    name, raw = message
    place %= len(raw)
    changed = raw[:place] + (bytes([change]) if length >= 0 else b"") + raw[place + (length != 1) :]
    try:
        payload = take(name, changed)
    except InvalidMessage:
        return
    if payload.json() is changed:
        kind = REGISTRIES[2].message(name)
        assert (
            Payload.from_value(kind, json.loads(changed)).json()
            == Payload.from_value(kind, payload.value()).json()
        )


# Large texts take quicker ways, which must accept the same


def large(content: str, **others: object) -> bytes:
    return json.dumps(
        {
            "header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "f"},
            "n": 1,
            "s": "",
            **others,
            "data": content,
        }
    ).encode()


PICTURE = base64.b64encode(bytes(range(256)) * 40).decode()


def test_a_large_message_keeps_its_bytes_and_its_value() -> None:
    raw = large(PICTURE)
    payload = take("t_msgs/Long", memoryview(raw))
    assert bytes(payload.json()) == raw
    value: Any = payload.value()
    assert value.data == bytes(range(256)) * 40
    text = json.dumps({"data": "é" * 9000 + "\\" * 9000}, ensure_ascii=False).encode()
    assert take("std_msgs/String", text).json() is text
    string: Any = take("std_msgs/String", text).value()
    assert string.data == "é" * 9000 + "\\" * 9000


@pytest.mark.parametrize(
    ("name", "raw"),
    [
        ("t_msgs/Long", large(PICTURE[:-1])),
        ("t_msgs/Long", large(PICTURE[:3000] + "\n" + PICTURE[3000:])),
        ("t_msgs/Long", large(PICTURE, n=2**64)),
        ("t_msgs/Long", large(PICTURE, n=1.0)),
        ("t_msgs/Long", large(PICTURE, zz=1)),
        ("t_msgs/Long", large(PICTURE) + b"x"),
        ("t_msgs/Long", large(PICTURE)[:-1]),
        ("t_msgs/Long", large(PICTURE).replace(b'"data"', b'"data')),
        ("t_msgs/Long", large(PICTURE).replace(b'"data": ', b'"data": \\')),
        ("std_msgs/String", b'{"data":"%s\xff"}' % (b"x" * 9000)),
        ("std_msgs/String", b'{"data":"%s\n"}' % (b"x" * 9000)),
        ("std_msgs/String", b'{"data":"%s\\x"}' % (b"x" * 9000)),
        ("std_msgs/String", b'{"data":"%s\\ud800"}' % (b"x" * 9000)),
        ("std_msgs/String", b'{"data":"%s","x":1}' % (b"x" * 9000)),
        ("t_msgs/Odd", b'{"s":"%s","u":[],"i":[],"b":[],"c":0,"w":""}' % (b"A" * 8000)),
        ("t_msgs/Fixed", b'{"b":true,"bs":[],"v":[1,2,3],"u":"%s"}' % (b"A" * 8000)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_large_misfit_is_refused(name: str, raw: bytes) -> None:
    with pytest.raises(InvalidMessage):
        take(name, raw)


_PIECES = st.lists(
    st.sampled_from(
        [
            "A", "/", "=", '"', "\\", "\\u0041", '","s":"', '":"', "é", "\\\\", "\\ud83d", "\\ude00",
            "\x01", " ", "}",
        ]
    )
    | st.integers(1, 30).map(lambda count: "AAAA" * count),
    max_size=12,
).map("".join)  # fmt: skip


@pytest.mark.parametrize("name", ["t_msgs/Long", "std_msgs/String"])
@given(content=_PIECES, before=_PIECES, cut=st.integers(0, 3), spaced=st.booleans())
def test_the_quick_check_of_large_texts_accepts_what_the_plain_one_does(
    name: str, content: str, before: str, cut: int, spaced: bool
) -> None:
    """With the sizes turned down, so that hypothesis reaches every boundary."""
    head = f'{{"header":{{"stamp":{{"sec":1,"nanosec":2}},"frame_id":"{before}"}},"n":1,"s":"","data":'
    text = (head if name == "t_msgs/Long" else '{"data":') + (" " if spaced else "") + f'"{content}"}}'
    raw = text.encode()[: len(text.encode()) - cut]
    patch = pytest.MonkeyPatch()
    with patch.context() as small:
        small.setattr(json_reader, "LONG_STRING_BYTES", 1 << 30)
        plain = accepts(name, raw)
        small.setattr(long_strings, "BASE64_PIECE_BYTES", 16)
        small.setattr(long_strings, "TEXT_PIECE_BYTES", 16)
        for margin, at_once in product((12, 24, 60), (0, 1 << 20)):
            small.setattr(long_strings, "MARGIN_BYTES", margin)
            small.setattr(long_strings, "AT_ONCE_BYTES", at_once)
            small.setattr(json_reader, "LONG_STRING_BYTES", 4 * margin)
            assert accepts(name, raw) == plain


def accepts(name: str, raw: bytes) -> bool:
    """Return True if the bytes are passed on unchanged."""
    try:
        return take(name, raw).json() is raw
    except InvalidMessage:
        return False


def test_infinity_in_a_large_float32_array_is_taken() -> None:
    raw = b'{"data":[%s]}' % b",".join([b"1.5", b"Infinity", b"null"] * 2000)
    value: Any = take("std_msgs/Float32MultiArray", raw).value()
    assert value.data[:2] == [1.5, math.inf] and math.isnan(value.data[2])


@pytest.mark.parametrize(
    ("name", "raw", "sent"),
    [
        ("std_msgs/Float32", b'{"data":0.1}', b'{"data":0.10000000149011612}'),
        ("std_msgs/Float32", b'{"data":1}', b'{"data":1}'),
        ("std_msgs/Float32", b'{"data":null}', b'{"data":null}'),
        ("std_msgs/Float64", b'{"data":0.1}', b'{"data":0.1}'),
        ("std_msgs/ColorRGBA", b'{"r":0.5,"g":0.2,"b":0,"a":1}',
         b'{"r":0.5,"g":0.20000000298023224,"b":0.0,"a":1.0}'),
        ("geometry_msgs/Point32", b'{"x":0.25,"y":2,"z":-8.5}', b'{"x":0.25,"y":2,"z":-8.5}'),
    ],
)  # fmt: skip
def test_a_float32_is_sent_as_the_number_that_it_holds(name: str, raw: bytes, sent: bytes) -> None:
    assert take(name, raw).json() == sent


@pytest.mark.parametrize(
    ("numbers", "sent"),
    [
        (b"[0.5,null,1]", b"[0.5,null,1]"),
        (b"[0.5,0.1,null]", b"[0.5,0.10000000149011612,null]"),
        (b"[]", b"[]"),
    ],
)
def test_float32_arrays_too(numbers: bytes, sent: bytes) -> None:
    layout = b'{"layout":{"dim":[],"data_offset":0},"data":%b}'
    assert take("std_msgs/Float32MultiArray", layout % numbers).json() == layout % sent


def test_fields_that_are_left_out_are_bounded_over_the_whole_message() -> None:
    few, many = (b'{"points":[' + b'{"x":1},' * count + b"{}]}" for count in (45_000, 80_000))
    assert sent("geometry_msgs/Polygon", few).startswith('{"points":[{"x":1.0,"y":0.0,"z":0.0},')
    with pytest.raises(
        InvalidMessage, match="more than 30000 fields are missing: send them with their values"
    ):
        take("geometry_msgs/Polygon", many)
    odd = b'{"points":[' + b'{"x":Infinity},' * 15_000 + b"{}]}"
    with pytest.raises(InvalidMessage, match="more than 30000 fields are missing"):
        take("geometry_msgs/Polygon", odd)
    with pytest.raises(InvalidMessage, match="more than 30000 fields are missing"):
        take("visualization_msgs/MarkerArray", b'{"markers":[' + b"{}," * 5_000 + b"{}]}")


@pytest.mark.parametrize(
    "head", ["", '{"op":"publish","topic":"/t","msg":', '{"id":"{\\"data\\": \\"aaaa","msg":']
)
@pytest.mark.parametrize(
    ("content", "is_valid"),
    [
        ("a" * 5000, True),
        ("a" * 5000 + "é", True),
        ("a" * 5000 + "\n", False),
        ("a" * 2500 + '", "x": "' + "a" * 2500, False),
        ("a" * 5000 + "\\n", True),
        ("a" * 5000 + "\\", False),
        ("a" * 5000 + "\ud800", False),
    ],
)
def test_a_text_within_a_frame_is_proven_where_it_stands(head: str, content: str, is_valid: bool) -> None:
    payload = f'{{"data": "{content}"}}'
    frame = (head + payload + ("}" if head else "")).encode("utf-8", "surrogatepass")
    raw = memoryview(frame)[len(head.encode()) :]
    raw = raw[:-1] if head else raw
    kind = Registry().message("std_msgs/String")
    for at_once in (0, 1 << 20):
        with pytest.MonkeyPatch().context() as other:
            other.setattr(long_strings, "AT_ONCE_BYTES", at_once)
            if is_valid:
                assert bytes(Payload.from_json(kind, raw).json()) == bytes(raw)
            else:
                with pytest.raises(InvalidMessage):
                    Payload.from_json(kind, raw)
