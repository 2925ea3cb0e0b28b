"""Fast paths for common small frames.

Frames of `publish` are matched at both ends, without a parse.

Nine of ten messages to a server are small ones on known topics, spelled as one of a few libraries does:

    {"op":"publish","id":"publish:/cmd_vel:7","topic":"/cmd_vel","msg":  {...}  ,"latch":false}
    `------------------------------ head ----------------------------' payload  `---- tail ---'

The head is matched from the first byte to the colon after ``"msg"`` and holds each member once; the tail is
one of a few. If the payload, which is unvalidated, is one JSON value, the frame is valid JSON with these
members. Otherwise the frame must be parsed in full; the strict decoder of the message type detects that.

Frames of `call_service` and `service_response` take one strict parse. Those with other members that have an
effect, or with members of other types, take the general path.
"""

from __future__ import annotations

import re
from typing import Final

import msgspec

QUICK: Final = 16 * 1024
"""Maximum bytes of a frame for the fast path; larger frames are dominated by their payload."""

_ANY_NUMBERS: Final = 4096
"""Bytes of a frame that may hold any numbers."""

_MAX_EXPONENTS: Final = 1000
"""Maximum number of exponents in larger frames, as for slow numbers in :mod:`rwt_interfaces`."""

_TEXT: Final = rb'"[ !#-\[\]-~]*+"'
"""ASCII string without escapes."""

_HEAD: Final = re.compile(
    rb'\{"op": ?"publish", ?(?:"id": ?' + _TEXT + rb", ?)?"
    rb'"topic": ?"([ !#-\[\]-~]*+)", ?(?:"type": ?' + _TEXT + rb', ?)?"msg": ?(?=\{)'
)
_match: Final = _HEAD.match

PUBLISH_STARTS: Final = (b'{"op":"publish"', b'{"op": "publish"')
"""First bytes of all frames that :func:`split_publish` accepts."""

_LATCH: Final = b'},"latch":false}'
_SPACED_LATCH: Final = b'}, "latch": false}'


def split_publish(data: bytes) -> tuple[bytes, bytes] | None:
    """Return the topic and payload of a text frame; None if it is not in a known form.

    The frame is ASCII, but the payload is unvalidated: the result holds only if it is one JSON value.
    """
    # The decoder of the message type takes 10 microseconds for a slow number, such as 1e308.
    if len(data) > _ANY_NUMBERS and (
        len(data) > QUICK or data.count(b"e") + data.count(b"E") > _MAX_EXPONENTS
    ):
        return None
    head = _match(data) if data.isascii() else None
    if head is None:
        return None
    if data.endswith(b"}}"):
        return head[1], data[head.end() : -1]
    if data.endswith(_LATCH):
        return head[1], data[head.end() : 1 - len(_LATCH)]
    return (head[1], data[head.end() : 1 - len(_SPACED_LATCH)]) if data.endswith(_SPACED_LATCH) else None


class UsualCall(msgspec.Struct, tag_field="op", tag="call_service", forbid_unknown_fields=True, frozen=True):
    """Call without a timeout or other options; `type` is ignored, since the service has one (SRV-03)."""

    service: str
    id: str | None = None
    args: msgspec.Raw = msgspec.Raw(b"{}")
    type: str | None = None


class UsualResponse(
    msgspec.Struct, tag_field="op", tag="service_response", forbid_unknown_fields=True, frozen=True
):
    """Response of a service that succeeded."""

    service: str
    id: str
    values: msgspec.Raw
    result: bool = True


_CALL_STARTS: Final = tuple(
    b'{"op":%b"%b"' % (space, op) for op in (b"call_service", b"service_response") for space in (b"", b" ")
)
_decode_call: Final = msgspec.json.Decoder(UsualCall | UsualResponse).decode


def split_call(data: bytes) -> UsualCall | UsualResponse | None:
    """Return a text frame as a call or response; None if it is not in a known form.

    Only the brackets of the payload are checked; its strings are validated when it is decoded as a type.
    """
    # ASCII needs no check of UTF-8, and a small frame none for slow numbers.
    if not data.startswith(_CALL_STARTS) or len(data) > _ANY_NUMBERS or not data.isascii():
        return None
    try:
        found = _decode_call(data)
    except (msgspec.DecodeError, RecursionError):
        return None
    # Arguments by position and failures as strings take the general path.
    if type(found) is UsualCall:
        return found if bytes(found.args)[:1] == b"{" else None
    return found if found.result and bytes(found.values)[:1] == b"{" else None
