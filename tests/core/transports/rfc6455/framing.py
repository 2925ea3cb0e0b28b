"""Framing, reserved bits, opcodes and masks (RFC 6455 sections 5.1 to 5.3 and 5.6)."""

from __future__ import annotations

import struct

from tests.core.transports.rfc6455.case import Case, Chapter, echo
from tests.core.transports.rfc6455.frames import (
    BINARY,
    CONTINUATION,
    FIN,
    KEY,
    PING,
    PONG,
    TEXT,
    close,
    fragments,
    frame,
    text,
)

SIZES = (0, 1, 124, 125, 126, 127, 128, 65534, 65535, 65536, 65537, 262_144, 262_145)


def _pattern(size: int) -> bytes:
    return (b"*#robot-" * (size // 8 + 1))[:size]


def _lengths() -> tuple[Case, ...]:
    cases = [
        Case(
            f"{'text' if opcode == TEXT else 'binary'} of {size} bytes",
            frame(opcode, _pattern(size)),
            (echo(_pattern(size), opcode),),
        )
        for opcode in (TEXT, BINARY)
        for size in SIZES
    ]
    cases.append(Case("every byte value in binary", frame(BINARY, bytes(range(256))),
                      (echo(bytes(range(256)), BINARY),)))  # fmt: skip
    cases.append(Case("the masked example of section 5.7", bytes.fromhex("818537fa213d7f9f4d5158"),
                      (echo("Hello"),)))  # fmt: skip
    return tuple(cases)


def _wrong_lengths() -> tuple[Case, ...]:
    longer = [(16, size) for size in (0, 1, 125)] + [(64, size) for size in (0, 1, 125, 126, 65535)]
    cases = [
        Case(f"{size} bytes announced in {form} bits", text("a") + frame(TEXT, b"x" * size, form=form),
             (echo("a"),), fails=1002)
        for form, size in longer
    ]  # fmt: skip
    cases += [
        Case(f"a ping of {size} bytes announced in {form} bits", frame(PING, b"x" * size, form=form),
             fails=1002)
        for form, size in ((16, 0), (16, 125), (64, 0), (64, 125))
    ]  # fmt: skip
    for size in (1 << 63, (1 << 64) - 1):
        head = struct.pack("!BBQ", FIN | BINARY, 0xFF, size)
        cases.append(Case(f"a length of {size:#x}", head + KEY, fails=1002))
    return tuple(cases)


def _masking() -> tuple[Case, ...]:
    keys = (bytes(4), b"\xff" * 4, b"\x00\x00\x00\x01", b"\x81\x82\x88\x89")
    good = [
        Case(f"key {key.hex()}, {size} bytes", frame(TEXT, _pattern(size), key=key), (echo(_pattern(size)),))
        for key in keys
        for size in (1, 2, 3, 4, 5, 40_000)
    ]
    bad = [
        Case(f"unmasked frame of opcode {opcode}", text("a") + frame(opcode, body, masked=False) + text("b"),
             (echo("a"),), fails=1002)
        for opcode, body in ((TEXT, b"x"), (BINARY, b"x"), (PING, b""), (PONG, b""), (8, b"\x03\xe8"))
    ]  # fmt: skip
    bad.append(Case("unmasked continuation", frame(TEXT, b"a", fin=False)
                    + frame(CONTINUATION, b"b", masked=False), fails=1002))  # fmt: skip
    return (*good, *bad)


def _reserved() -> tuple[Case, ...]:
    cases = [
        Case(f"bits {bits:03b} in opcode {opcode}", text("a") + frame(opcode, b"", reserved=bits) + text("b"),
             (echo("a"),), fails=1002)
        for bits in range(1, 8)
        for opcode in (TEXT, BINARY, PING, PONG, 8)
    ]  # fmt: skip
    cases += [
        Case(f"bits {bits:03b} in a continuation",
             frame(TEXT, b"a", fin=False) + frame(CONTINUATION, b"b", reserved=bits), fails=1002)
        for bits in (1, 2, 4)
    ]  # fmt: skip
    return tuple(cases)


def _opcodes() -> tuple[Case, ...]:
    reserved = (3, 4, 5, 6, 7, 11, 12, 13, 14, 15)
    alone = [
        Case(f"opcode {opcode}, {'whole' if fin else 'begun'}, {len(body)} bytes",
             text("a") + frame(opcode, body, fin=fin) + frame(PING), (echo("a"),), fails=1002)
        for opcode in reserved
        for fin in (True, False)
        for body in (b"", b"x", b"x" * 200)
    ]  # fmt: skip
    between = [
        Case(f"opcode {opcode} between fragments", frame(TEXT, b"a", fin=False) + frame(opcode, b"x"),
             fails=1002)
        for opcode in reserved
    ]  # fmt: skip
    return (*alone, *between)


def _many() -> tuple[Case, ...]:
    numbers = [b"%d" % at for at in range(1000)]
    mixed = b"".join(frame(BINARY if at % 2 else TEXT, each) for at, each in enumerate(numbers))
    pieces = [b"x" * 1000] * 256
    return (
        Case("1,000 messages in one write", mixed,
             tuple(echo(each, BINARY if at % 2 else TEXT) for at, each in enumerate(numbers))),
        Case("1 MiB in one frame", frame(BINARY, bytes(1 << 20)), (echo(bytes(1 << 20), BINARY),)),
        Case("256,000 bytes in 256 fragments", fragments(BINARY, *pieces), (echo(b"x" * 256_000, BINARY),)),
        Case("4,096 fragments of one byte", fragments(TEXT, *[b"y"] * 4096), (echo(b"y" * 4096),)),
        Case("large and small in turn", (frame(BINARY, b"z" * 100_000) + text("s")) * 5,
             (echo(b"z" * 100_000, BINARY), echo("s")) * 5),
        Case("a close after a large message", frame(BINARY, b"z" * 100_000) + close(1000),
             (echo(b"z" * 100_000, BINARY), (0x88, b"\x03\xe8")), closes=True),
    )  # fmt: skip


CHAPTERS = (
    Chapter("Lengths", "5.2, 5.6", "text and binary of 0 to 262,145 bytes around every boundary", _lengths()),
    Chapter("Lengths that are wrong", "5.2", "longer forms than needed, the first bit of 64 set",
            _wrong_lengths()),
    Chapter("Masks", "5.1, 5.3", "keys of all kinds; unmasked frames of every opcode", _masking()),
    Chapter("Reserved bits", "5.2", "every combination, in every kind of frame", _reserved()),
    Chapter("Opcodes", "5.2", "3 to 7 and 11 to 15: whole, begun, between fragments", _opcodes()),
    Chapter("Quantity", "5.4, 5.6", "1,000 messages at once, 1 MiB, 4,096 fragments", _many()),
)  # fmt: skip
