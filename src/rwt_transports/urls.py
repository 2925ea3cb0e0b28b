"""URL schemes: what a URL names, and which wire serves it."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import urlsplit

from .connection import MakeWire
from .errors import BadUrl
from .wires.websocket import websocket_server

DEFAULT_PORT = 9090
"""The port of rosbridge (CFG-01)."""


@dataclass(frozen=True, slots=True)
class Scheme:
    """One row of the table.

    Attributes:
        make_wire: the wire spoken.
        http: whether plain HTTP is answered on the same port, and the wire begins with an upgrade.
        example: a URL that works.
    """

    make_wire: MakeWire
    http: bool
    example: str


SCHEMES = {
    "ws": Scheme(websocket_server, http=True, example="ws://127.0.0.1:9090"),
}


@dataclass(frozen=True, slots=True)
class ListenUrl:
    """A URL to listen on, taken apart.

    Attributes:
        name: the scheme.
        scheme: its row.
        host: name or address, without brackets.
        port: 0 to let the system choose.
    """

    name: str
    scheme: Scheme
    host: str
    port: int

    def with_port(self, port: int) -> str:
        """The URL with the port in use."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.name}://{host}:{port}"


def parse_listen_url(url: str) -> ListenUrl:
    """Take a URL apart.

    Raises:
        BadUrl: naming what is wrong, with an example.
    """
    name, separator, _ = url.partition("://")
    scheme = SCHEMES.get(name.lower())
    if not separator or scheme is None:
        known = ", ".join(f"{each}://" for each in SCHEMES)
        what = f"the scheme {name!r} is not known" if separator else "it has no scheme"
        raise BadUrl(
            f"cannot listen on {url!r}: {what}; use {known}, for example ws://127.0.0.1:{DEFAULT_PORT}"
        )
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise _bad(url, "its host or port is not well formed (a port is 0 to 65535)", scheme) from None
    if not host:
        raise _bad(url, "it names no host", scheme)
    if parts.path not in ("", "/") or parts.query or parts.fragment or parts.username is not None:
        raise _bad(url, "only a host and a port can be given; every path is served", scheme)
    return ListenUrl(name.lower(), scheme, host, DEFAULT_PORT if port is None else port)


def _bad(url: str, what: str, scheme: Scheme) -> BadUrl:
    return BadUrl(f"cannot listen on {url!r}: {what}; for example {scheme.example}")
