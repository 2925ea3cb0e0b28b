"""Messages in CDR, as ROS 2 puts them on its wire: XCDR version 1, little-endian, with the encapsulation
header ``00 01 00 00`` (CBR-11). Alignment counts from after the header; a message without fields is one zero
byte."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.serialise.pack import compile_writer
from rwt_interfaces.serialise.unpack import compile_reader, read_all
from rwt_interfaces.serialise.wire_rules import WireRules

if TYPE_CHECKING:
    import msgspec

    from rwt_interfaces.structs import MessageType

_RULES = WireRules(aligned=True, terminated=True, filler=b"\0")
_HEADER = b"\0\1\0\0"


def compile_encoder(message: MessageType) -> Callable[[msgspec.Struct], bytes]:
    """A function that encodes a message of that type; the message must be its type's own Struct."""
    write = compile_writer(message, _RULES)

    def encode(value: msgspec.Struct) -> bytes:
        body = bytearray()
        write(body, value)
        return b"".join((_HEADER, body))

    return encode


def compile_decoder(message: MessageType) -> Callable[[bytes | memoryview], msgspec.Struct]:
    """A function that decodes a message of that type, or raises InvalidMessage."""
    read = compile_reader(message, _RULES)

    def decode(data: bytes | memoryview) -> msgspec.Struct:
        view = memoryview(data)
        if len(view) < 4:
            raise InvalidMessage("", "data cut short")
        if bytes(view[:2]) != _HEADER[:2]:
            got = view[:2].hex(" ")
            raise InvalidMessage("", f"expected little-endian CDR (00 01), got encapsulation {got}")
        body = view[4:]
        value, used = read_all(read, body)
        rest = bytes(body[used:])
        # Some middleware pads the whole to a multiple of four.
        if rest and (len(rest) > 3 or len(body) % 4 or any(rest)):
            raise InvalidMessage("", f"{len(rest)} bytes too many")
        return value

    return decode
