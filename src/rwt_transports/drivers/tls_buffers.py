"""Memory of TLS connections on asyncio.

asyncio gives each connection a buffer of 256 KiB for what comes from the network, and lets another 256 KiB
wait undeciphered where nobody reads, in a buffer that never shrinks again. For a server that many may connect
to, that is half a megabyte for each of them, whether they say anything or not.
"""

from __future__ import annotations

import asyncio
import asyncio.sslproto
from typing import Final
from weakref import WeakKeyDictionary

RECEIVED_BYTES: Final = 32 * 1024
"""Taken from the network at once: two of TLS's largest records."""

ENCRYPTED_BYTES: Final = 32 * 1024
"""Written at once."""

_buffers: Final[WeakKeyDictionary[asyncio.AbstractEventLoop, memoryview]] = WeakKeyDictionary()


def spare_buffers(transport: asyncio.Transport) -> None:
    """Let a connection whose handshake is done receive in a buffer that all of its event loop share, and read
    nothing more from the network while something waits undeciphered.

    The protocol that asyncio puts beneath the transport is no public part of it: where it is another one, as
    on uvloop, or where its loop fills buffers while others run, as on Windows, the connection keeps its own.
    """
    loop = asyncio.get_running_loop()
    protocol = getattr(transport, "_ssl_protocol", None)
    if (
        not isinstance(loop, asyncio.SelectorEventLoop)
        or not isinstance(protocol, asyncio.sslproto.SSLProtocol)
        or not hasattr(protocol, "_ssl_buffer_view")
    ):
        return
    shared = _buffers.get(loop)
    if shared is None:
        shared = _buffers[loop] = memoryview(bytearray(RECEIVED_BYTES))
    vars(protocol).update(max_size=RECEIVED_BYTES, _ssl_buffer=shared.obj, _ssl_buffer_view=shared)
    transport.set_read_buffer_limits(high=1, low=0)  # type: ignore[attr-defined]  # those in TLS have it


def forget_protocol(transport: asyncio.Transport) -> None:
    """Let a transport in TLS that is closed refer to the protocol above it no more."""
    if isinstance(getattr(transport, "_ssl_protocol", None), asyncio.sslproto.SSLProtocol):
        transport.set_protocol(_NOBODY)


_NOBODY: Final = asyncio.BufferedProtocol()
