"""Fast branch of :meth:`rwt_protocol.session.Session.decode` for common small JSON frames.

Nine of ten messages to a server are small calls, responses and messages on topics, with the few members that
client libraries write. One strict parse reads such a frame as a light op. A `publish` of more than
`PARSED_BYTES` is only matched at both ends, because its message is parsed anyway, when it is checked against
its type:

    {"op":"publish","id":"publish:/cmd_vel:7","topic":"/cmd_vel","msg":  {...}  ,"latch":false}
    `------------------------------ head ----------------------------' payload  `---- tail ---'

The head holds each member once, the tail is one of a few. So if the payload is one JSON value, the frame is
one message with these members. Otherwise the strict decoder of the type rejects the payload, and
:attr:`RawJson.validate` raises :class:`Misread`: the frame is read again, on the general path.

Frames with any other member, member type or byte take the general path, whose op has the same members for the
frames that are read here.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from functools import partial
from typing import Annotated, Final

import msgspec

from rwt_protocol.errors import Misread
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops.base import MOST_MARK
from rwt_protocol.ops.light import LightCall, LightOp, LightPublish, LightResponse
from rwt_protocol.payloads import RawJson
from rwt_protocol.profiles import Profile

QUICK_BYTES: Final = 16 * 1024
"""Maximum size of a frame for the fast branch; larger frames are dominated by their payload."""

PARSED_BYTES: Final = 512
"""Maximum size of a frame that is parsed, since that takes no longer than a match of its ends."""

_MIN_DEPTH: Final = 32
"""Minimum limit of nesting at which the nesting of messages is left to their types, which have less."""

QUICK_OPS: Final = frozenset({"publish", "call_service", "service_response"})

_ANY_NUMBERS_BYTES: Final = 4096
"""Maximum size of a frame that may hold any numbers."""

_MAX_EXPONENTS: Final = 1000
"""Maximum number of exponents in larger frames, as for slow numbers in :mod:`rwt_interfaces`."""

_STRING: Final = rb'"([ !#-\[\]-~]%b)"'
"""ASCII string without escapes."""

_HEAD: Final = re.compile(
    rb'\{"op": ?"publish", ?(?:"id": ?%b, ?)?"topic": ?%b, ?(?:"type": ?%b, ?)?"msg": ?(?=\{)'
    % (_STRING % (b"{0,%d}+" % MOST_MARK), _STRING % b"*+", _STRING % b"*+")
)
_match: Final = _HEAD.match

_LATCH: Final = b'},"latch":false}'
_SPACED_LATCH: Final = b'}, "latch": false}'

_Mark = Annotated[str, msgspec.Meta(max_length=MOST_MARK)]


class _Publish(msgspec.Struct, tag_field="op", tag="publish", forbid_unknown_fields=True, gc=False):
    topic: str
    msg: msgspec.Raw
    id: _Mark | None = None
    type: str | None = None
    latch: bool = False


class _Call(msgspec.Struct, tag_field="op", tag="call_service", forbid_unknown_fields=True, gc=False):
    service: str
    args: msgspec.Raw
    id: _Mark | None = None
    type: str | None = None


class _Response(msgspec.Struct, tag_field="op", tag="service_response", forbid_unknown_fields=True, gc=False):
    service: str
    values: msgspec.Raw
    id: _Mark | None = None
    result: bool = True


_decode: Final = msgspec.json.Decoder(_Publish | _Call | _Response).decode
_decode_value: Final = msgspec.json.Decoder(msgspec.Raw).decode


class QuickReader:
    """Reader of the frames that one session reads on the fast branch.

    Args:
        max_depth: as in :class:`~rwt_protocol.limits.WireLimits`.
        ignores_type: ops whose member `type` the profile ignores.
    """

    __slots__ = ("_ignores_type", "_max_depth")

    def __init__(self, max_depth: int, ignores_type: frozenset[str]) -> None:
        self._max_depth = max_depth
        self._ignores_type = ignores_type

    def read(self, data: bytes) -> LightOp | None:
        """Return the op of a text frame; None if the frame needs the general path.

        The message of a publish may be unvalidated.
        """
        size = len(data)
        if not data.isascii():
            return None
        if size > PARSED_BYTES:
            if size > QUICK_BYTES or (size > _ANY_NUMBERS_BYTES and _has_exponents(data)):
                return None
            head = _match(data) if self._max_depth >= _MIN_DEPTH else None
            publish = None if head is None else self._split_publish(data, head)
            if publish is not None:
                return publish
        if size > 2 * self._max_depth and _brackets(data) > self._max_depth:
            return None
        try:
            found = _decode(data)
        except (msgspec.DecodeError, RecursionError):
            return None
        # Payloads are copied, so that they do not keep the frame alive. Other payloads than objects are
        # converted on the general path.
        if type(found) is _Publish:
            kind = None if "publish" in self._ignores_type else found.type
            return LightPublish(found.topic, RawJson(bytes(found.msg)), found.id, kind, found.latch)
        if type(found) is _Call:
            args = bytes(found.args)
            if args[:1] != b"{":
                return None
            kind = None if "call_service" in self._ignores_type else found.type
            return LightCall(found.service, RawJson(args), found.id, kind)
        values = bytes(found.values)
        return (
            LightResponse(found.service, RawJson(values), found.id, found.result)
            if values[:1] == b"{"
            else None
        )

    def _split_publish(self, data: bytes, head: re.Match[bytes]) -> LightPublish | None:
        """Return a publish whose message is not validated; None if its tail is another."""
        begin = head.end()
        if data.endswith(b"}}"):
            payload = data[begin:-1]
        elif data.endswith(_LATCH):
            payload = data[begin : 1 - len(_LATCH)]
        elif data.endswith(_SPACED_LATCH):
            payload = data[begin : 1 - len(_SPACED_LATCH)]
        else:
            return None
        id_, topic, kind = head.groups()
        return LightPublish(
            topic.decode(),
            RawJson(payload, partial(_validate, data, payload, self._max_depth)),
            None if id_ is None else id_.decode(),
            None if kind is None or "publish" in self._ignores_type else kind.decode(),
            latch=False,
        )


def _validate(frame: bytes, payload: bytes, max_depth: int) -> bytes:
    """Return a payload that is one JSON value; raises Misread if it is not, or is nested too deeply."""
    if len(frame) > 2 * max_depth and _brackets(frame) > max_depth:
        raise Misread(frame)
    try:
        return bytes(_decode_value(payload))
    except (msgspec.DecodeError, RecursionError):
        raise Misread(frame) from None


def _brackets(data: bytes) -> int:
    return data.count(b"{") + data.count(b"[")


def _has_exponents(data: bytes) -> bool:
    """True if a frame may hold many slow numbers."""
    # The decoder of the message type takes 10 microseconds for a slow number, such as 1e308.
    return data.count(b"e") + data.count(b"E") > _MAX_EXPONENTS


def quick_reader(profile: Profile, limits: WireLimits, arriving: Collection[object]) -> QuickReader | None:
    """Return the reader of a JSON session; None if the session cannot use it.

    Args:
        arriving: names of the ops that arrive.
    """
    if limits.max_message_size < QUICK_BYTES or not set(arriving) >= QUICK_OPS:
        return None
    return QuickReader(
        limits.max_depth, frozenset(op for op in QUICK_OPS if "type" in profile.without.get(op, ()))
    )
