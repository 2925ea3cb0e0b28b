"""What a server says of itself at `/healthz`, which only servers of this project have."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import ssl


@dataclass(frozen=True, slots=True)
class Health:
    """The state of a server.

    Attributes:
        running: whether its graph runs.
        version: of the server; empty for one that does not say.
        clients: that are connected.
        work: seconds of work for them in each of the last seconds.
        clients_beyond_rate: clients that cause more work than their rate allows.
    """

    running: bool
    version: str = ""
    clients: int = 0
    work: float = 0.0
    clients_beyond_rate: int = 0


async def health_of(url: str, patience: float, tls: ssl.SSLContext | None) -> Health | None:
    """Ask the server at a WebSocket URL; None where nothing answers over HTTP.

    Args:
        url: of the server; other schemes than ``ws`` and ``wss`` have no HTTP.
        patience: seconds that it may take.
        tls: how its certificate is checked; None for the system's authorities.
    """
    import anyio.to_thread

    scheme, _, rest = url.partition("://")
    if scheme.lower() not in ("ws", "wss"):
        return None
    host, secure = re.split("[/?]", rest)[0], scheme.lower() == "wss"
    status, body = await anyio.to_thread.run_sync(partial(_get_health, host, secure, patience, tls))
    if status == 0:
        return None
    try:
        said = json.loads(body)
        return Health(
            status == 200,
            str(said["version"]),
            int(said["clients"]),
            float(said["work"]),
            int(said["clients_beyond_rate"]),
        )
    except (ValueError, KeyError, TypeError):
        return Health(status == 200)


def _get_health(host: str, secure: bool, patience: float, tls: ssl.SSLContext | None) -> tuple[int, bytes]:
    """Status and body of ``/healthz``; status 0 if there is no answer of HTTP."""
    import http.client

    try:
        address = host.rpartition("@")[2]
        if secure:
            connection: http.client.HTTPConnection = http.client.HTTPSConnection(address, context=tls)
        else:
            has_port = ":" in address.rpartition("]")[2]
            connection = http.client.HTTPConnection(address if has_port else f"{address}:9090")
        connection.timeout = patience
        try:
            connection.request("GET", "/healthz")
            answer = connection.getresponse()
            return answer.status, answer.read(65536)
        finally:
            connection.close()
    except (OSError, http.client.HTTPException, ValueError):
        return 0, b""
