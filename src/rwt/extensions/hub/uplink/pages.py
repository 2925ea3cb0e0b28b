"""HTTP over a stream of an uplink: a request of the hub, and the response of the robot.

The opening of the stream names the request (:mod:`rwt.extensions.hub.uplink.openings`); its body, if it has
one, is the first message of the hub. The robot answers with a head, a text message, and with the body in
binary messages, of which the last is followed by the end of the stream with 1000. Images and endless streams
are sent the same way, and a slow reader slows down the robot.
"""

from __future__ import annotations

from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from dataclasses import replace
from typing import ClassVar, Final, Literal

import anyio

from rwt.extensions.hub.uplink.openings import BadOpening, decode_head, encode_head
from rwt_protocol.frames import Frame
from rwt_transports.api import FlowControl
from rwt_transports.endpoint import Sink
from rwt_transports.errors import log_exception
from rwt_transports.http.connection import close_iterator
from rwt_transports.http.routes import HttpRequest, HttpResponse, Routes
from rwt_transports.websocket.close_codes import GOING_AWAY, NORMAL, POLICY, PROTOCOL_ERROR

WITHOUT_BODY: Final = frozenset({204, 205, 304})
"""Status codes of responses that never have a body (RFC 9110 section 6.4.1)."""

PIECE_BYTES: Final = 64 * 1024
"""Maximum size of a piece of a body."""

INBOX_BYTES: Final = 256 * 1024
"""Bytes of a page that wait for its reader before the robot is held back."""

#: Headers of one connection, which are not forwarded (RFC 9110 section 7.6.1).
_OF_THE_CONNECTION: Final = frozenset(
    {
        "connection", "content-length", "keep-alive", "proxy-connection", "te", "trailer",
        "transfer-encoding", "upgrade",
    }
)  # fmt: skip


def end_to_end(headers: Mapping[str, str]) -> dict[str, str]:
    """Return the headers that are forwarded."""
    return {name: value for name, value in headers.items() if name.lower() not in _OF_THE_CONNECTION}


# -- at the robot --------------------------------------------------------------------------------------------


class PageServer:
    """Robot's end of a stream for a request.

    Args:
        body_size: size of the request's body, which follows; 0 for none.
    """

    def __init__(self, sink: Sink, routes: Routes, request: HttpRequest, body_size: int) -> None:
        self._sink = sink
        self._routes = routes
        self._request = request
        self._body_size = body_size
        self._flow_control: FlowControl | None = None
        # Created by `run`: anyio does not recognise the event loop inside asyncio's callbacks.
        self._scope: anyio.CancelScope | None = None
        self._complete: anyio.Event | None = None
        self._closed = False

    def set_flow_control(self, flow_control: FlowControl) -> None:
        self._flow_control = flow_control

    def receive(self, data: bytes, binary: bool) -> None:
        """Receive the body of the request."""
        if not self._body_size or len(data) != self._body_size:
            self._sink.close(POLICY, f"expected a body of {self._body_size} bytes and nothing else")
            return
        self._body_size = 0
        self._request = replace(self._request, body=data)
        if self._complete is not None:
            self._complete.set()

    def closed(self, code: int, reason: str) -> None:
        """Cancel the page: the hub discards the rest."""
        self._closed = True
        if self._scope is not None:
            self._scope.cancel()

    async def run(self) -> None:
        """Send the response, until it is complete or the hub ends the stream."""
        if self._closed:
            return
        with anyio.CancelScope() as self._scope:
            try:
                if self._body_size:
                    self._complete = anyio.Event()
                    await self._complete.wait()
                await self._send(await self._answer())
                self._sink.close(NORMAL, "")
            except Exception:
                log_exception("the answer to %s, for a hub, failed", self._request.path)
                self._sink.close(GOING_AWAY, "internal error")

    async def _answer(self) -> HttpResponse:
        handler = self._routes.find(self._request.method, self._request.path)
        if isinstance(handler, HttpResponse):
            return handler
        answer = handler(self._request)
        return await answer if isinstance(answer, Awaitable) else answer

    async def _send(self, response: HttpResponse) -> None:
        headers = end_to_end(response.headers)
        self._sink.send(Frame(encode_head(response.status, response.content_type, headers)))
        body = response.body
        if isinstance(body, bytes):
            await self._send_piece(body)
            return
        try:
            async for chunk in body:
                await self._send_piece(chunk)
        finally:
            await close_iterator(body)

    async def _send_piece(self, data: bytes) -> None:
        """Send a piece of the body, limited by the hub's reading."""
        for begin in range(0, len(data), PIECE_BYTES):
            self._sink.send(Frame(data[begin : begin + PIECE_BYTES], binary=True))
            taken = anyio.Event()
            if self._flow_control is not None:
                self._flow_control.when_empty(taken.set)
                await taken.wait()


