"""URL schemes: what a URL names, and which wire serves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from ssl import SSLContext
from urllib.parse import urlsplit

from rwt_transports.api import BindAddress, Driver
from rwt_transports.connection import MakeWire
from rwt_transports.drivers.datagrams import DatagramDriver
from rwt_transports.drivers.standard_streams import StandardStreamsDriver
from rwt_transports.errors import BadUrl
from rwt_transports.websocket.wire import websocket_server
from rwt_transports.wires.bson_stream import bson_documents
from rwt_transports.wires.json_datagrams import DATAGRAM_BYTES, json_datagrams
from rwt_transports.wires.json_stream import json_lines, json_over_tcp

DEFAULT_PORT = 9090
"""The port of rosbridge (CFG-01)."""


@dataclass(frozen=True, slots=True)
class Scheme:
    """One row of the table.

    Attributes:
        make_wire: the wire spoken.
        example: a URL that works.
        http: whether plain HTTP is answered on the same port, and the wire begins with an upgrade.
        tls: whether the connections are encrypted.
        unix: whether it names a path instead of host and port.
        make_driver: makes the one driver that can serve it; None: any driver of byte streams.
        single: whether there is one peer, with which the listener ends; it names no place.
        max_message_size: bytes of the largest message that can be sent; 0 for any.
        expires: whether a silent peer is forgotten, since nothing else says that it has gone.
        bson_wire: the wire spoken where every message is BSON; None: BSON cannot be spoken.
    """

    make_wire: MakeWire
    example: str
    http: bool = False
    tls: bool = False
    unix: bool = False
    make_driver: Callable[[], Driver] | None = None
    single: bool = False
    expires: bool = False
    max_message_size: int = 0
    bson_wire: MakeWire | None = None

    def wire(self, *, bson: bool) -> MakeWire | None:
        """The wire for JSON, or the one for BSON documents if there is one."""
        return self.bson_wire if bson else self.make_wire


SCHEMES = {
    "ws": Scheme(websocket_server, "ws://127.0.0.1:9090", http=True, bson_wire=websocket_server),
    "wss": Scheme(websocket_server, "wss://0.0.0.0:9090", http=True, tls=True, bson_wire=websocket_server),
    "tcp": Scheme(json_over_tcp, "tcp://127.0.0.1:9091", bson_wire=bson_documents),
    "tcps": Scheme(json_over_tcp, "tcps://0.0.0.0:9091", tls=True, bson_wire=bson_documents),
    "unix": Scheme(json_lines, "unix:///run/user/1000/robot.sock", unix=True, bson_wire=bson_documents),
    "udp": Scheme(
        json_datagrams,
        "udp://127.0.0.1:9092",
        make_driver=DatagramDriver,
        expires=True,
        max_message_size=DATAGRAM_BYTES,
    ),
    "stdio": Scheme(
        json_lines, "stdio:", make_driver=StandardStreamsDriver, single=True, bson_wire=bson_documents
    ),
}


@dataclass(frozen=True, slots=True)
class ListenUrl:
    """A URL to listen on, taken apart.

    Attributes:
        name: the scheme.
        scheme: its row.
        address: where to listen.
    """

    name: str
    scheme: Scheme
    address: BindAddress

    def with_port(self, port: int) -> str:
        """The URL with the port in use."""
        if self.scheme.single:
            return self.scheme.example
        if self.scheme.unix:
            return f"{self.name}://{self.address.path}"
        host = f"[{self.address.host}]" if ":" in self.address.host else self.address.host
        return f"{self.name}://{host}:{port}"


def parse_listen_url(url: str, tls: SSLContext | None = None) -> ListenUrl:
    """Take a URL apart.

    Raises:
        BadUrl: naming what is wrong, with an example.
    """
    name, separator, rest = url.partition("://")
    name = name.lower()
    if url.lower() == "stdio:":
        name, separator = "stdio", "://"
    scheme = SCHEMES.get(name)
    if not separator or scheme is None:
        known = ", ".join("stdio:" if each == "stdio" else f"{each}://" for each in SCHEMES)
        what = f"the scheme {name!r} is not known" if separator else "it has no scheme"
        raise BadUrl(f"cannot listen on {url!r}: {what}; use {known}, for example {SCHEMES['ws'].example}")
    if scheme.tls and tls is None:
        plain = f"{name[:-1]}://{rest}"
        raise BadUrl(
            f"cannot listen on {url!r}: it needs a certificate and a key "
            f"(tls.certfile, tls.keyfile); without them use {plain}"
        )
    if scheme.single:
        if rest:
            raise _bad(url, "standard input and output have no address", scheme)
        return ListenUrl(name, scheme, BindAddress())
    if scheme.unix:
        if not rest.startswith("/"):
            raise _bad(url, "it names no absolute path", scheme)
        return ListenUrl(name, scheme, BindAddress(path=rest))
    return ListenUrl(name, scheme, _tcp_address(url, scheme, tls if scheme.tls else None))


def _tcp_address(url: str, scheme: Scheme, tls: SSLContext | None) -> BindAddress:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        raise _bad(url, "its host or port is not well formed (a port is 0 to 65535)", scheme) from None
    if not host:
        raise _bad(url, "it names no host", scheme)
    if parts.path not in ("", "/") or parts.query or parts.fragment or parts.username is not None:
        raise _bad(url, "only a host and a port can be given; every path is served", scheme)
    return BindAddress(host, DEFAULT_PORT if port is None else port, tls=tls)


def _bad(url: str, what: str, scheme: Scheme) -> BadUrl:
    return BadUrl(f"cannot listen on {url!r}: {what}; for example {scheme.example}")
