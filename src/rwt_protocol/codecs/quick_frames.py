"""Fast branch of :meth:`rwt_protocol.session.Session.decode` for common small JSON frames.

Nine of ten messages to a server are small calls, responses and messages on topics, with the few members that
client libraries write:

    {"op":"publish","id":"publish:/cmd_vel:7","topic":"/cmd_vel","msg":{...},"latch":false}

One strict parse reads such a frame as a light op. Frames with any other member, member type or byte take the
general path, whose op has the same members for the frames that are read here.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Final

import msgspec

from rwt_protocol.limits import WireLimits
from rwt_protocol.ops.base import MOST_MARK
from rwt_protocol.ops.light import LightCall, LightOp, LightPublish, LightResponse
from rwt_protocol.payloads import RawJson
from rwt_protocol.profiles import Profile

QUICK_BYTES: Final = 16 * 1024
"""Maximum size of a frame for the fast branch; larger frames are dominated by their payload."""

QUICK_OPS: Final = frozenset({"publish", "call_service", "service_response"})

_ANY_NUMBERS_BYTES: Final = 4096
"""Maximum size of a frame that may hold any numbers."""

_MAX_EXPONENTS: Final = 1000
"""Maximum number of exponents in larger frames, as for slow numbers in :mod:`rwt_interfaces`."""

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
        """Return the op of a text frame; None if the frame needs the general path."""
        size = len(data)
        if size > 2 * self._max_depth and not self._is_flat(data, size):
            return None
        if not data.isascii():
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

    def _is_flat(self, data: bytes, size: int) -> bool:
        """True if a frame is small, is not nested too deeply, and does not hold many slow numbers."""
        # The decoder of the message type takes 10 microseconds for a slow number, such as 1e308.
        return (
            size <= QUICK_BYTES
            and data.count(b"{") + data.count(b"[") <= self._max_depth
            and (size <= _ANY_NUMBERS_BYTES or data.count(b"e") + data.count(b"E") <= _MAX_EXPONENTS)
        )


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
