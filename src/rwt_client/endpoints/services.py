"""Services: calling and offering them."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import msgspec

from rwt_client.errors import ConnectionLost
from rwt_participant.errors import (
    CallFailed,
    CallTimeout,
    ProviderNotFound,
    ServiceFailed,
)
from rwt_participant.future import Future
from rwt_protocol.ops import CallService, ServiceResponse
from rwt_protocol.payloads import Decoded, Encodable, RawJson

if TYPE_CHECKING:
    from rwt_client.wire.session import ReconnectingSession

logger = logging.getLogger("rwt_client")

_TIMEOUT = "Timeout exceeded while waiting for service response"


class WireCall:
    """Pending call."""

    def __init__(self, calls: Calls, service: str, args: RawJson, repeat: bool) -> None:
        self.id = calls.session.next_id("call_service", service)
        self.outcome: Future[Encodable] = Future()
        self._calls = calls
        self._service = service
        self._args = args
        self._repeat = repeat

    def restore(self) -> None:
        if not self.outcome.done:
            self._calls.session.send(CallService(service=self._service, args=self._args, id=self.id))

    def lost(self, error: ConnectionLost, final: bool) -> None:
        if final or not self._repeat:
            self.outcome.set(type(error)(f"{error}, before {self._service} answered"))

    def refused(self, text: str) -> None:
        self.outcome.set(call_error(text, self._service))


class Calls:
    """Pending calls of a client."""

    def __init__(self, session: ReconnectingSession) -> None:
        self.session = session

    async def call(
        self,
        service: str,
        args: RawJson,
        timeout: float | None,
        *,
        repeat: bool = False,
    ) -> Encodable:
        """Call a service, and return the response undecoded.

        Args:
            timeout: seconds; None waits without limit.
            repeat: wait for a connection if there is none, and call again if it is lost before the answer.

        Raises:
            ServiceFailed: the server reports failure; with its text. ProviderNotFound: the service does not
                exist.
            CallTimeout: there was no answer in time.
            ConnectionLost: the connection was lost first.
        """
        call = WireCall(self, service, args, repeat)
        self.session.add(call.id, call)
        try:
            if self.session.connected or not repeat:
                call.restore()
            return await call.outcome.get(timeout, f"{service} gave no answer")
        finally:
            self.session.remove(call.id)

    def on_response(self, _: None, op: ServiceResponse) -> None:
        """End a call with its response (SRV-14)."""
        call = self.session.find(op.id)
        if not isinstance(call, WireCall):
            logger.debug("an answer of %s comes too late or was not asked for", op.service)
        elif op.result:
            call.outcome.set(RawJson(b"{}") if isinstance(op.values, str) else op.values)
        else:
            text = failure_text(op.values, f"{op.service} failed and gave no reason")
            call.outcome.set(call_error(text, op.service))


def call_error(text: str, name: str, otherwise: type[CallFailed] = ServiceFailed) -> CallFailed:
    """Return the error of a call or goal, derived from two texts that all rosbridge servers use (SRV-05)."""
    if text in (f"Service {name} does not exist", f"Action {name} does not exist"):
        return ProviderNotFound(text)
    return CallTimeout(text) if text == _TIMEOUT else otherwise(text)


def failure_text(values: Encodable | str, otherwise: str) -> str:
    """Return the server's reason for a failure (SRV-05)."""
    if isinstance(values, str):
        text = values
    elif isinstance(values, Decoded):
        text = msgspec.json.encode(values.value, enc_hook=repr).decode()
    else:
        data = values.data if isinstance(values, RawJson) else values.json()
        text = bytes(data).decode("utf-8", "replace")
    return otherwise if text in ("", "{}", "null") else text
