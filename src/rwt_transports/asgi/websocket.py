"""Link to a WebSocket of an ASGI server: one task reads, one writes."""

from __future__ import annotations

from rwt_transports.asgi.messages import BINARY, CLOSE, HEADER, TEXT, KindCutter, close_bytes, close_of
from rwt_transports.asgi.types import Receive, Send
from rwt_transports.drivers.task_link import TaskLink
from rwt_transports.websocket.close_codes import NO_STATUS, may_travel


class AsgiLink(TaskLink):
    """Accepted WebSocket of one scope.

    What the writing task awaits is the server's own backpressure: while it waits, the connection's outbox
    keeps what is new, by its bounds.

    Args:
        receive: of the scope.
        send: of the scope.
    """

    __slots__ = ("_receive", "_send")

    def __init__(self, receive: Receive, send: Send) -> None:
        super().__init__()
        self._receive = receive
        self._send = send

    def finish(self) -> None:
        """Close: a WebSocket has no half that could stay open."""
        self.close()

    async def _read(self) -> None:
        receive = self._callbacks.receive
        while True:
            await self._reading.wait()
            event = await self._receive()
            if event["type"] == "websocket.receive":
                text = event.get("text")
                # surrogatepass: a server that decodes leniently must not cost the connection.
                data = event["bytes"] if text is None else text.encode("utf-8", "surrogatepass")
                receive(HEADER.pack(BINARY if text is None else TEXT, len(data)))
                receive(data)
            elif event["type"] == "websocket.disconnect":
                code = event.get("code") or NO_STATUS
                data = close_bytes(code, event.get("reason") or "")
                receive(HEADER.pack(CLOSE, len(data)))
                receive(data)
                self.close()
                return

    async def _write(self) -> None:
        cutter = KindCutter(self._callbacks.take)
        while not self._closing:
            await self._woken()
            while (message := cutter.next_of_kind()) is not None:
                kind, data = message
                if kind == CLOSE:
                    await self._say_goodbye(*close_of(data))
                    return
                try:
                    await self._send(_event(kind, data))
                except OSError:  # The client has gone; the specification lets servers say so.
                    return
                self._callbacks.progress()

    async def _say_goodbye(self, code: int, reason: str) -> None:
        code = code if may_travel(code) else 1000
        try:
            await self._send({"type": "websocket.close", "code": code, "reason": reason})
        except (OSError, RuntimeError):  # It has gone already, as some servers put it.
            return


def _event(kind: int, data: bytes) -> dict[str, object]:
    if kind == BINARY:
        return {"type": "websocket.send", "bytes": data}
    return {"type": "websocket.send", "text": data.decode("utf-8", "replace")}
