"""Fast path for common small `publish` frames: matches both ends, without a parse.

Nine of ten messages to a server are small ones on known topics, spelled as one of a few libraries does:

    {"op":"publish","id":"publish:/cmd_vel:7","topic":"/cmd_vel","msg":  {...}  ,"latch":false}
    `------------------------------ head ----------------------------' payload  `---- tail ---'

The head is matched from the first byte to the colon after ``"msg"`` and holds each member once; the tail is
one of a few. If the payload, which is unvalidated, is one JSON value, the frame is valid JSON with these
members. Otherwise the frame must be parsed in full; the strict decoder of the message type detects that.
"""

from __future__ import annotations

import re
from typing import Final

QUICK: Final = 4096
"""Maximum bytes of a frame for the fast path; larger frames are dominated by their payload."""

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
    if len(data) > QUICK or not data.isascii():
        return None
    head = _match(data)
    if head is None:
        return None
    if data.endswith(b"}}"):
        return head[1], data[head.end() : -1]
    if data.endswith(_LATCH):
        return head[1], data[head.end() : 1 - len(_LATCH)]
    return (head[1], data[head.end() : 1 - len(_SPACED_LATCH)]) if data.endswith(_SPACED_LATCH) else None
