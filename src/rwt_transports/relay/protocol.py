"""What a hub and a robot that has dialled in say to each other before a client's messages flow.

A robot opens WebSocket connections to ``/robots/NAME`` of a hub and keeps a few that wait. When a client
arrives the hub gives it one of these and says so in a first text message, the *assignment*::

    {"client": {"address": "192.0.2.7", "port": 50123, "path": "/", "headers": {"origin": "…"}}}

From then on every message of the connection is the client's or for the client, until either side closes.
"""

from __future__ import annotations

import re
from typing import Final

import msgspec

from rwt_protocol.transport import PeerInfo

ROBOTS: Final = "/robots/"
"""Where robots dial in; the rest of the path is the robot's name."""

INSTANCE: Final = "rwt-instance"
"""Request header with a random id of the program, which distinguishes two that use the same robot's name."""

REPLACED: Final = 4009
"""Close code for a robot whose name another program has taken."""

TRANSPORT: Final = "dial"
"""What a robot calls the transport of clients that come through a hub."""

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_TAKEN: Final = frozenset({"robots", "healthz", "metrics"})
NAME_RULE: Final = "a letter or digit, then up to 63 of A-Z a-z 0-9 _ . -, and not " + " or ".join(
    sorted(_TAKEN)
)


class BadAssignment(ValueError):
    """The first message of a hub is not an assignment."""


class _Client(msgspec.Struct):
    address: str = ""
    port: int = 0
    path: str = "/"
    headers: dict[str, str] = {}


class _Assignment(msgspec.Struct):
    client: _Client


_decoder = msgspec.json.Decoder(_Assignment)


def encode_assignment(client: PeerInfo, path: str) -> bytes:
    """The assignment of a client that asked for `path` below the robot's own."""
    return msgspec.json.encode(_Assignment(_Client(client.address, client.port, path, dict(client.headers))))


def decode_assignment(data: bytes) -> PeerInfo:
    """The client that an assignment names.

    Raises:
        BadAssignment: the message is something else.
    """
    try:
        client = _decoder.decode(data).client
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise BadAssignment("expected the assignment of a client as the first message") from None
    return PeerInfo(TRANSPORT, client.address, client.port, client.path, client.headers)


def is_robot_name(name: str) -> bool:
    """Whether a robot can be called so: :data:`NAME_RULE`."""
    return _NAME.fullmatch(name) is not None and name not in _TAKEN


def split_client_path(target: str) -> tuple[str, str]:
    """The robot that a client asks for, and the rest of its path with the query."""
    path, question, query = target.partition("?")
    name, _, rest = path.removeprefix("/").partition("/")
    return name, f"/{rest}{question}{query}"
