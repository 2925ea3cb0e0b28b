"""Taking a large JSON frame apart without looking at its payload.

A large message is nearly all payload, and the payload is parsed once anyway, when it is decoded as a
message type. So only what stands before and after it is read here:

    {"op":"publish","topic":"/map","msg":  {...}  ,"latch":false}
    `---------------- head --------------' slice  `---- tail ---'

The head is matched from the first byte to the first member that is named like a payload, so it ends just
after a colon, at depth one and outside strings. The tail is matched at the end, and holds only small members
and the last brace. Head + ``0`` + tail is then parsed as the message.

This finds what a full parse would have found, provided that the slice, which has not been parsed yet, is
later decoded strictly as one JSON value in UTF-8:

* If head + ``0`` + tail is valid JSON, then ``0`` is the value of the member that ends the head, because the
  head's own text fixes where that value begins. Putting one valid value in the place of another gives valid
  JSON again. So if the slice is one valid value, the frame is valid JSON, and its members are those of
  head + ``0`` + tail with that one member replaced; the payload's name is required to occur once, so that it
  is not replaced by a later member of the same name.
* If the slice is not one valid value, strict decoding refuses it. Then either the frame is not valid JSON, or
  the cut was wrong: a deeply nested member after the payload, a second message in the frame, or the token
  ``NaN``. `RawJson.validated` parses the whole frame and tells these apart.

No step depends on the tail being found at the right place; a wrong place costs a second parse, never a wrong
answer. UTF-8 is checked for the head and the tail here, and for the slice by its decoder.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Final

import msgspec

from rwt_protocol.codecs.base import DecodeFailure, Members
from rwt_protocol.codecs.envelope import DECODER, PAYLOADS
from rwt_protocol.codecs.full_split import split_whole
from rwt_protocol.errors import MalformedPayload
from rwt_protocol.payloads import RawJson

LARGE: Final = 32 * 1024
"""Frames of more bytes than this are taken apart here first."""

_TAIL_SIZE: Final = 512

_STRING: Final = rb'"(?:[^"\\]|\\.)*+"'
_INSIDE: Final = rb'[^"\\{}\[\]]|' + _STRING
_FLAT: Final = rb"(?:\{(?:" + _INSIDE + rb")*+\}|\[(?:" + _INSIDE + rb")*+\])"
_NESTED: Final = rb"(?:[{\[](?:" + _INSIDE + rb"|" + _FLAT + rb")*+[}\]])"
_VALUE: Final = rb"(?:" + _STRING + rb"|[-+.0-9A-Za-z]++|" + _NESTED + rb")"
_KEY: Final = rb'"[^"\\]*+"[ \t\r\n]*+:[ \t\r\n]*+'
# Each turn of the outer loops is atomic: Python before 3.11.5 does not go back from one that fails halfway.
_HEAD: Final = re.compile(
    rb'[ \t\r\n]*+\{[ \t\r\n]*+(?>(?!"(?:msg|args|values)")' + _KEY + _VALUE + rb"[ \t\r\n]*+,[ \t\r\n]*+)*+"
    rb'("(?:msg|args|values)")[ \t\r\n]*+:[ \t\r\n]*+(?=[{\[])',
    re.DOTALL,
)
_TAIL: Final = re.compile(
    rb"[ \t\r\n]*+(?>,[ \t\r\n]*+" + _KEY + _VALUE + rb"[ \t\r\n]*+)*+\}[ \t\r\n]*+\Z", re.DOTALL
)


_LEADING: Final = re.compile(
    rb"[ \t\r\n]*+\{[ \t\r\n]*+((?>" + _KEY + _VALUE + rb"[ \t\r\n]*+,[ \t\r\n]*+)*+)", re.DOTALL
)


def head_members(head: bytes) -> Members:
    """The members that a message begins with and that are whole, of one whose rest is not there."""
    leading = _LEADING.match(head)
    if leading is None:
        return {}
    return _read_envelope(b"{" + leading[1].rstrip(b" \t\r\n,") + b"}") or {}


def split_large(data: bytes, max_depth: int, dense: str = "") -> Members | None:
    """The members of the message in a large frame, its payload not validated; None if they cannot be found.

    The nesting of the payload is not looked at either: the type that it is decoded as bounds it.

    Args:
        data: the frame.
        max_depth: of the message, once it is looked at.
        dense: why its payload may not be decoded as plain values, if it may not.
    """
    head = _HEAD.match(data, 0, 2 * LARGE)
    if head is None:
        return None
    begin = head.end()
    tail = _TAIL.search(data, max(begin + 2, len(data) - _TAIL_SIZE))
    if tail is None:
        return None
    end = tail.start()
    quoted = head[1]
    envelope = data[:begin] + b"0" + data[end:]
    members = _read_envelope(envelope)
    if members is None or envelope.count(quoted) != 1:
        return None
    name = quoted[1:-1].decode()
    op = members.get("op")
    if not isinstance(op, str) or name not in PAYLOADS.get(op, ()):
        return None
    validate = partial(_refuse, dense) if dense else partial(_validate, data, name, envelope, max_depth)
    members[name] = RawJson(memoryview(data)[begin:end], validate, dense)
    return members


def _read_envelope(envelope: bytes) -> Members | None:
    if len(envelope) > LARGE:
        return None
    try:
        if not envelope.isascii():
            str(envelope, "utf-8")
        return DECODER.decode(envelope)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


def _refuse(reason: str) -> bytes:
    """Stands where the payload would be decoded.

    Raises:
        MalformedPayload: always.
    """
    raise MalformedPayload(reason)


def _validate(data: bytes, name: str, envelope: bytes, max_depth: int) -> bytes:
    """The payload that a parse of the whole frame finds.

    Raises:
        MalformedPayload: the frame is not one message, or not the one that its ends showed.
    """
    found = split_whole(data, max_depth)
    if len(found) != 1:
        raise MalformedPayload(f"a message of more than {LARGE} bytes must be alone in its frame")
    members = found[0]
    if isinstance(members, DecodeFailure):
        raise MalformedPayload(members.reason)
    raw = members[name]
    rest = {key: bytes(v) if isinstance(v, msgspec.Raw) else v for key, v in members.items() if key != name}
    seen = _read_envelope(envelope) or {}
    shown = {key: bytes(v) if isinstance(v, msgspec.Raw) else v for key, v in seen.items() if key != name}
    if rest != shown or not isinstance(raw, msgspec.Raw):
        raise MalformedPayload(f'in a message of more than {LARGE} bytes "{name}" must be the last member')
    return bytes(raw)
