"""URLs of robots that are reached over WebRTC, with the signalling over HTTP."""

from __future__ import annotations

from typing import Final

from rwt_protocol.extensions import imported_on_call
from rwt_transports.api import Connector
from rwt_transports.schemes import Scheme

_whole_messages = imported_on_call("rwt_transports.wires.whole_messages:MessageWire")

_INSTEAD: Final = (
    "WebRTC is reached through the port of ws:// or wss://, with the setting `webrtc.enabled` (--webrtc)"
)


def _connector() -> Connector:
    from rwt_webrtc.transport.connector import DataChannelConnector  # Imports aiortc.

    return DataChannelConnector()


HTTP: Final = Scheme(
    "webrtc+http://127.0.0.1:9090",
    client_wire=_whole_messages,
    connector=_connector,
    binary=True,
    instead=_INSTEAD,
)

HTTPS: Final = Scheme(
    "webrtc+https://robot.example",
    client_wire=_whole_messages,
    connector=_connector,
    binary=True,
    tls=True,
    connect_port=443,
    instead=_INSTEAD,
)
