"""Messages in the packed forms that robots put on their wires: CDR in ROS 2, and ROS 1's own (CBR-11)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.serialise.long_lists import Chunks
from rwt_interfaces.serialise.long_strings import Parts
from rwt_interfaces.serialise.pack import compile_steps, compile_writer
from rwt_interfaces.serialise.unpack import compile_reader, read_all
from rwt_interfaces.serialise.wire_rules import WireRules
from rwt_interfaces.steps import Steps

if TYPE_CHECKING:
    import msgspec

    from rwt_interfaces.structs import MessageType

CDR: Final = WireRules(header=b"\0\1\0\0", aligned=True, terminated=True, filler=b"\0")
"""XCDR version 1 with its encapsulation header. Alignment counts from after the header."""

ROS1: Final = WireRules(header=b"", aligned=False, terminated=False, filler=b"")
"""The body of a TCPROS message, without its length prefix."""


def compile_encoder(message: MessageType, rules: WireRules) -> Callable[[msgspec.Struct], bytes]:
    """A function that encodes a message of that type; it takes its own Struct and `JsonCodec.sendable`."""
    write = compile_writer(message, rules)
    header = rules.header

    def encode(value: msgspec.Struct) -> bytes:
        body = bytearray()
        write(body, value)
        return b"".join((header, body))

    return encode


def compile_step_encoder(
    message: MessageType, rules: WireRules
) -> Callable[[msgspec.Struct, Chunks], Steps[Parts]]:
    """A function that encodes a message of that type in steps."""
    write = compile_steps(message, rules)
    header = rules.header

    def encode(value: msgspec.Struct, apart: Chunks) -> Steps[Parts]:
        body = bytearray()
        yield from write(body, value, apart)
        return header, memoryview(body)

    return encode


def compile_decoder(message: MessageType, rules: WireRules) -> Callable[[bytes | memoryview], msgspec.Struct]:
    """A function that decodes a message of that type, or raises InvalidMessage."""
    read = compile_reader(message, rules)
    header = rules.header

    def decode(data: bytes | memoryview) -> msgspec.Struct:
        body = memoryview(data)
        if header:
            body = _without_header(body, header)
        value, used = read_all(read, body)
        rest = len(body) - used
        # Some middleware pads CDR to a multiple of four.
        if rest and not (header and rest < 4 and len(body) % 4 == 0 and not any(bytes(body[used:]))):
            raise InvalidMessage("", f"{rest} bytes too many")
        return value

    return decode


def _without_header(data: memoryview, header: bytes) -> memoryview:
    """What follows the encapsulation header, of which the last two bytes are options."""
    if len(data) < len(header):
        raise InvalidMessage("", "data cut short")
    if bytes(data[:2]) != header[:2]:
        got = data[:2].hex(" ")
        raise InvalidMessage("", f"expected little-endian CDR (00 01), got encapsulation {got}")
    return data[len(header) :]
