"""Validation of STUN messages (RFC 8489, RFC 8445) before aioice parses them."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from enum import IntEnum
from struct import Struct
from typing import Final

from rwt_transports.errors import TransportError

MAX_BYTES: Final = 1280
"""Maximum size of a message; one of ICE has about 100 bytes."""
MAX_ATTRIBUTES: Final = 24

_HEADER: Final = Struct("!HHI12s")
_ATTRIBUTE: Final = Struct("!HH")
_COOKIE: Final = 0x2112A442
_BINDING: Final = 0x0001
_METHOD_BITS: Final = 0x3EEF
_CLASS_BITS: Final = 0x0110
_TYPE_BITS: Final = 0xC000

_USERNAME, _INTEGRITY, _ERROR_CODE, _PRIORITY = 0x0006, 0x0008, 0x0009, 0x0024
_ADDRESSES: Final = (8, 20)
_SIZES: Final = {
    0x0001: _ADDRESSES,
    0x0003: (4,),
    0x0004: _ADDRESSES,
    0x0005: _ADDRESSES,
    _INTEGRITY: (20,),
    0x000C: (4,),
    0x000D: (4,),
    0x0012: _ADDRESSES,
    0x0016: _ADDRESSES,
    0x0019: (4,),
    0x0020: _ADDRESSES,
    _PRIORITY: (4,),
    0x0025: (0,),
    0x8028: (4,),
    0x8029: (8,),
    0x802A: (8,),
    0x802B: _ADDRESSES,
    0x802C: _ADDRESSES,
}
"""Possible sizes of the attributes that aioice reads as numbers or addresses."""
_MAX_SIZES: Final = {_USERNAME: 513, _ERROR_CODE: 767, 0x0014: 763, 0x0015: 763, 0x8022: 763}


TURN_METHODS: Final = frozenset({0x0003, 0x0004, 0x0007, 0x0009})
"""Allocate, Refresh, Data and ChannelBind: methods of what a TURN server sends (RFC 8656)."""


class BadStun(TransportError):
    """A datagram that is not a STUN message of ICE or of a TURN server."""


class StunClass(IntEnum):
    """Class of a message."""

    REQUEST = 0x000
    INDICATION = 0x010
    RESPONSE = 0x100
    ERROR = 0x110


@dataclass(frozen=True, slots=True)
class StunHead:
    """Part of a message that decides whether it is parsed.

    Attributes:
        username: USERNAME attribute; empty if there is none.
    """

    kind: StunClass
    transaction: bytes
    username: bytes


def check_stun(data: bytes, methods: Container[int] = (_BINDING,), most_bytes: int = MAX_BYTES) -> StunHead:
    """Check the structure of a message.

    Raises:
        BadStun: it is not one of these messages, or a length is invalid, or a request lacks an attribute that
            ICE requires.
    """
    if not _HEADER.size <= len(data) <= most_bytes:
        raise BadStun(f"a STUN message of {len(data)} bytes")
    kind, length, cookie, transaction = _HEADER.unpack_from(data)
    if cookie != _COOKIE or length != len(data) - _HEADER.size or length % 4:
        raise BadStun("not a STUN message")
    if kind & _TYPE_BITS or kind & _METHOD_BITS not in methods:
        raise BadStun(f"a STUN message of type {kind:#06x}")
    found: dict[int, bytes] = {}
    at, count = _HEADER.size, 0
    while at < len(data):
        count += 1
        attribute, size = _ATTRIBUTE.unpack_from(data, at)
        at += _ATTRIBUTE.size
        if count > MAX_ATTRIBUTES or at + size > len(data) or size > _MAX_SIZES.get(attribute, size):
            raise BadStun(f"a STUN attribute {attribute:#06x} of {size} bytes")
        if attribute in _SIZES and size not in _SIZES[attribute]:
            raise BadStun(f"a STUN attribute {attribute:#06x} of {size} bytes")
        found.setdefault(attribute, data[at : at + size])
        at += size + (-size % 4)
    is_request = StunClass(kind & _CLASS_BITS) is StunClass.REQUEST
    if is_request and not {_USERNAME, _INTEGRITY, _PRIORITY} <= found.keys():
        raise BadStun("a STUN request without credentials or priority")
    if kind & _CLASS_BITS == StunClass.ERROR and len(found.get(_ERROR_CODE, b"")) < 4:
        raise BadStun("a STUN error without a code")
    return StunHead(StunClass(kind & _CLASS_BITS), transaction, found.get(_USERNAME, b""))
