"""Connections from a server's URL."""

from __future__ import annotations

import asyncio
import shlex
from urllib.parse import urlsplit

from rosbridge_conformance.wire.pipes import Programs
from rosbridge_conformance.wire.wires import Dial, StreamWire, WebSocketWire

_WITH_HOST = ("ws", "wss", "webrtc+http", "webrtc+https")


class BadAddress(Exception):
    """The URL of the server is invalid."""


def dialer(url: str) -> Dial:
    """Return the function that connects to a server.

    Raises:
        BadAddress: the scheme is not ws, wss, tcp, unix, stdio, webrtc+http or webrtc+https, or the URL
            is incomplete.
    """
    parts = urlsplit(url)
    try:
        wanting = (parts.scheme in _WITH_HOST and parts.hostname is None) or parts.port == 0
    except ValueError:
        wanting = True
    if wanting:
        raise BadAddress(f"{url}: expected {parts.scheme}://HOST:PORT")
    match parts.scheme:
        case "ws" | "wss":
            return lambda tag: WebSocketWire.open(url)
        case "tcp":
            if parts.hostname is None or parts.port is None:
                raise BadAddress(f"{url}: expected tcp://HOST:PORT")
            host, port = parts.hostname, parts.port
            return lambda tag: StreamWire.open(url, lambda: asyncio.open_connection(host, port))
        case "unix":
            return lambda tag: StreamWire.open(url, lambda: asyncio.open_unix_connection(parts.path))
        case "stdio":
            command = url.partition(":")[2]
            if not command.strip():
                raise BadAddress(f"{url}: expected stdio:COMMAND")
            return Programs(shlex.split(command)).dial
        case "webrtc+http" | "webrtc+https":
            return _data_channels(url)
    raise BadAddress(f"{url}: expected ws://, wss://, tcp://, unix://, stdio:COMMAND or webrtc+http://")


def _data_channels(url: str) -> Dial:
    try:
        from rosbridge_conformance.wire.data_channels import DataChannels  # An optional dependency.
    except ImportError as missing:
        raise BadAddress(f"{url}: WebRTC needs aiortc: pip install aiortc ({missing})") from missing
    return DataChannels(url).dial
