"""From a server's URL to connections."""

from __future__ import annotations

import asyncio
import shlex
from urllib.parse import urlsplit

from conformance.pipes import Programs
from conformance.wires import Dial, StreamWire, WebSocketWire, WireError


def dialer(url: str) -> Dial:
    """What connects to a server.

    Raises:
        WireError: the URL has another scheme than ws, wss, tcp, unix or stdio.
    """
    parts = urlsplit(url)
    match parts.scheme:
        case "ws" | "wss":
            return lambda tag: WebSocketWire.open(url)
        case "tcp":
            if parts.hostname is None or parts.port is None:
                raise WireError(f"{url}: expected tcp://HOST:PORT")
            host, port = parts.hostname, parts.port
            return lambda tag: StreamWire.open(url, lambda: asyncio.open_connection(host, port))
        case "unix":
            return lambda tag: StreamWire.open(url, lambda: asyncio.open_unix_connection(parts.path))
        case "stdio":
            return Programs(shlex.split(url.partition(":")[2])).dial
    raise WireError(f"{url}: expected ws://, wss://, tcp://, unix:// or stdio:COMMAND")
