"""Transports: WebSocket with HTTP, TCP, Unix sockets, UDP, WebRTC and standard streams. They know no op of
the protocol.

Names are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt_transports.api import OversizeAware as OversizeAware
    from rwt_transports.endpoint import Accept as Accept
    from rwt_transports.endpoint import DropReason as DropReason
    from rwt_transports.endpoint import Endpoint as Endpoint
    from rwt_transports.endpoint import Flow as Flow
    from rwt_transports.endpoint import FlowRules as FlowRules
    from rwt_transports.endpoint import PeerInfo as PeerInfo
    from rwt_transports.endpoint import Sink as Sink
    from rwt_transports.endpoint import Traffic as Traffic
    from rwt_transports.errors import BadUrl as BadUrl
    from rwt_transports.errors import ListenError as ListenError
    from rwt_transports.errors import Refused as Refused
    from rwt_transports.errors import TransportError as TransportError
    from rwt_transports.http.routes import Audience as Audience
    from rwt_transports.http.routes import HttpExtension as HttpExtension
    from rwt_transports.http.routes import HttpRequest as HttpRequest
    from rwt_transports.http.routes import HttpResponse as HttpResponse
    from rwt_transports.http.routes import Reader as Reader
    from rwt_transports.http.routes import Route as Route
    from rwt_transports.http.routes import Routes as Routes
    from rwt_transports.limits import Limits as Limits
    from rwt_transports.listener import Listener as Listener
    from rwt_transports.listener import listen as listen

__all__, __getattr__, __dir__ = exports(
    __name__,
    {
        "rwt_transports.listener": "listen Listener",
        "rwt_transports.limits": "Limits",
        "rwt_transports.endpoint": "Accept Endpoint Sink Flow FlowRules PeerInfo Traffic DropReason",
        "rwt_transports.http.routes": "Routes HttpRequest HttpResponse HttpExtension Route Audience Reader",
        "rwt_transports.api": "OversizeAware",
        "rwt_transports.errors": "TransportError BadUrl ListenError Refused",
    },
)
