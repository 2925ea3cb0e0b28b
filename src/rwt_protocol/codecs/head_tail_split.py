"""Parser for large JSON frames that does not look at the payload.

A large message is nearly all payload, which is parsed once anyway when it is decoded as a message type. So
this module reads only the text before and after it:

    {"op":"publish","topic":"/map","msg":  {...}  ,"latch":false}
    `---------------- head --------------' slice  `---- tail ---'

The head is matched from the first byte to the first member named like a payload. It ends after a colon, at
depth one and outside strings. The tail is matched at the end and holds only small members and the last brace.
Head + ``0`` + tail is then parsed as the message.

The result equals that of a full parse, provided that the slice is later decoded strictly as one JSON value in
UTF-8:

* If head + ``0`` + tail is valid JSON, ``0`` is the value of the head's last member, because the head fixes
  where that value begins. Replacing one valid value by another keeps JSON valid. So if the slice is one valid
  value, the frame is valid, and only that member differs. The payload's name must occur once, so that no
  later member of that name replaces it.
* If the slice is not one valid value, strict decoding rejects it. Then the frame is not valid JSON, or the
  cut was wrong: a deeply nested member after the payload, a second message, or the token ``NaN``.
  `RawJson.validated` parses the whole frame and tells these apart.

A wrongly placed tail costs a second parse, never a wrong result. UTF-8 is checked here for head and tail, and
for the slice by its decoder.
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
"""Minimum bytes of a frame for this parser."""

_TAIL_SIZE: Final = 512

_STRING: Final = rb'"(?:[^"\\]|\\.)*+"'
_INSIDE: Final = rb'[^"\\{}\[\]]|' + _STRING
_FLAT: Final = rb"(?:\{(?:" + _INSIDE + rb")*+\}|\[(?:" + _INSIDE + rb")*+\])"
_NESTED: Final = rb"(?:[{\[](?:" + _INSIDE + rb"|" + _FLAT + rb")*+[}\]])"
_VALUE: Final = rb"(?:" + _STRING + rb"|[-+.0-9A-Za-z]++|" + _NESTED + rb")"
_KEY: Final = rb'"[^"\\]*+"[ \t\r\n]*+:[ \t\r\n]*+'
# Loops are atomic: Python before 3.11.5 does not backtrack into one that fails halfway.
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
    """Return the complete members at the start of a truncated message."""
    leading = _LEADING.match(head)
    if leading is None:
        return {}
    return _read_envelope(b"{" + leading[1].rstrip(b" \t\r\n,") + b"}") or {}


def split_large(data: bytes, max_depth: int, dense: str = "") -> Members | None:
    """Return the message of a large frame with an unvalidated payload; None if its members cannot be found.

    The payload's nesting is not checked either: its message type bounds it.

    Args:
        max_depth: maximum depth of the message, checked when it is validated.
        dense: reason why the payload must not be decoded as plain values; empty if it may be.
    """
    head = _HEAD.match(data, 0, 2 * LARGE)
    if head is None:
        return None
    begin = head.end()
    # At least two bytes of payload, `{}`, so that head and tail cannot overlap.
    tail = _TAIL.search(data, max(begin + 2, len(data) - _TAIL_SIZE))
    if tail is None:
        return None
    end = tail.start()
    quoted = head[1]
    envelope = data[:begin] + b"0" + data[end:]
    members = _read_envelope(envelope)
    # A second member of that name would replace the payload, because the last of equal keys wins.
    if members is None or envelope.count(quoted) != 1:
        return None
    name = quoted[1:-1].decode()
    op = members.get("op")
    # In other ops the member is no payload, so the slice would never be checked.
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
    """Raise MalformedPayload in place of decoding the payload."""
    raise MalformedPayload(reason)


def _validate(data: bytes, name: str, envelope: bytes, max_depth: int) -> bytes:
    """Return the payload of a fully parsed frame; raises MalformedPayload if its ends differ."""
    found = split_whole(data, max_depth)
    if len(found) != 1:
        raise MalformedPayload(f"a message of more than {LARGE} bytes must be alone in its frame")
    members = found[0]
    if isinstance(members, DecodeFailure):
        raise MalformedPayload(members.reason)
    raw = members[name]
    rest = {key: bytes(v) if isinstance(v, msgspec.Raw) else v for key, v in members.items() if key != name}
    # The session has acted on these members already, so the full parse must find the same ones.
    seen = _read_envelope(envelope) or {}
    shown = {key: bytes(v) if isinstance(v, msgspec.Raw) else v for key, v in seen.items() if key != name}
    if rest != shown or not isinstance(raw, msgspec.Raw):
        raise MalformedPayload(f'in a message of more than {LARGE} bytes "{name}" must be the last member')
    return bytes(raw)
