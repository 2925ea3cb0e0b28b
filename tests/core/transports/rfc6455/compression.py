"""permessage-deflate (RFC 7692), with the context of earlier messages and without."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

from tests.core.transports.rfc6455.case import Case, Chapter, echo
from tests.core.transports.rfc6455.frames import BINARY, CONTINUATION, PING, TEXT, ReadFrame, frame, text

RSV1 = 4
"""The bit that marks a compressed message (section 6), as :func:`frame` counts it."""
TAIL = b"\x00\x00\xff\xff"
BOMB_BYTES = 100 << 20

SITES = ("shared", "context", "forgetful")
"""`shared`: the server keeps no context; `context`: both sides do; `forgetful`: the client keeps none."""

_HELLO = bytes.fromhex("f248cdc9c90700")
_HELLO_AGAIN = bytes.fromhex("f200110000")
_STORED = bytes.fromhex("000500faff48656c6c6f00")
_FINAL = bytes.fromhex("f348cdc9c9070000")
_TWO_BLOCKS = bytes.fromhex("f24805000000ffffcac9c90700")


def deflated(messages: Sequence[bytes], *, keep: bool) -> list[bytes]:
    """Messages as a client compresses them, with or without the context of those before."""
    packer = zlib.compressobj(wbits=-15)
    found = []
    for message in messages:
        if not keep:
            packer = zlib.compressobj(wbits=-15)
        found.append((packer.compress(message) + packer.flush(zlib.Z_SYNC_FLUSH))[: -len(TAIL)])
    return found


def inflated(frames: Sequence[ReadFrame]) -> list[ReadFrame]:
    """Return a server's messages, read by a client that keeps the context; reads others as well."""
    unpacker = zlib.decompressobj(wbits=-15)
    found: list[ReadFrame] = []
    for first, payload in frames:
        if first & 0x40:
            first, payload = first & ~0x40, unpacker.decompress(payload + TAIL)
        found.append((first, payload))
    return found


def _one(payload: bytes, opcode: int = TEXT) -> bytes:
    return frame(opcode, payload, reserved=RSV1)


def _in_fragments(payload: bytes, cut: int, between: bytes = b"") -> bytes:
    begun = frame(TEXT, payload[:cut], fin=False, reserved=RSV1)
    return begun + between + frame(CONTINUATION, payload[cut:])


def _rfc_examples() -> tuple[Case, ...]:
    hello = (echo("Hello"),)
    return tuple(
        case
        for site in SITES
        for case in (
            Case(f"7.2.3.1, {site}", _one(_HELLO), hello, site=site),
            Case(f"7.2.3.1 in two fragments, {site}", _in_fragments(_HELLO, 3), hello, site=site),
            Case(f"7.2.3.3, not compressed inside, {site}", _one(_STORED), hello, site=site),
            Case(f"7.2.3.4, a final block, {site}", _one(_FINAL), hello, site=site),
            Case(f"7.2.3.5, two blocks, {site}", _one(_TWO_BLOCKS), hello, site=site),
        )
    )  # fmt: skip


def _context() -> tuple[Case, ...]:
    many = [b'{"op":"publish","topic":"/odom","msg":{"x":%d}}' % number for number in range(100)]
    cases = [
        Case("7.2.3.2, the window is shared", _one(_HELLO) + _one(_HELLO_AGAIN),
             (echo("Hello"), echo("Hello")), site="context"),
        Case("the same from a client that said it would not", _one(_HELLO) + _one(_HELLO_AGAIN),
             (echo("Hello"),), fails=1007, site="forgetful"),
    ]  # fmt: skip
    for site in SITES:
        packed = deflated(many, keep=site != "forgetful")
        cases.append(Case(f"100 messages, {site}", b"".join(map(_one, packed)), tuple(map(echo, many)),
                          site=site))  # fmt: skip
        mixed = b"".join(_one(each) + text("plain") for each in packed[:10])
        answers = tuple(answer for each in many[:10] for answer in (echo(each), echo("plain")))
        cases.append(Case(f"compressed and plain in turn, {site}", mixed, answers, site=site))
    return tuple(cases)


def _messages() -> tuple[Case, ...]:
    noise = bytes(at * at % 251 for at in range(70_000))
    (packed,) = deflated([noise], keep=False)
    ping = frame(PING, b"p")
    return tuple(
        case
        for site in SITES
        for case in (
            Case(f"an empty message, {site}", _one(b"\x00"), (echo(""),), site=site),
            Case(f"binary of 70,000 bytes, {site}", _one(packed, BINARY), (echo(noise, BINARY),), site=site),
            Case(f"a ping between fragments, {site}", _in_fragments(_HELLO, 2, ping),
                 ((0x8A, b"p"), echo("Hello")), site=site),
        )
    )  # fmt: skip


def _wrong() -> tuple[Case, ...]:
    (bomb,) = deflated([bytes(BOMB_BYTES)], keep=False)
    cases = [
        Case("the bit in a continuation", frame(TEXT, _HELLO[:3], fin=False, reserved=RSV1)
             + frame(CONTINUATION, _HELLO[3:], reserved=RSV1), fails=1002, site="shared"),
        Case("the bit in a ping", frame(PING, b"", reserved=RSV1), fails=1002, site="shared"),
        Case("the bit in a close", frame(8, b"", reserved=RSV1), fails=1002, site="shared"),
        *(Case(f"bits {bits:03b}", frame(TEXT, _HELLO, reserved=bits), fails=1002, site="shared")
          for bits in (1, 2, 3, 5, 6, 7)),
    ]  # fmt: skip
    for site in SITES:
        cases += [
            Case(f"noise, {site}", text("a") + _one(b"\xff\xfe\xfd" * 10), (echo("a"),), fails=1007,
                 site=site),
            Case(f"a bomb: {BOMB_BYTES >> 20} MiB in {len(bomb) >> 10} KiB, {site}", _one(bomb, BINARY),
                 fails=1009, site=site),
            Case(f"a bomb in fragments, {site}", _in_fragments(bomb, 5000), fails=1009, site=site),
        ]  # fmt: skip
    return tuple(cases)


CHAPTERS = (
    Chapter("Compression, the examples", "RFC 7692: 7.2.3", "one block, two, final, stored; in fragments",
            _rfc_examples()),
    Chapter("Compression and context", "RFC 7692: 7.1.1", "taken over, not taken over, mixed with plain",
            _context()),
    Chapter("Compressed messages", "RFC 7692: 6, 7.2", "empty, large, a ping between fragments", _messages()),
    Chapter("Compression that is wrong", "RFC 7692: 6, 8", "bits, noise, 100 MiB in 100 KiB", _wrong()),
)  # fmt: skip
