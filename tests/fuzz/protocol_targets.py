"""Frames from a peer: the session, its pictures and its fragments, and the bridge behind it."""

from __future__ import annotations

import binascii
import json
import logging
import struct
import zlib

import bson as library
import pytest
from bson.errors import BSONError

from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph import MemoryGraph, Node
from rwt_graph.clock import SimulatedClock
from rwt_interfaces.registry import Registry
from rwt_interfaces.steps import finished
from rwt_protocol.codecs import JSON, png
from rwt_protocol.codecs.base import TooMuchStructure
from rwt_protocol.codecs.bson import BsonCodec
from rwt_protocol.codecs.bson_decoder import check_structure
from rwt_protocol.codecs.full_split import MOST_MESSAGES
from rwt_protocol.errors import Misread, Refused
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Direction, Op
from rwt_protocol.ops.light import LIGHT, LightPublish
from rwt_protocol.profiles import PROFILES
from rwt_protocol.session import Refusal, Session
from tests.core.rosbridge.recording_client import Client

_PROFILES = list(PROFILES.values())
_DIRECTIONS = [Direction.TO_SERVER, Direction.TO_CLIENT]
LIMITS = WireLimits(
    100_000, max_depth=70, fragmented_messages=4, fragment_characters=20_000, fragment_seconds=10.0
)
LONGEST_REASON = 2_000

NOT_ALLOWED = set(range(0x0B, 0x10))
"""Kinds of elements of BSON that are refused in large documents."""

_LIGHT_STARTS = (b'{"op":"publish"', b'{"op":"call_service"', b'{"op":"service_response"')

PICTURE_BYTES = 50_000


def session(data: bytes) -> None:
    """Frames into one session: the first byte chooses the profile and the direction, bit 7 of each frame's
    first byte says binary, and 0x1e ends a frame."""
    profile, direction = _PROFILES[data[0] % len(_PROFILES)], _DIRECTIONS[data[0] >> 7]
    _frames(Session(profile, direction, LIMITS), Session(profile, direction, LIMITS, light=True), data)


def bson(data: bytes) -> None:
    """The same for a peer that speaks nothing but BSON; the length that begins a document is put right, so
    that what follows it is looked at."""
    documents = [(len(each) + 5).to_bytes(4, "little") + each + b"\0" for each in data[1:].split(b"\x1e")]
    raw = data[0] & 0x40
    chosen = Session(_PROFILES[data[0] % len(_PROFILES)], _DIRECTIONS[data[0] >> 7], LIMITS, BsonCodec())
    for now, each in enumerate(data[1:].split(b"\x1e") if raw else documents):
        _check_document(each)
        for item in chosen.decode(each, True, float(now)):
            _check_item(item)


def _check_document(data: bytes) -> None:
    """Check that the library rejects every document that the check of large ones rejects."""
    try:
        finished(check_structure(data, LIMITS))
    except (ValueError, struct.error, IndexError):
        if not set(data) & NOT_ALLOWED:
            with pytest.raises(BSONError):
                library.decode(data)
    except TooMuchStructure:
        return


def _frames(chosen: Session, light: Session, data: bytes) -> None:
    for now, each in enumerate(data[1:].split(b"\x1e")):
        binary = bool(each) and each[0] >= 0xA0
        _check_light(light, chosen, each)
        found = chosen.decode(each, binary, float(now))
        assert len(found) <= (MOST_MESSAGES + 1) * (4 if binary else 1), "more ops than a frame can hold"
        for item in found:
            _check_item(item)


def _check_light(light: Session, chosen: Session, data: bytes) -> None:
    """Check that a light op has the members that the session without light ops reads."""
    if not data.startswith(_LIGHT_STARTS):
        return
    found = light.decode(data, False, 0.0)
    if len(found) == 1 and isinstance(found[0], tuple(LIGHT.values())):
        op, expected = found[0], chosen.decode(data, False, 0.0)
        try:
            if isinstance(op, LightPublish):
                op.msg.json()
        except Misread as misread:
            assert light.decode_again(misread, 0.0) == expected
            return
        (full,) = expected
        assert isinstance(full, Op)
        for name in type(full).model_fields:
            assert getattr(op, name) == getattr(full, name)


def _check_item(item: Op | Refusal) -> None:
    if isinstance(item, Refusal):
        assert 0 < len(item.reason) < LONGEST_REASON
    answer = item.answer if isinstance(item, Refusal) else item
    if answer is not None:
        assert isinstance(json.loads(JSON.encode(answer).data), dict)


def picture(data: bytes) -> None:
    """A `png` message; the first byte says what of it follows: its `data` as it stands, the picture in it, or
    only the rows, for which a picture is made."""
    kind, rest = data[:1], data[1:]
    if kind == b"r":
        written = binascii.b2a_base64(_picture(rest), newline=False).decode()
    elif kind == b"p":
        written = binascii.b2a_base64(rest, newline=False).decode()
    else:
        written = rest.decode("latin-1")
    try:
        text = png.decode(written, PICTURE_BYTES)
    except Refused:
        return
    assert len(text) <= PICTURE_BYTES


def _picture(data: bytes) -> bytes:
    """Width, height and colour type are the first bytes."""
    width, height, colours = (*data[:3], 1, 1, 2)[:3]
    header = struct.pack(">IIBBBBB", width, height, 8, colours, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(data[3:], 1)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in chunks
    )


class _NoInternalErrors(logging.Handler):
    """Fails on what the server logs as its own fault."""

    def emit(self, record: logging.LogRecord) -> None:
        assert record.levelno < logging.ERROR, record.getMessage()


_watch = _NoInternalErrors(logging.ERROR)
_registry = Registry()


def no_internal_errors(logger: logging.Logger) -> None:
    """Fail from now on for what is logged as the server's own fault."""
    if _watch not in logger.handlers:
        logger.addHandler(_watch)
        logger.propagate = False
        logger.setLevel(logging.ERROR)


def bridge(data: bytes) -> None:
    """Frames from two clients of one bridge, with another client's topic, service and action to hit; 0x1e
    ends a frame, and 0x1f too and changes the client."""
    no_internal_errors(logging.getLogger("rwt.bridge"))
    clock = SimulatedClock(start_ns=1_700_000_000_000_000_000)
    graph = MemoryGraph(registry=_registry, clock=clock)
    made = Bridge(graph, Settings(max_message_size=100_000))
    clients = [Client(made), Client(made)]
    with Node(graph, "robot") as node:
        node.advertise_service("/add", "example_interfaces/AddTwoInts", lambda request: {"sum": request.a})
        node.advertise("/t", "std_msgs/String", latch=True).publish({"data": "latched"})
        _play(clients, clock, data)
    for client in clients:
        client.leave()
    assert made.client_count == 0
    made.close()


def _play(clients: list[Client], clock: SimulatedClock, data: bytes) -> None:
    for turn, part in enumerate(data.split(b"\x1f")):
        for each in part.split(b"\x1e"):
            clients[turn % 2].say_raw(each, binary=bool(each) and each[0] >= 0xA0)
            clock.advance(0.01)
    for client in clients:
        for frame, _ in client.frames:
            assert frame.binary or isinstance(json.loads(frame.data), dict)
