"""URL schemes: driver and wire for listening and connecting.

Other distributions add schemes by entry points of the group `rwt.transports`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from ssl import SSLContext
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

from rwt_protocol.extensions import ExtensionError, extension_names, imported_on_call, load_extension
from rwt_transports.api import BindAddress, Connector, Driver, RemoteAddress
from rwt_transports.background import runs_asyncio
from rwt_transports.connection import MakeWire
from rwt_transports.drivers.asyncio_protocol import AsyncioDriver
from rwt_transports.errors import BadUrl
from rwt_transports.limits import DATAGRAM_BYTES
from rwt_transports.websocket.wire import WebSocketWire

if TYPE_CHECKING:
    from rwt_transports.drivers.anyio_stream import AnyioDriver

DEFAULT_PORT = 9090
"""The port of rosbridge (CFG-01)."""

_GROUP: Final = "rwt.transports"

# Most servers offer WebSocket on asyncio only; what serves other URLs is imported with the first connection.
_anyio_driver = imported_on_call("rwt_transports.drivers.anyio_stream:AnyioDriver")
_datagrams = imported_on_call("rwt_transports.drivers.datagrams:DatagramDriver")
_standard_streams = imported_on_call("rwt_transports.drivers.standard_streams:StandardStreamsDriver")
_websocket_client = partial(WebSocketWire, server=False)
_json_over_tcp = imported_on_call("rwt_transports.wires.json_stream:JsonStreamWire")
_json_lines = imported_on_call("rwt_transports.wires.json_stream:JsonLinesWire")
_json_datagrams = imported_on_call("rwt_transports.wires.json_stream:JsonDatagramWire")
_bson_documents = imported_on_call("rwt_transports.wires.bson_stream:BsonStreamWire")


def stream_driver() -> AsyncioDriver | AnyioDriver:
    """Return the fastest driver of TCP and Unix sockets on the running event loop."""
    if runs_asyncio():
        return AsyncioDriver()
    driver: AnyioDriver = _anyio_driver()
    return driver


@dataclass(frozen=True, slots=True)
class Scheme:
    """Row of the table of schemes.

    Attributes:
        example: URL to listen on, or to connect to if the scheme cannot be listened on.
        wire: factory of a client's wire; None: for connecting only, and a server offers it in another way.
        client_wire: factory of a server's wire; None: the scheme is only for listening.
        bson_wire: factory of the wire of a BSON-only client; None: BSON is not supported.
        driver: factory of the driver that listens.
        connector: factory of the connector.
        http: True if a connection begins as HTTP, and becomes a WebSocket by an upgrade.
        tls: True if connections are encrypted.
        binary: True if binary messages can be sent beside text.
        unix: True if the address is the path of a Unix socket instead of host and port.
        single: True if there is one peer, with which the listener ends; a URL to listen on has no address,
            one to connect to names a program.
        expires: True if a silent peer counts as lost after a time, because the transport has no connections.
        connect_port: default port of a URL to connect to.
        max_message_size: size of the largest message that can be sent, in bytes; 0 for any.
        instead: how a server offers it, for a scheme that cannot be listened on.
    """

    example: str
    wire: MakeWire | None = None
    client_wire: MakeWire | None = None
    bson_wire: MakeWire | None = None
    driver: Callable[[], Driver] = stream_driver
    connector: Callable[[], Connector] = stream_driver
    http: bool = False
    tls: bool = False
    binary: bool = False
    unix: bool = False
    single: bool = False
    expires: bool = False
    connect_port: int = DEFAULT_PORT
    max_message_size: int = 0
    instead: str = ""


SCHEMES = {
    "ws": Scheme(
        "ws://127.0.0.1:9090", WebSocketWire, _websocket_client, WebSocketWire, http=True, binary=True
    ),
    "wss": Scheme(
        "wss://0.0.0.0:9090", WebSocketWire, _websocket_client, WebSocketWire, http=True, binary=True,
        tls=True, connect_port=443,
    ),
    "tcp": Scheme("tcp://127.0.0.1:9091", _json_over_tcp, _json_over_tcp, _bson_documents),
    "tcps": Scheme("tcps://0.0.0.0:9091", _json_over_tcp, _json_over_tcp, _bson_documents, tls=True),
    "unix": Scheme("unix:///run/user/1000/robot.sock", _json_lines, _json_lines, _bson_documents, unix=True),
    "udp": Scheme(
        "udp://127.0.0.1:9092", _json_datagrams, driver=_datagrams, expires=True,
        max_message_size=DATAGRAM_BYTES,
    ),
    "stdio": Scheme(
        "stdio:", _json_lines, _json_lines, _bson_documents, driver=_standard_streams,
        connector=_standard_streams, single=True,
    ),
}  # fmt: skip


def scheme_of(url: str) -> Scheme | None:
    """Return the scheme of a URL, from the table or an entry point in the group `rwt.transports`; None if
    unknown.

    Raises:
        BadUrl: the entry point cannot be imported, or is not a :class:`Scheme`.
    """
    name, colon, _ = url.partition(":")
    name = name.lower()
    scheme = SCHEMES.get(name)
    if scheme is None and colon and name in extension_names(_GROUP):
        try:
            scheme = load_extension(_GROUP, name, SCHEMES)
        except ExtensionError as error:
            raise BadUrl(f"cannot use {url!r}: {error}") from error
        if not isinstance(scheme, Scheme):
            raise BadUrl(f"cannot use {url!r}: the entry point {name!r} of {_GROUP} is not a Scheme")
        SCHEMES[name] = scheme
    return scheme


def _known_forms(*, connect: bool = False) -> str:
    more = [f"{name}://" for name in extension_names(_GROUP) if name not in SCHEMES]
    return ", ".join((url_forms(connect=connect), *more))


def url_forms(*, connect: bool = False) -> str:
    """Return the supported URL prefixes for help and errors: ``ws://, wss://, …``."""
    rows = [(name, row) for name, row in SCHEMES.items() if (row.client_wire if connect else row.wire)]
    return ", ".join(f"{name}:" if row.single else f"{name}://" for name, row in rows)


