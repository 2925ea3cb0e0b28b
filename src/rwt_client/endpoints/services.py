"""Calls of services."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from rwt_client.errors import ConnectionLost
from rwt_participant.errors import CallFailed, CallTimeout, ProviderNotFound, ServiceFailed
from rwt_participant.future import Future
from rwt_protocol.ops import CallService, ServiceResponse
from rwt_protocol.payloads import Decoded, Encodable, RawJson

if TYPE_CHECKING:
    from rwt_client.wire.session import ReconnectingSession

_TIMEOUT = "Timeout exceeded while waiting for service response"


class WireCall:
    """Pending call."""

    def __init__(self, session: ReconnectingSession, service: str, args: RawJson, repeat: bool) -> None:
        self.id = session.next_id("call_service", service)
        self.outcome: Future[Encodable] = Future()
        self._session = session
        self._service = service
        self._args = args
        self._repeat = repeat

    def restore(self) -> None:
        if not self.outcome.done:
            self._session.send(CallService(service=self._service, args=self._args, id=self.id))

    def lost(self, error: ConnectionLost, final: bool) -> None:
        if final or not self._repeat:
            self.outcome.set(type(error)(f"{error}, before {self._service} answered"))

    def refused(self, text: str) -> None:
        self.outcome.set(call_error(text, self._service))

    def receive(self, op: ServiceResponse) -> None:
        """End the call with its response (SRV-14)."""
        if op.result:
            self.outcome.set(RawJson(b"{}") if isinstance(op.values, str) else op.values)
        else:
            text = failure_text(op.values, f"{op.service} failed and gave no reason")
            self.outcome.set(call_error(text, op.service))


async def call_service(
    session: ReconnectingSession,
    service: str,
    args: RawJson,
    timeout: float | None,
    *,
    repeat: bool = False,
) -> Encodable:
    """Call a service, and return the response undecoded; see :meth:`rwt_client.robot.Robot.call`.

    Raises:
        ServiceFailed: the server reports failure; with its text.
        ProviderNotFound: the service does not exist.
        CallTimeout: there was no answer in time.
        ConnectionLost: the connection was lost first.
    """
    pending = WireCall(session, service, args, repeat)
    session.add(pending.id, pending)
    try:
        if session.connected or not repeat:
            pending.restore()
        return await pending.outcome.get(timeout, f"{service} gave no answer")
    finally:
        session.remove(pending.id)


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
