"""Relay protocol: messages of a hub and a robot before a client's messages flow.

A robot opens WebSocket connections to ``/robots/NAME`` of a hub and keeps a few that wait. When a client
arrives the hub gives it one of these and says so in a first text message, the *assignment*::

    {"client": {"address": "192.0.2.7", "port": 50123, "path": "/", "headers": {"origin": "…"}}}

From then on every message of the connection is the client's or for the client, until either side closes.

A request for a page takes a connection in the same way. Its assignment has ``request`` in place of
``client``, with ``method``, ``path``, ``query``, ``prefix``, ``address``, ``headers`` and, where there is
one, ``body`` in base64; the robot answers with a head,
``{"status": 200, "content_type": "…", "headers": {…}}``, and the body
(:mod:`rwt.extensions.hub.relay.pages`).
"""

from __future__ import annotations

import re
from http import HTTPStatus
from typing import Annotated, Final

import msgspec

from rwt_transports.endpoint import PeerInfo
from rwt_transports.http.proxies import behind_proxy
from rwt_transports.http.routes import HttpRequest, is_local

ROBOTS: Final = "/robots/"
"""Path for robots; the rest of the path is the robot's name."""

INSTANCE: Final = "rwt-instance"
"""Request header with a random id of the program, which distinguishes two that use the same robot's name."""

REPLACED: Final = 4009
"""Close code for a robot whose name another program has taken."""

TRANSPORT: Final = "dial"
"""Name of the transport of clients that connect through a hub."""

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_TAKEN: Final = frozenset({"robots", "healthz", "metrics"})
_HEADER_NAME: Final = re.compile(r"[!#$%&'*+.^_`|~0-9A-Za-z-]{1,256}")
_STATUSES: Final = frozenset(HTTPStatus)
NAME_RULE: Final = "a letter or digit, then up to 63 of A-Z a-z 0-9 _ . -, and not " + " or ".join(
    sorted(_TAKEN)
)


class BadAssignment(ValueError):
    """The first message of the hub is not an assignment."""


class _Client(msgspec.Struct):
    address: str = ""
    port: int = 0
    path: str = "/"
    headers: dict[str, str] = {}


class _Request(msgspec.Struct):
    method: str = "GET"
    path: str = "/"
    query: str = ""
    prefix: str = ""
    address: str = ""
    headers: dict[str, str] = {}
    body: bytes | msgspec.UnsetType = msgspec.UNSET


class _Assignment(msgspec.Struct, omit_defaults=True):
    client: _Client | None = None
    request: _Request | None = None


class _PageHead(msgspec.Struct):
    status: Annotated[int, msgspec.Meta(ge=200, le=599)]
    content_type: str
    headers: dict[str, str] = {}


_decoder = msgspec.json.Decoder(_Assignment)
_head_decoder = msgspec.json.Decoder(_PageHead)


def encode_assignment(client: PeerInfo, path: str) -> bytes:
    """Return the assignment of a client that requested `path` below the robot's own."""
    return msgspec.json.encode(_Assignment(_Client(client.address, client.port, path, dict(client.headers))))


def encode_request(request: HttpRequest, path: str, prefix: str) -> bytes:
    """Return the assignment of a request for a page at `path`, which the hub serves below `prefix`."""
    headers = dict(request.headers)
    body = request.body or msgspec.UNSET
    asked = _Request(request.method, path, request.query, prefix, request.address, headers, body)
    return msgspec.json.encode(_Assignment(request=asked))


def decode_assignment(data: bytes, *, is_hub_local: bool = False) -> PeerInfo | HttpRequest:
    """Return the client or the page request of an assignment.

    Args:
        is_hub_local: True if clients on the hub's machine are on this machine.

    Raises:
        BadAssignment: the message is something else.
    """
    try:
        assignment = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise BadAssignment("expected the assignment of a client as the first message") from None
    client, asked = assignment.client, assignment.request
    for named in (client, asked):
        if named is not None and not is_hub_local and is_local(named.address):
            named.address = behind_proxy(named.address)
    if client is not None:
        return PeerInfo(TRANSPORT, client.address, client.port, client.path, client.headers)
    if asked is None:
        raise BadAssignment("expected the assignment of a client as the first message")
    body = b"" if asked.body is msgspec.UNSET else asked.body
    return HttpRequest(
        asked.method, asked.path, asked.query, asked.headers, body, asked.address, asked.prefix
    )


def encode_head(status: int, content_type: str, headers: dict[str, str]) -> bytes:
    """Return the head of a page; its body follows."""
    return msgspec.json.encode(_PageHead(status, content_type, headers))


def decode_head(data: bytes) -> tuple[int, str, dict[str, str]]:
    """Return status, content type and headers of a page.

    Raises:
        BadAssignment: the message is something else, or a header has a line break.
    """
    try:
        head = _head_decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise BadAssignment("expected the head of a page") from None
    texts = (head.content_type, *head.headers.values())
    if not all(text.isascii() and text.isprintable() and text == text.strip() for text in texts):
        raise BadAssignment("expected headers of printable ASCII, without spaces around them")
    if not all(_HEADER_NAME.fullmatch(name) for name in head.headers):
        raise BadAssignment("expected the names of headers (RFC 9110 section 5.6.2)")
    if head.status not in _STATUSES:
        raise BadAssignment(f"{head.status} is no status of HTTP")
    return head.status, head.content_type, head.headers


def is_robot_name(name: str) -> bool:
    """Return True if the name is allowed for a robot, see :data:`NAME_RULE`."""
    return _NAME.fullmatch(name) is not None and name not in _TAKEN


def split_client_path(target: str) -> tuple[str, str]:
    """Return the robot that a client requests, and the rest of the path with the query."""
    path, question, query = target.partition("?")
    name, _, rest = path.removeprefix("/").partition("/")
    return name, f"/{rest}{question}{query}"
