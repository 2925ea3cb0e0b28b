"""Memory of TLS connections on asyncio.

asyncio reserves 256 KiB of receive buffer per connection, and buffers another 256 KiB of unread bytes that it
never shrinks: half a megabyte for each connection, even if it is idle.
"""

from __future__ import annotations

import asyncio
import asyncio.sslproto
from typing import Final, cast
from weakref import WeakKeyDictionary

RECEIVED_BYTES: Final = 32 * 1024
"""Maximum size of one read: two of TLS's largest records."""

ENCRYPTED_BYTES: Final = 32 * 1024
"""Maximum size of one write."""

_buffers: Final[WeakKeyDictionary[asyncio.AbstractEventLoop, memoryview]] = WeakKeyDictionary()


def spare_buffers(transport: asyncio.Transport) -> None:
    """Share one receive buffer in an event loop after the handshake, and pause reading while bytes wait
    undecrypted.

    asyncio's protocol below the transport is private: other implementations (uvloop, Windows) keep their own
    buffer.
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
    cast("asyncio.sslproto._SSLProtocolTransport", transport).set_read_buffer_limits(high=1, low=0)


def forget_protocol(transport: asyncio.Transport) -> None:
    """Remove the reference of a closed TLS transport to the protocol above it."""
    if isinstance(getattr(transport, "_ssl_protocol", None), asyncio.sslproto.SSLProtocol):
        transport.set_protocol(_NOBODY)


_NOBODY: Final = asyncio.BufferedProtocol()