def carries_binary(url: str) -> bool:
    """Return True if binary messages can be sent to that URL; not on a stream of JSON objects (TCP-05)."""
    scheme = scheme_of(url)
    return scheme is not None and scheme.binary


@dataclass(frozen=True, slots=True)
class ListenUrl:
    """Parsed URL to listen on."""

    name: str
    scheme: Scheme
    address: BindAddress

    def with_port(self, port: int) -> str:
        """Return the URL with the port in use."""
        if self.scheme.single:
            return self.scheme.example
        if self.scheme.unix:
            return f"{self.name}://{self.address.path}"
        host = f"[{self.address.host}]" if ":" in self.address.host else self.address.host
        return f"{self.name}://{host}:{port}"


def parse_listen_url(url: str, tls: SSLContext | None = None) -> ListenUrl:
    """Parse a URL to listen on.

    Raises:
        BadUrl: the URL is invalid; the text gives the fault and an example.
    """
    name, colon, rest = url.partition(":")
    name = name.lower()
    scheme = scheme_of(url)
    if not colon or scheme is None or not (scheme.single or rest.startswith("//")):
        what = f"the scheme {name!r} is not known" if "://" in url else "it has no scheme"
        example = SCHEMES["ws"].example
        raise BadUrl(f"cannot listen on {url!r}: {what}; use {_known_forms()}, for example {example}")
    if scheme.wire is None:
        raise BadUrl(f"cannot listen on {url!r}: {scheme.instead or 'it is for connecting only'}")
    if scheme.tls and tls is None:
        raise BadUrl(
            f"cannot listen on {url!r}: it needs a certificate and a key "
            "(tls.certfile, tls.keyfile), or `--tls auto`, which creates them; "
            f"without TLS use {name[:-1]}:{rest}"
        )
    if scheme.single:
        if rest:
            raise _bad(url, "standard input and output have no address", scheme)
        return ListenUrl(name, scheme, BindAddress())
    if scheme.unix:
        if not rest.startswith("///"):
            raise _bad(url, "it names no absolute path", scheme)
        return ListenUrl(name, scheme, BindAddress(path=rest[2:]))
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


@dataclass(frozen=True, slots=True)
class ConnectUrl:
    """Parsed URL to connect to.

    Attributes:
        path: path and query of the request, for the schemes that have one.
    """

    name: str
    scheme: Scheme
    client_wire: MakeWire
    address: RemoteAddress
    path: str = ""


def parse_connect_url(url: str) -> ConnectUrl:
    """Parse a URL to connect to.

    Raises:
        BadUrl: the URL is invalid; the text gives the fault and an example.
    """

    def bad(what: str) -> BadUrl:
        return BadUrl(f"cannot connect to {url!r}: {what}")

    name, colon, rest = url.partition(":")
    name = name.lower()
    scheme = scheme_of(url)
    if scheme is None or scheme.client_wire is None or not colon:
        raise bad(f"use one of {_known_forms(connect=True)}, for example ws://127.0.0.1:9090")
    if scheme.single or scheme.unix:
        path = rest.strip() if scheme.single else rest.removeprefix("//")
        if scheme.single and not path:
            raise bad(f"it names no command; for example {name}:my_robot --serve")
        if scheme.unix and not path.startswith("/"):
            raise bad(f"it names no absolute path; for example {name}:///run/r.sock")
        return ConnectUrl(name, scheme, scheme.client_wire, RemoteAddress(path=path))
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or parts.fragment or parts.username is not None:
        raise bad(f"expected {name}://HOST:PORT, for example {name}://robot:9090")
    address = RemoteAddress(host, scheme.connect_port if port is None else port)
    path = f"{parts.path or '/'}?{parts.query}" if parts.query else parts.path or "/"
    return ConnectUrl(name, scheme, scheme.client_wire, address, path)
