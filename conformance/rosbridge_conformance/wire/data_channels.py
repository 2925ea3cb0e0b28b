"""Connections over WebRTC data channels: an HTTP offer, and a channel for each connection.

They share one peer connection, because each channel is a separate client. Needs aiortc.
"""

from __future__ import annotations

import asyncio
import urllib.error
import urllib.request
from urllib.parse import urlsplit, urlunsplit

from aiortc import RTCConfiguration, RTCDataChannel, RTCPeerConnection, RTCSessionDescription

from rosbridge_conformance.wire.wires import Wire, WireClosed, WireError

_OPEN_SECONDS = 20.0
_PATH = "/webrtc"


class DataChannelWire:
    """One data channel."""

    def __init__(self, channel: RTCDataChannel) -> None:
        self._channel = channel
        self._received: asyncio.Queue[str | bytes | None] = asyncio.Queue()
        channel.on("message", self._received.put_nowait)
        channel.on("close", lambda: self._received.put_nowait(None))

    async def send(self, data: str | bytes) -> None:
        """Send one message: text, or bytes as a binary message. Raises WireClosed."""
        if self._channel.readyState != "open":
            raise WireClosed(0)
        self._channel.send(data)

    async def receive(self) -> str | bytes:
        """Return the next message. Raises WireClosed at the end."""
        received = await self._received.get()
        if received is None:
            self._received.put_nowait(None)
            raise WireClosed(0)
        return received

    async def close(self, *, abruptly: bool = False) -> None:
        """Close the channel."""
        self._channel.close()


class DataChannels:
    """A peer connection to one server.

    Args:
        url: URL of the server, `webrtc+http://` or `webrtc+https://`.
    """

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        path = parts.path.rstrip("/") + _PATH
        self._url = url
        self._http = urlunsplit((parts.scheme.removeprefix("webrtc+"), parts.netloc, path, parts.query, ""))
        self._peer: RTCPeerConnection | None = None
        self._opening = asyncio.Lock()

    async def dial(self, tag: str) -> Wire:
        """Open a channel. Raises WireError."""
        async with self._opening:
            try:
                async with asyncio.timeout(_OPEN_SECONDS):
                    return DataChannelWire(await self._open())
            except TimeoutError as error:
                raise WireError(f"{self._url}: cannot connect: no path was found") from error

    async def close(self) -> None:
        """End the peer connection."""
        peer, self._peer = self._peer, None
        if peer is not None:
            await peer.close()

    async def _open(self) -> RTCDataChannel:
        if self._peer is not None and self._peer.connectionState in ("closed", "failed"):
            await self.close()
        peer = self._peer
        if peer is None:
            peer = self._peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
            channel = peer.createDataChannel("rosbridge")
            await self._connect(peer)
        else:
            channel = peer.createDataChannel("rosbridge")
        opened = asyncio.Event()
        channel.on("open", opened.set)
        if channel.readyState != "open":
            await opened.wait()
        return channel

    async def _connect(self, peer: RTCPeerConnection) -> None:
        await peer.setLocalDescription()
        try:
            answer = await asyncio.to_thread(_post, self._http, peer.localDescription.sdp)
        except urllib.error.HTTPError as error:
            with error:
                raise WireError(f"{self._url}: cannot connect: {self._http} answers {error.code}") from error
        except OSError as error:
            raise WireError(f"{self._url}: cannot connect: the connection was refused") from error
        await peer.setRemoteDescription(RTCSessionDescription(answer, "answer"))


def _post(url: str, offer: str) -> str:
    request = urllib.request.Request(
        url, offer.encode(), {"Content-Type": "application/sdp", "Accept": "application/sdp"}
    )
    with urllib.request.urlopen(request, timeout=_OPEN_SECONDS) as answer:
        text: str = answer.read().decode()
    return text
