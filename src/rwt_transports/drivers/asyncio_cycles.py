"""Reference cycles of asyncio's socket transports, which are kept where garbage is rarely collected.

A transport refers to bound methods of itself. `close()` clears them from Python 3.12 on, but not if the peer
resets the connection or a TLS handshake fails.
"""

from __future__ import annotations

import asyncio.selector_events
from functools import wraps
from typing import Any, Final

_OWN_METHODS: Final = ("_read_ready_cb", "_write_ready")


def cut_cycles() -> None:
    """Clear these references of every transport of this process when its connection is lost; idempotent."""
    transports: Any = asyncio.selector_events._SelectorSocketTransport  # type: ignore[attr-defined]  # private
    lost = transports._call_connection_lost
    if hasattr(lost, "__wrapped__"):
        return

    @wraps(lost)
    def lose(transport: Any, error: Exception | None) -> None:
        try:
            lost(transport, error)
        finally:
            for name in _OWN_METHODS:
                vars(transport).pop(name, None)

    transports._call_connection_lost = lose
