"""The opening handshake (RFC 6455 section 4.2): requests as raw bytes, and the status that answers them."""

from __future__ import annotations

from dataclasses import dataclass

REQUEST = (
    b"GET /robot HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)
ACCEPT = b"s3pPLMBiTxaQ9kYGzzhZRbK+xOo="
"""Accept value for the key of the request, by section 1.3."""
_KEY_LINE = b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"


@dataclass(frozen=True, slots=True)
class Handshake:
    """One request, and the status of its answer."""

    name: str
    request: bytes
    status: int


def _changed(name: str, old: bytes, new: bytes, status: int) -> Handshake:
    assert REQUEST.count(old) == 1
    return Handshake(name, REQUEST.replace(old, new), status)


def _with(name: str, line: bytes, status: int) -> Handshake:
    return _changed(name, b"\r\n\r\n", b"\r\n" + line + b"\r\n\r\n", status)


HANDSHAKES = (
    Handshake("the plain request", REQUEST, 101),
    _changed("header names in lower case", b"Upgrade: websocket\r\nConnection: Upgrade",
             b"upgrade: websocket\r\nconnection: upgrade", 101),
    _changed("values in other cases", b": websocket\r\nConnection: Upgrade",
             b": WebSocket\r\nConnection: UPGRADE", 101),
    _changed("a connection with more tokens", b"Connection: Upgrade", b"Connection: keep-alive, Upgrade",
             101),
    _changed("a query", b"/robot ", b"/robot?token=a&b=%20 ", 101),
    _with("an origin", b"Origin: http://localhost:8080", 101),
    _with("an extension that nobody knows", b"Sec-WebSocket-Extensions: x-robot; level=9", 101),
    _with("a subprotocol that nobody asked for", b"Sec-WebSocket-Protocol: rosbridge", 101),
    _changed("not GET", b"GET ", b"POST ", 405),
    _changed("HTTP/1.0", b"HTTP/1.1", b"HTTP/1.0", 426),
    _changed("no host", b"Host: localhost\r\n", b"", 400),
    _changed("no connection header", b"Connection: Upgrade\r\n", b"", 426),
    _changed("another connection header", b"Connection: Upgrade", b"Connection: close", 426),
    _changed("no key", _KEY_LINE, b"", 400),
    _changed("two keys", _KEY_LINE, _KEY_LINE * 2, 400),
    _changed("a key that is not base64", b"dGhlIHNhbXBsZSBub25jZQ==", b"!" * 24, 400),
    _changed("a key of 15 bytes", b"dGhlIHNhbXBsZSBub25jZQ==", b"AAAAAAAAAAAAAAAAAAAA", 400),
    _changed("a key of 17 bytes", b"dGhlIHNhbXBsZSBub25jZQ==", b"AAAAAAAAAAAAAAAAAAAAAAA=", 400),
    _changed("no version", b"Sec-WebSocket-Version: 13\r\n", b"", 426),
    *(_changed(f"version {version}", b"Version: 13", b"Version: %d" % version, 426)
      for version in (0, 7, 8, 12, 14, 130)),
    _changed("a version that is no number", b"Version: 13", b"Version: x", 426),
    Handshake("not HTTP", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", 400),
    _with("a control character in a header", b"X-Robot: \x01", 400),
    _with("a header line without a colon", b"nonsense", 400),
    _with("16 KiB of headers and more", b"X-Long: " + b"x" * 20_000, 431),
)  # fmt: skip