# -- at the hub ----------------------------------------------------------------------------------------------


class PageInbox:
    """Endpoint of the hub's end of the stream: receives one page."""

    holds_wire: ClassVar[Literal[True]] = True

    def __init__(self) -> None:
        self._messages: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._changed = anyio.Event()
        self._flow_control: FlowControl | None = None
        self._ended: tuple[int, str] | None = None

    def set_flow_control(self, flow_control: FlowControl) -> None:
        self._flow_control = flow_control

    def receive(self, data: bytes, binary: bool) -> None:
        self._messages.append(data)
        self._waiting_bytes += len(data)
        if self._waiting_bytes >= INBOX_BYTES and self._flow_control is not None:
            self._flow_control.pause()
        self._changed.set()

    def closed(self, code: int, reason: str) -> None:
        """End the page: the robot has sent everything, or is disconnected."""
        self._ended = (code, reason)
        self._changed.set()

    def drop(self, code: int, reason: str) -> None:
        """Drop what is unread, and break off."""
        self._messages.clear()
        self.closed(code, reason)

    async def next(self) -> bytes | None:
        """Return the next message; None at the end."""
        while not self._messages:
            if self._ended is not None:
                return None
            self._changed = anyio.Event()
            await self._changed.wait()
        message = self._messages.popleft()
        self._waiting_bytes -= len(message)
        if not self._messages and self._flow_control is not None and self._ended is None:
            self._flow_control.resume()
        return message

    async def response(
        self, left: Callable[[int, str], None], seconds: float, *, head_only: bool
    ) -> HttpResponse:
        """Return the robot's response, whose body is read as it arrives.

        Args:
            left: called once the reader has disconnected, with a close code and a reason.
            seconds: timeout for the head of the response, and for the end of one without a body.
            head_only: True if no body is requested.
        """
        try:
            with anyio.fail_after(seconds):
                head = await self.next()
                if head is None:
                    reason = self.ended[1]
                    return HttpResponse(f"{reason or 'the robot is gone'}\n".encode(), 503)
                status, content_type, headers = decode_head(head)
                if status in WITHOUT_BODY and await self.next() is not None:
                    raise BadOpening(f"a response of status {status} has no body")
        except TimeoutError:
            left(GOING_AWAY, "the page took too long")
            return HttpResponse(f"the robot did not answer within {seconds:g} s\n".encode(), 504)
        except BadOpening as error:
            left(PROTOCOL_ERROR, str(error))
            return HttpResponse(b"the robot's answer cannot be read\n", 502)
        except BaseException:
            left(GOING_AWAY, "the request was abandoned")
            raise
        if head_only or status in WITHOUT_BODY:
            left(NORMAL, "")
            return HttpResponse(b"", status, content_type, end_to_end(headers))
        return HttpResponse(_Body(self, left), status, content_type, end_to_end(headers))

    @property
    def ended(self) -> tuple[int, str]:
        return self._ended or (GOING_AWAY, "")


class _Body(AsyncIterator[bytes]):
    """Body of a page; can be closed at any time."""

    def __init__(self, inbox: PageInbox, left: Callable[[int, str], None]) -> None:
        self._inbox = inbox
        self._left = left

    async def __anext__(self) -> bytes:
        message = await self._inbox.next()
        if message is not None:
            return message
        code, reason = self._inbox.ended
        if code != NORMAL:
            raise ConnectionError(f"the page broke off: {code} {reason}")
        raise StopAsyncIteration

    async def aclose(self) -> None:
        self._left(NORMAL, "")
