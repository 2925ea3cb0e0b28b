"""Transports: WebSocket with HTTP, TCP, Unix sockets, UDP, WebRTC and standard streams. They know no op of
the protocol.

Names are imported on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
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

_HOMES: Final = {
    name: module
    for module, names in {
        "rwt_transports.api": "OversizeAware",
        "rwt_transports.endpoint": "Accept DropReason Endpoint Flow FlowRules PeerInfo Sink Traffic",
        "rwt_transports.errors": "BadUrl ListenError Refused TransportError",
        "rwt_transports.http.routes": "Audience HttpExtension HttpRequest HttpResponse Reader Route Routes",
        "rwt_transports.limits": "Limits",
        "rwt_transports.listener": "Listener listen",
    }.items()
    for name in names.split()
}
"""Module of each public name."""

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


def __getattr__(name: str) -> object:
    """Import a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """Return all public names, imported or not, for completion."""
    return sorted({*globals(), *__all__})
