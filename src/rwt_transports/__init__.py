"""Transports: bytes and frames over WebSocket, with plain HTTP on the same port. Knows no op of the
protocol."""

from __future__ import annotations

from .api import Listener, OversizeAware
from .errors import BadUrl, ListenError, Refused, TransportError
from .http import HttpRequest, HttpResponse, Routes
from .limits import Limits
from .listener import listen

__all__ = [
    "listen",
    "Listener",
    "Limits",
    "Routes",
    "HttpRequest",
    "HttpResponse",
    "OversizeAware",
    "TransportError",
    "BadUrl",
    "ListenError",
    "Refused",
]
