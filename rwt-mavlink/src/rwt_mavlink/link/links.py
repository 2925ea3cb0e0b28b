"""Links: datagrams and streams of bytes, over UDP, TCP and serial ports."""

from __future__ import annotations

import socket
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Hashable
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Final, TypeAlias

import anyio
import anyio.to_thread

from rwt_mavlink.link.addresses import LinkAddress

if TYPE_CHECKING:
    import serial

Source: TypeAlias = Hashable
"""Sender of bytes on a link: an address of UDP, or the link itself."""

STREAM: Final[Source] = "stream"
"""Source of the bytes of a link with one sender."""

_READ_BYTES: Final = 65536
#: Timeout of reads from serial ports, after which a closed link is noticed.
_SERIAL_SECONDS: Final = 0.2


class LinkClosed(Exception):
    """The other side closed the link, or the device is gone."""


class Link(ABC):
    """Open link.

    Attributes:
        is_datagrams: True if each receipt is one datagram, with whole frames.
        known: sources that are known before they sent anything.
    """

    is_datagrams = False
    known: tuple[Source, ...] = ()

    @abstractmethod
    async def receive(self) -> tuple[bytes, Source]:
        """Wait for bytes, and return them with their source.

        Raises:
            LinkClosed: the link has ended.
        """

    @abstractmethod
    async def send(self, data: bytes, source: Source) -> None:
        """Send bytes to a source.

        Raises:
            LinkClosed: the link has ended.
        """


class UdpLink(Link):
    """UDP from any sender; answers go to the sender.

    Args:
        udp: the socket.
        known: address to send to before anything arrives.
    """

    is_datagrams = True

    def __init__(self, udp: anyio.abc.UDPSocket, known: tuple[Source, ...] = ()) -> None:
        self._udp = udp
        self.known = known

    async def receive(self) -> tuple[bytes, Source]:
        """Return the next datagram."""
        try:
            return await self._udp.receive()
        except (anyio.ClosedResourceError, anyio.BrokenResourceError, OSError) as error:
            raise LinkClosed(str(error)) from error

    async def send(self, data: bytes, source: Source) -> None:
        """Send a datagram. One that the network rejects is lost, like others of UDP."""
        assert isinstance(source, tuple)
        host, port = source[:2]
        try:
            await self._udp.sendto(data, host, port)
        except anyio.ClosedResourceError as error:
            raise LinkClosed(str(error)) from error
        except OSError:
            return  # Unreachable now; the protocols repeat what matters.


class TcpLink(Link):
    """TCP to a vehicle or a router."""

    known = (STREAM,)

    def __init__(self, tcp: anyio.abc.SocketStream) -> None:
        self._tcp = tcp

    async def receive(self) -> tuple[bytes, Source]:
        """Return the next bytes of the stream."""
        try:
            return await self._tcp.receive(_READ_BYTES), STREAM
        except (anyio.EndOfStream, anyio.BrokenResourceError, anyio.ClosedResourceError) as error:
            raise LinkClosed("the other side closed the connection") from error

    async def send(self, data: bytes, source: Source) -> None:
        """Send bytes."""
        try:
            await self._tcp.send(data)
        except (anyio.BrokenResourceError, anyio.ClosedResourceError) as error:
            raise LinkClosed("the other side closed the connection") from error


class SerialLink(Link):
    """Serial port, read and written in threads."""

    known = (STREAM,)

    def __init__(self, port: serial.Serial) -> None:
        self._port = port

    async def receive(self) -> tuple[bytes, Source]:
        """Return the next bytes of the port."""
        while True:
            data = await anyio.to_thread.run_sync(self._read)
            if data:
                return data, STREAM

    async def send(self, data: bytes, source: Source) -> None:
        """Write bytes."""
        try:
            await anyio.to_thread.run_sync(self._port.write, data)
        except OSError as error:  # Those of pyserial are OSErrors.
            raise LinkClosed(str(error)) from error

    def _read(self) -> bytes:
        try:
            return bytes(self._port.read(max(1, self._port.in_waiting)))
        except (OSError, TypeError) as error:  # A TypeError, if it is closed while it is read.
            raise LinkClosed(str(error)) from error


@asynccontextmanager
async def open_link(address: LinkAddress) -> AsyncIterator[Link]:
    """Open a link, and close it at the end of the block.

    Raises:
        OSError: the address cannot be used now.
    """
    match address.kind:
        case "listen" | "udp":
            is_remote = address.kind == "udp"
            is_v6 = ":" in address.host
            known: tuple[Source, ...] = ()
            if is_remote:
                found = await anyio.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM)
                is_v6 = found[0][0] == socket.AF_INET6
                known = (found[0][4][:2],)
            async with await anyio.create_udp_socket(
                socket.AF_INET6 if is_v6 else socket.AF_INET,
                local_host=None if is_remote else address.host,
                local_port=0 if is_remote else address.port,
            ) as udp:
                yield UdpLink(udp, known)
        case "tcp":
            async with await anyio.connect_tcp(address.host, address.port) as tcp:
                yield TcpLink(tcp)
        case "serial":
            import serial

            port = await anyio.to_thread.run_sync(
                lambda: serial.Serial(address.host, address.port, timeout=_SERIAL_SECONDS)
            )
            try:
                yield SerialLink(port)
            finally:
                port.close()
