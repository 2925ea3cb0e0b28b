"""Taking the usual small `publish` apart by its ends, without a parse.

Nine of ten messages that a server takes are small ones on topics that it knows, spelt as one of a few
libraries spells them:

    {"op":"publish","id":"publish:/cmd_vel:7","topic":"/cmd_vel","msg":  {...}  ,"latch":false}
    `------------------------------ head ----------------------------' payload  `---- tail ---'

The head is matched from the first byte to the colon behind ``"msg"``, and has each of its members once; the
tail is one of few. So if the payload, which nobody has looked at yet, is one JSON value, the frame is valid
JSON and these are its members. If it is not, the frame may be anything, and has to be read as any other: who
decodes the payload strictly as a message type finds that out.
"""

from __future__ import annotations

import re
from typing import Final

QUICK: Final = 4096
"""Frames of more bytes than this are not taken apart here: their payload is what they cost."""

_TEXT: Final = rb'"[ !#-\[\]-~]*+"'
"""A string of ASCII without escapes."""

_HEAD: Final = re.compile(
    rb'\{"op": ?"publish", ?(?:"id": ?' + _TEXT + rb", ?)?"
    rb'"topic": ?"([ !#-\[\]-~]*+)", ?(?:"type": ?' + _TEXT + rb', ?)?"msg": ?(?=\{)'
)
_match: Final = _HEAD.match

PUBLISH_STARTS: Final = (b'{"op":"publish"', b'{"op": "publish"')
"""First bytes of every frame that :func:`split_publish` takes apart."""

_LATCH: Final = b'},"latch":false}'
_SPACED_LATCH: Final = b'}, "latch": false}'


def split_publish(data: bytes) -> tuple[bytes, bytes] | None:
    """The topic and the payload of a text frame; None if it is not spelt in a way that is known here.

    Nothing is known of the payload, but that the whole frame is ASCII: only if it is one JSON value is the
    frame the message that its ends show.
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
