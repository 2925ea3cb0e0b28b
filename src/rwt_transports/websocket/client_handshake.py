"""Client side of a WebSocket's opening handshake (RFC 6455 section 4.1), without I/O."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from websockets.client import ClientProtocol
from websockets.http11 import Response
from websockets.typing import Subprotocol
from websockets.uri import WebSocketURI

from rwt_transports.errors import ConnectError

_quiet = logging.getLogger("rwt_transports.websocket.client_handshake")

_END_OF_HEAD = b"\r\n\r\n"
_MOST_HEAD_BYTES = 64 * 1024
_SWITCHING = b"101"
_SUBPROTOCOLS = "Sec-WebSocket-Protocol"


class ClientHandshake:
    """Opening handshake of a client.

    Attributes:
        request: request to send first.
    """

    def __init__(self, target: WebSocketURI, headers: Mapping[str, str]) -> None:
        self._where = f"{target.host}:{target.port}"
        given = dict(headers)
        offered = [Subprotocol(each.strip()) for each in given.pop(_SUBPROTOCOLS, "").split(",") if each]
        self._protocol = ClientProtocol(target, subprotocols=offered or None, logger=_quiet)
        request = self._protocol.connect()
        for name, value in given.items():
            request.headers[name] = value
        self._protocol.send_request(request)
        self.request = b"".join(self._protocol.data_to_send())
        self._head = b""
        self._silent = True
        self._refusal = False

    def feed(self, data: bytes) -> bytes | None:
        """Read received bytes.

        Returns:
            None while the answer is not complete; then what follows it, which belongs to the wire.

        Raises:
            ConnectError: the server does not open a WebSocket here, with the reason that it gave.
        """
        self._silent = False
        if self._refusal:
            self._protocol.receive_data(data)
            self._refused()
            return None
        self._head += data
        head, found, rest = self._head.partition(_END_OF_HEAD)
        if not found:
            if len(head) > _MOST_HEAD_BYTES:
                raise ConnectError(f"{self._where} does not speak WebSocket: its answer has no end")
            return None
        # The library gets the head alone: it would read the frames behind it, which belong to the wire.
        if head.split(b" ", 2)[1:2] == [_SWITCHING]:
            self._protocol.receive_data(head + found)
            if self._protocol.handshake_exc is not None:
                raise ConnectError(f"{self._where} answers the WebSocket handshake wrongly")
            return rest
        # A refusal: its body with the reason may still be arriving.
        self._refusal = True
        self._protocol.receive_data(self._head)
        self._refused()
        return None

    def eof(self) -> None:
        """Fail: the server hung up.

        Raises:
            ConnectError: always; with the server's reason if there was one.
        """
        if not self._silent:
            self._protocol.receive_eof()
            self._refused()
        raise ConnectError(f"{self._where} hung up during the WebSocket handshake", "hung_up")

    def _refused(self) -> None:
        for event in self._protocol.events_received():
            if isinstance(event, Response):
                # A server of any kind may answer: 200 characters of it are enough for one line of an error.
                said = (event.body or b"").decode("utf-8", "replace").strip()[:200]
                is_page = "html" in event.headers.get("Content-Type", "") or said.startswith("<")
                text = f": {said}" if said and not is_page else f" {event.reason_phrase}".rstrip()
                cause = ConnectError.cause_of(event.status_code)
                raise ConnectError(f"{self._where} answers {event.status_code}{text}", cause)
        if self._protocol.handshake_exc is not None:
            raise ConnectError(f"{self._where} does not speak WebSocket", "hung_up")
