"""Messages as pictures: pixels that every client reads, and pictures that are not trusted."""

from __future__ import annotations

import base64
import io
import json
import random
import struct
import sys
import zlib
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from rwt_protocol.codecs import png
from rwt_protocol.errors import Refused
from rwt_protocol.frames import Frame
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Direction, Publish
from rwt_protocol.payloads import RawJson
from rwt_protocol.profiles import ROS1, ROS2_2024, Profile
from rwt_protocol.session import Refusal, Session
from tests.core.protocol.wire_examples import EXAMPLES, Picture, only, text_of

LIMIT = 10_000_000


def data_of(frame: Frame) -> str:
    message = json.loads(frame.data)
    assert list(message) == ["op", "data"]
    assert message["op"] == "png"
    data: str = message["data"]
    return data


def opened(data: str) -> Image.Image:
    return Image.open(io.BytesIO(base64.b64decode(data, validate=True)))


@pytest.mark.parametrize("example", EXAMPLES.png)
def test_the_shared_picture(example: Picture) -> None:
    text = png.decode(example.png_base64, LIMIT)
    assert text.hex() == example.pixel_bytes_hex
    assert text.rstrip(b"\n").decode() == example.inner_json
    image = opened(data_of(png.encode(Frame(example.inner_json.encode()))))
    assert (image.size, image.mode) == ((example.width, example.height), "RGB")
    assert image.tobytes().hex() == example.pixel_bytes_hex


@given(st.text(), st.integers(0, 4000))
def test_an_independent_reader_finds_the_text(text: str, size: int) -> None:
    message = json.dumps({"op": "publish", "x": text + "y" * size}, ensure_ascii=False)
    data = data_of(png.encode(Frame(message.encode())))
    image = opened(data)
    assert image.mode == "RGB"
    assert not image.info
    pixels = image.tobytes()
    assert pixels.isascii()
    assert json.loads(pixels) == json.loads(message)
    assert png.decode(data, LIMIT) == pixels


@pytest.mark.parametrize("filter_level", [0, 9])
def test_a_picture_with_filtered_rows_is_read(filter_level: int) -> None:
    text = bytes(range(32, 127)) * 30
    buffer = io.BytesIO()
    Image.frombytes("RGB", (95, 10), text[: 95 * 10 * 3]).save(buffer, "PNG", compress_level=filter_level)
    assert png.decode(base64.b64encode(buffer.getvalue()).decode(), LIMIT) == text[: 95 * 10 * 3]


def picture(width: int, height: int, rows: bytes, kind: tuple[int, ...] = (8, 2, 0, 0, 0)) -> str:
    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    header = struct.pack(">IIBBBBB", width, height, *kind)
    whole = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    return base64.b64encode(whole).decode()


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        ("!!!", "png.data: expected base64"),
        ("é", "png.data: expected base64"),
        ("", "png.data: expected a PNG picture of 8-bit RGB, not interlaced"),
        ("AAAA", "png.data: expected a PNG picture of 8-bit RGB, not interlaced"),
        (picture(1, 1, b"", (8, 6, 0, 0, 0)),
         "png.data: expected a PNG picture of 8-bit RGB, not interlaced"),
        (picture(0, 1, b""), "png.data: expected a PNG picture of 8-bit RGB, not interlaced"),
        (picture(100_000, 100_000, zlib.compress(bytes(10_000))),
         "png.data: the picture holds 30000000000 bytes; the limit is 1000"),
        (picture(2, 2, zlib.compress(bytes(13))), "png.data: the picture is cut short"),
        (picture(2, 2, b"xyz"), "png.data: the picture is damaged"),
        (picture(1, 1, zlib.compress(b"\x09abc")), "png.data: the picture is damaged"),
    ],
)  # fmt: skip
def test_a_bad_picture_is_refused(data: str, reason: str) -> None:
    with pytest.raises(Refused) as caught:
        png.decode(data, 1000)
    assert caught.value.reason == reason


def test_a_bomb_is_not_unpacked_beyond_its_own_size() -> None:
    rows = zlib.compress(bytes(50_000_000))
    assert png.decode(picture(1, 1, rows), 1000) == b"\0\0\0"


@given(st.binary(max_size=100), st.integers(0, 200))
def test_a_damaged_picture_is_text_or_a_refusal(damage: bytes, place: int) -> None:
    whole = base64.b64decode(EXAMPLES.png[0].png_base64)
    damaged = whole[:place] + damage + whole[place + len(damage) :]
    try:
        assert len(png.decode(base64.b64encode(damaged).decode(), 1000)) <= 1000
    except Refused as refused:
        assert refused.reason.startswith("png.data: ")


