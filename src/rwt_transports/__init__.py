"""Transports: bytes and frames over WebSocket with plain HTTP beside it, over TCP, Unix sockets, UDP and
standard input and output. Knows no op of the protocol."""

from __future__ import annotations

from rwt_transports.api import OversizeAware
from rwt_transports.endpoint import Accept, DropReason, Endpoint, Flow, FlowRules, PeerInfo, Sink, Traffic
from rwt_transports.errors import BadUrl, ListenError, Refused, TransportError
from rwt_transports.http.routes import (
    Audience,
    HttpExtension,
    HttpRequest,
    HttpResponse,
    Reader,
    Route,
    Routes,
)
from rwt_transports.limits import Limits
from rwt_transports.listener import Listener, listen

__all__ = [
    "listen",
    "Listener",
    "Limits",
    "Accept",
    "Endpoint",
    "Sink",
    "Flow",
    "FlowRules",
    "PeerInfo",
    "Traffic",
    "DropReason",
    "Routes",
    "HttpRequest",
    "HttpResponse",
    "HttpExtension",
    "Route",
    "Audience",
    "Reader",
    "OversizeAware",
    "TransportError",
    "BadUrl",
    "ListenError",
    "Refused",
]
