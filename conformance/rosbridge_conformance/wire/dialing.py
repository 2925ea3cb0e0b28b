"""From a server's URL to connections."""

from __future__ import annotations

import asyncio
import shlex
from urllib.parse import urlsplit

from rosbridge_conformance.wire.pipes import Programs
from rosbridge_conformance.wire.wires import Dial, StreamWire, WebSocketWire


class BadAddress(Exception):
    """The URL of the server cannot be read."""


def dialer(url: str) -> Dial:
    """What connects to a server.

    Raises:
        BadAddress: the URL has another scheme than ws, wss, tcp, unix or stdio, or lacks what
            its scheme needs.
    """
    parts = urlsplit(url)
    try:
        wanting = (parts.scheme in ("ws", "wss") and parts.hostname is None) or parts.port == 0
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
    raise BadAddress(f"{url}: expected ws://, wss://, tcp://, unix:// or stdio:COMMAND")