def test_a_client_reads_the_message_inside_and_a_server_takes_no_pictures() -> None:
    op = Publish(topic="/é", msg=RawJson(b'{"data":"\xc3\xa9"}'))
    frame = png.encode(Session().encode(op))
    found = only(Session(direction=Direction.TO_CLIENT).decode(frame.data, False, 0.0), Publish)
    assert found.topic == "/é"
    assert text_of(found.msg).data == b'{"data":"\\u00e9"}'
    refusal = only(Session().decode(frame.data, False, 0.0), Refusal)
    assert refusal.reason == 'operation "png" only goes server to client'
    there = Session(direction=Direction.TO_CLIENT)
    assert only(there.decode(b'{"op":"png","data":"AAAA"}', False, 0.0), Refusal).op == "png"


_TEXTS = {
    "short": b'{"data":"hello"}',
    "many matches": b"[" + b"0,0,0,-1,100,0," * 20_000 + b"0]",
    "some matches": json.dumps([number % 97 / 7 for number in range(60_000)]).encode(),
    "large, no matches": b'"' + base64.b64encode(random.Random(2).randbytes(1_800_000)) + b'"',
    "no matches": b'"' + base64.b64encode(random.Random(1).randbytes(200_000)) + b'"',
}


@pytest.mark.parametrize("fast", [True, False])
@pytest.mark.parametrize("name", list(_TEXTS))
def test_every_way_to_compress_keeps_the_text(name: str, fast: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not fast:
        monkeypatch.setitem(sys.modules, "isal", None)
    png.fast_library.cache_clear()
    try:
        frame = png.encode(Frame(_TEXTS[name]))
    finally:
        png.fast_library.cache_clear()
    data = json.loads(frame.data)["data"]
    with Image.open(io.BytesIO(base64.b64decode(data))) as image:
        assert image.tobytes().rstrip(b"\n") == _TEXTS[name]
    assert png.decode(data, 10_000_000).rstrip(b"\n") == _TEXTS[name]


@pytest.mark.parametrize("profile", [ROS1, ROS2_2024], ids=lambda profile: profile.name)
def test_a_server_takes_pictures_where_the_text_lets_clients_send_them(profile: Profile) -> None:
    op = Publish(topic="/chatter", msg=RawJson(b'{"data":"hello"}'))
    frame = png.encode(Session().encode(op))
    assert list(Session(profile).decode(frame.data, False, 0.0)) == [op]
    large = png.encode(Frame(b'{"op":"publish","topic":"/a","msg":{"data":"', b"a" * 100_000, b'"}}'))
    assert len(large.data) < 2000
    (refusal,) = Session(profile, limits=WireLimits(max_message_size=50_000)).decode(large.data, False, 0.0)
    assert isinstance(refusal, Refusal)
    assert "the limit is 50000" in refusal.reason


@pytest.mark.parametrize(
    "text",
    ["é", "é\\x41", "\\\\xé", "\\é", "€\x7f\x80", "é😀", "é" * 40_000 + "\\" * 40_000 + "x" * 9, '\n"é'],
)
def test_letters_beyond_ascii_are_escaped_as_json_writes_them(text: str) -> None:
    message = {"op": "publish", "x": text}
    frame = png.encode(Frame(json.dumps(message, ensure_ascii=False).encode()))
    inner = png.decode(data_of(frame), LIMIT)
    assert inner.rstrip(b"\n").decode().replace("\x7f", "\\u007f") == json.dumps(message)


def test_what_repeats_becomes_small() -> None:
    text = _TEXTS["many matches"]
    assert len(text) / png.encode(Frame(text)).size > 70


@given(st.sampled_from(["map", "é", "random"]), st.integers(0, 300_000))
@settings(max_examples=20, deadline=None)
def test_in_steps_it_is_the_same_picture(kind: str, size: int) -> None:
    chance = random.Random(size)
    text = {"map": "0,1," * size, "é": "é" * size, "random": chance.randbytes(size).hex()}[kind][:size]
    message = json.dumps({"data": text}, ensure_ascii=False).encode()
    frame = Frame(b'{"op":"publish","topic":"/a","msg":', message, b"}")
    encoder = png.publish_encoder("/a")
    sample: Any = SimpleNamespace(payload=SimpleNamespace(json_parts=lambda: (message,)))
    count = len(list(encoder.steps(sample)))
    made = encoder(sample)
    assert made.data == png.encode(frame).data
    assert count >= frame.size // 40_000
    assert json.loads(png.decode(data_of(made), LIMIT)) == json.loads(frame.data)
