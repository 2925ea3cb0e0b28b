"""Messages in ROS 1's own form, the body of a TCPROS message without its length prefix (CBR-11):
little-endian, nothing aligned, strings without a closing zero, nothing at all for a message without
fields."""

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

_RULES = WireRules(aligned=False, terminated=False, filler=b"")


def compile_encoder(message: MessageType) -> Callable[[msgspec.Struct], bytes]:
    """A function that encodes a message of that type; the message must be its type's own Struct."""
    write = compile_writer(message, _RULES)

    def encode(value: msgspec.Struct) -> bytes:
        body = bytearray()
        write(body, value)
        return bytes(body)

    return encode


def compile_decoder(message: MessageType) -> Callable[[bytes | memoryview], msgspec.Struct]:
    """A function that decodes a message of that type, or raises InvalidMessage."""
    read = compile_reader(message, _RULES)

    def decode(data: bytes | memoryview) -> msgspec.Struct:
        value, used = read_all(read, memoryview(data))
        if used != len(data):
            raise InvalidMessage("", f"{len(data) - used} bytes too many")
        return value

    return decode
