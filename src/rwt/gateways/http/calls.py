"""Calls of services: those that require human approval are resources, so that their clients need not wait."""

from __future__ import annotations

import re
from functools import partial
from typing import TYPE_CHECKING, Final
from uuid import uuid4

import anyio

from rwt.access.errors import QuotaExceeded
from rwt.gateways.http.problems import HttpProblem
from rwt.gateways.http.representations import value_response
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rwt.access.gate.approvals import Approval
    from rwt.access.quotas import Charge
    from rwt.gateways.http.clients import HttpClient
    from rwt.gateways.http.settings import HttpSettings
    from rwt_graph.api import PendingCall
    from rwt_interfaces.structs import ServiceType
    from rwt_participant.timers import Timer
    from rwt_transports.http.routes import HttpRequest, HttpResponse

PATH: Final = "/api/services/"

NOTICE: Final = "Gate-Notice"
"""Header of a response with the gate's notices about the request, such as clamping."""

WAITING: Final = "waiting"
"""State of a call or goal that waits for human approval."""

#: Preference of RFC 7240: seconds that a client is willing to wait.
_WAIT: Final = re.compile(r"(?:^|[,;\s])wait\s*=\s*\"?(\d{1,9})\"?", re.IGNORECASE)


def preferred_wait(request: HttpRequest, most: float) -> float:
    """Return the seconds of ``Prefer: wait=SECONDS`` (RFC 7240), at most `most`; 0 without it."""
    found = _WAIT.search(request.headers.get("prefer", ""))
    return min(float(found[1]), most) if found else 0.0


def notice_headers(notices: Sequence[str]) -> Mapping[str, str]:
    """Return the headers with the gate's notices about a request."""
    return {NOTICE: "; ".join(notices).encode("ascii", "backslashreplace").decode()} if notices else {}


def approval_body(approval: Approval) -> dict[str, object]:
    """Return a pending request for approval as clients see it."""
    return {"id": approval.id, "roles": approval.approvers, "seconds_left": approval.seconds_left}


class HttpCall:
    """Call of a service, from sending it until its outcome is read.

    A call that requires approval may outlive its request: :meth:`HttpCalls.keep` makes it a resource.

    Attributes:
        id: 32 hex digits.
        client: client that calls.
        service: absolute name of the service.
        outcome: response or error; None while the call is pending.
        notices: notices of the gate about the request, such as clamping.
        on_end: called with the outcome; set by :class:`HttpCalls`.

    Args:
        client: client that calls.
        service: absolute name of the service.
    """

    def __init__(self, client: HttpClient, service: str) -> None:
        self.id = uuid4().hex
        self.client = client
        self.service = service
        self.outcome: Payload | CallFailed | None = None
        self.notices: list[str] = []
        self.on_end: Callable[[], None] | None = None
        self._pending: PendingCall | None = None
        self._answered = anyio.Event()

    def send(self, payload: Payload, seconds: float) -> None:
        """Send the call. Raises what :meth:`rwt.access.client_graph.ClientGraph.call_service` does."""

        def request_of(type: ServiceType) -> Payload:
            if type.request is not payload.type:
                raise HttpProblem(
                    "conflict", f"the type of {self.service} has changed meanwhile", instead="ask again"
                )
            return payload

        graph = self.client.graph
        with graph.notices() as self.notices:
            self._pending = graph.call_service(self.service, request_of, self._on_reply, seconds)

    def _on_reply(self, outcome: Payload | CallFailed) -> None:
        self.outcome = outcome if isinstance(outcome, CallFailed) else outcome.detach()
        self._answered.set()
        if self.on_end is not None:
            self.on_end()

    @property
    def approval(self) -> Approval | None:
        """Request for approval that the call waits for; None if it waits for none."""
        return self.client.graph.approval_of(self._pending)

    async def wait(self, seconds: float) -> None:
        """Wait for the outcome; while the call waits for approval, at most `seconds`."""
        if self.outcome is None and self.approval is not None:
            with anyio.move_on_after(seconds):
                await self._answered.wait()
        if self.outcome is None and self.approval is None:
            await self._answered.wait()

    def response(self) -> Payload:
        """Return the response. Raises the error of a call that failed."""
        assert self.outcome is not None  # Invariant: callers wait for the outcome first.
        if isinstance(self.outcome, CallFailed):
            raise self.outcome
        return self.outcome

    def state(self, request: HttpRequest) -> HttpResponse:
        """Return the state of a call that waits for approval, with status 202."""
        approval = self.approval
        assert approval is not None  # Callers wait for the outcome of a call that has been sent.
        body = {
            "id": self.id,
            "service": self.service,
            "state": WAITING,
            "reason": approval.progress,
            "approval": approval_body(approval),
            **({"gate": self.notices} if self.notices else {}),
        }
        where = f"{request.prefix}{PATH}{self.service.lstrip('/')}/calls/{self.id}"
        headers = {"Location": where, "Cache-Control": "no-store", "Retry-After": "1"}
        return value_response(request, body, 202, headers)


class HttpCalls:
    """Calls that outlive their requests; those that have ended are kept for `api.goal_seconds`.

    Args:
        settings: settings of the gateway.
    """

    def __init__(self, settings: HttpSettings) -> None:
        self._most = settings.goals
        self._keep_seconds = settings.goal_seconds
        self._of_client: dict[HttpClient, dict[str, HttpCall]] = {}
        self._kept: dict[HttpCall, tuple[Timer, Charge | None]] = {}

    def keep(self, call: HttpCall) -> None:
        """Keep a call that is pending.

        Raises:
            QuotaExceeded: the client has `api.goals` pending calls.
        """
        own = self._of_client.setdefault(call.client, {})
        if len(own) >= self._most:
            ended = next((each for each in own.values() if each.outcome is not None), None)
            if ended is None:
                raise QuotaExceeded(
                    f"{len(own)} calls of this client wait, and {self._most} is the limit (api.goals)"
                )
            self._forget(ended)
        own[call.id] = call
        call.client.hold()
        call.on_end = partial(self._end, call)

    def _end(self, call: HttpCall) -> None:
        """Keep the outcome of a call for a while, on the client's account."""
        charge = None
        if isinstance(call.outcome, Payload):
            try:
                charge = call.client.graph.keep(call.outcome.kept_size)
            except QuotaExceeded as exceeded:
                call.outcome = CallFailed(f"the response is not kept: {exceeded}")
        timer = call.client.graph.clock.call_later(self._keep_seconds, partial(self._forget, call))
        self._kept[call] = timer, charge

    def _forget(self, call: HttpCall) -> None:
        timer, charge = self._kept.pop(call)
        timer.cancel()
        if charge is not None:
            charge.end()
        own = self._of_client[call.client]
        del own[call.id]
        if not own:
            del self._of_client[call.client]
        call.client.release()

    def find(self, client: HttpClient, service: str, id: str) -> HttpCall:
        """Return a call of a client. Raises HttpProblem if it is unknown or forgotten."""
        call = self._of_client.get(client, {}).get(id)
        if call is None or call.service != service:
            raise HttpProblem(
                "not-found", f"no call {id} of {service} by this client is known here; those that have ended"
                f" are kept for {self._keep_seconds:g} s", instead="call again with POST",
            )  # fmt: skip
        return call

    def close(self) -> None:
        """Forget the calls that have ended; the others end with their clients."""
        for call in tuple(self._kept):
            self._forget(call)
