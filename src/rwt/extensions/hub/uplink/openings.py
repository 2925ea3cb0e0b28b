"""How a stream of an uplink begins: the client or the request for a page that the hub opens it for.

The opening of a client::

    {"client": {"address": "192.0.2.7", "port": 50123, "path": "/", "headers": {"origin": "…"}}}

Every message of the stream is then the client's or for the client, until either side ends it.

The opening of a request has ``request`` in place of ``client``, with ``method``, ``path``, ``query``,
``prefix``, ``address``, ``headers`` and ``body``: the size of a body, which follows as one message; 0 for
none. The robot answers with a head, ``{"status": 200, "content_type": "…", "headers": {…}}``, and the body
(:mod:`rwt.extensions.hub.uplink.pages`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from http import HTTPStatus
from typing import Annotated, Final, NamedTuple

import msgspec

from rwt_transports.endpoint import PeerInfo
from rwt_transports.http.routes import HttpRequest

ROBOTS: Final = "/robots/"
"""Path for robots; the rest of the path is the robot's name."""

INSTANCE: Final = "rwt-instance"
"""Request header with a random id of the program, which distinguishes two that use the same robot's name."""

MAX_BODY_BYTES: Final = 64 * 1024 * 1024
"""Maximum size of the body of a request."""

REPLACED: Final = 4009
"""Close code for a robot whose name another program has taken."""

UNUSED: Final = 4010
"""Close code of a node for another one whose robot has no clients there."""

TRANSPORT: Final = "dial"
"""Name of the transport of clients that connect through a hub."""

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_TAKEN: Final = frozenset({"robots", "healthz", "metrics"})
_HEADER_NAME: Final = re.compile(r"[!#$%&'*+.^_`|~0-9A-Za-z-]{1,256}")
_STATUSES: Final = frozenset(HTTPStatus)
NAME_RULE: Final = "a letter or digit, then up to 63 of A-Z a-z 0-9 _ . -, and not " + " or ".join(
    sorted(_TAKEN)
)


class BadOpening(ValueError):
    """The opening of a stream, or the head of a page, is invalid."""


class _Client(msgspec.Struct):
    address: str = ""
    port: int = 0
    path: str = "/"
    headers: dict[str, str] = {}
    subprotocol: str = ""


class _Request(msgspec.Struct):
    method: str = "GET"
    path: str = "/"
    query: str = ""
    prefix: str = ""
    address: str = ""
    headers: dict[str, str] = {}
    body: Annotated[int, msgspec.Meta(ge=0, le=MAX_BODY_BYTES)] = 0


class _Opening(msgspec.Struct, omit_defaults=True):
    client: _Client | None = None
    request: _Request | None = None


class _PageHead(msgspec.Struct):
    status: Annotated[int, msgspec.Meta(ge=200, le=599)]
    content_type: str
    headers: dict[str, str] = {}


_decoder = msgspec.json.Decoder(_Opening)
_head_decoder = msgspec.json.Decoder(_PageHead)


def encode_client(client: PeerInfo, path: str) -> bytes:
    """Return the opening for a client that requested `path` below the robot's own."""
    headers = dict(client.headers)
    opened = _Client(client.address, client.port, path, headers, client.subprotocol)
    return msgspec.json.encode(_Opening(opened))


def encode_request(request: HttpRequest, path: str, prefix: str) -> bytes:
    """Return the opening for a request for a page at `path`, which the hub serves below `prefix`."""
    return _encode_request(request, path, prefix, len(request.body))


def _encode_request(request: HttpRequest, path: str, prefix: str, size: int) -> bytes:
    headers = dict(request.headers)
    asked = _Request(request.method, path, request.query, prefix, request.address, headers, size)
    return msgspec.json.encode(_Opening(request=asked))


class PageRequest(NamedTuple):
    """Request for a page, whose body follows if its size is not 0."""

    request: HttpRequest
    body_size: int


def encode_opening(opened: PeerInfo | PageRequest) -> bytes:
    """Return an opening that was decoded."""
    if isinstance(opened, PeerInfo):
        return encode_client(opened, opened.path)
    asked, size = opened
    return _encode_request(asked, asked.path, asked.prefix, size)


def decode_opening(data: bytes) -> PeerInfo | PageRequest:
    """Return the client or the request of an opening; raises BadOpening."""
    try:
        opening = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise BadOpening("expected a client or a request in the opening of a stream") from None
    client, asked = opening.client, opening.request
    if client is not None:
        return PeerInfo(
            TRANSPORT, client.address, client.port, client.path, client.headers,
            subprotocol=client.subprotocol,
        )  # fmt: skip
    if asked is None:
        raise BadOpening("expected a client or a request in the opening of a stream")
    request = HttpRequest(
        asked.method, asked.path, asked.query, asked.headers, b"", asked.address, asked.prefix
    )
    return PageRequest(request, asked.body)


def encode_head(status: int, content_type: str, headers: dict[str, str]) -> bytes:
    """Return the head of a page; its body follows."""
    return msgspec.json.encode(_PageHead(status, content_type, headers))


def decode_head(data: bytes) -> tuple[int, str, dict[str, str]]:
    """Return status, content type and headers of a page.

    Raises:
        BadOpening: the message is something else, or a header has a line break.
    """
    try:
        head = _head_decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        raise BadOpening("expected the head of a page") from None
    check_headers({"content-type": head.content_type})
    check_headers(head.headers)
    if head.status not in _STATUSES:
        raise BadOpening(f"{head.status} is no status of HTTP")
    return head.status, head.content_type, head.headers


def check_headers(headers: Mapping[str, str]) -> None:
    """Check headers of a robot, before the hub sends them to a client.

    Raises:
        BadOpening: a name or a value is not one of HTTP, such as a value with a line break.
    """
    if not all(_HEADER_NAME.fullmatch(name) for name in headers):
        raise BadOpening("expected the names of headers (RFC 9110 section 5.6.2)")
    for text in headers.values():
        if not (text.isascii() and text.isprintable() and text == text.strip()):
            raise BadOpening("expected headers of printable ASCII, without spaces around them")


def is_robot_name(name: str) -> bool:
    """Return True if the name is allowed for a robot, see :data:`NAME_RULE`."""
    return _NAME.fullmatch(name) is not None and name not in _TAKEN


def split_client_path(target: str) -> tuple[str, str]:
    """Return the robot that a client requests, and the rest of the path with the query."""
    path, question, query = target.partition("?")
    name, _, rest = path.removeprefix("/").partition("/")
    return name, f"/{rest}{question}{query}"
