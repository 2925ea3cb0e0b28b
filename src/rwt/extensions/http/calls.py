"""Calls of services: those that require human approval are resources, so that their clients need not wait."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from functools import partial
from typing import TYPE_CHECKING, Final, Generic, TypeVar
from uuid import uuid4

import anyio

from rwt.access.errors import QuotaExceeded
from rwt.extensions.http.problems import HttpProblem
from rwt.extensions.http.representations import value_response
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rwt.access.gate.approvals import Approval
    from rwt.access.quotas import Charge
    from rwt.extensions.http.clients import HttpClient
    from rwt_graph.api import PendingCall
    from rwt_interfaces.structs import MessageType
    from rwt_participant.timers import Timer
    from rwt_transports.http.routes import HttpRequest, HttpResponse

KEPT_SECONDS: Final = 600.0
"""Seconds for which an ended goal, or call that required approval, can be queried."""

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
    return {"id": approval.id, "roles": approval.settings.roles, "seconds_left": approval.seconds_left}


class Kept(ABC):
    """Call or goal that may outlive its request, as a resource of its client.

    Attributes:
        id: 32 hex digits.
        client: client that sent it.
        charges: what is kept of it on the client's account, by what it is.
        timer: runs from its end until it is forgotten.
    """

    def __init__(self, client: HttpClient) -> None:
        self.id = ""
        self.client = client
        self.charges: dict[str, Charge] = {}
        self.timer: Timer | None = None

    @property
    @abstractmethod
    def ended(self) -> bool:
        """True if there is an outcome."""

    def charge(self, what: str, payload: Payload) -> None:
        """Charge the client for a payload, in place of an earlier one. Raises QuotaExceeded."""
        charge = self.charges.pop(what, None)
        if charge is not None:
            charge.end()
        self.charges[what] = self.client.graph.keep(payload.kept_size)

    def forgotten(self) -> None:  # noqa: B027 - a call has nothing left
        """Release what is left; called once."""


K = TypeVar("K", bound=Kept)


class KeptTable(Generic[K]):
    """Calls or goals of all clients, each of which stays present; those that have ended are forgotten after
    :data:`KEPT_SECONDS`.

    Args:
        most: maximum number of entries of one owner (`api.goals`).
        excess: text about a client with as many as it may have, for errors.
        seconds: time for which ended ones are kept.
    """

    def __init__(self, most: int, excess: str, seconds: float = KEPT_SECONDS) -> None:
        self._most = most
        self._excess = excess
        self.seconds = seconds
        self._items: dict[str, K] = {}
        self._of_client: dict[HttpClient, dict[str, K]] = {}

    def __len__(self) -> int:
        return len(self._items)

    def get(self, id: str) -> K | None:
        """Return the call or goal of that id."""
        return self._items.get(id)

    def of_client(self, client: HttpClient) -> tuple[K, ...]:
        """Return what is kept of a client, oldest first."""
        return tuple(self._of_client.get(client, {}).values())

    def make_room(self, client: HttpClient) -> None:
        """Forget the client's oldest that has ended, if it is at its limit. Raises QuotaExceeded."""
        own = self._of_client.get(client, {})
        if len(own) < self._most:
            return
        # In order of creation, so this is the oldest.
        ended = next((each for each in own.values() if each.ended), None)
        if ended is None:
            raise QuotaExceeded(f"{len(own)} {self._excess}, and {self._most} is the limit (api.goals)")
        self.forget(ended)

    def add(self, kept: K) -> None:
        """Keep a call or goal."""
        kept.client.hold()
        self._items[kept.id] = self._of_client.setdefault(kept.client, {})[kept.id] = kept
        if kept.ended:
            self.end(kept)

    def end(self, kept: K) -> None:
        """Forget a call or goal that has ended after a while; no-op if it is not kept."""
        if kept.id in self._items:
            kept.timer = kept.client.graph.clock.call_later(self.seconds, partial(self.forget, kept))

    def forget(self, kept: K) -> None:
        """Remove a call or goal; a second call is a no-op."""
        if self._items.pop(kept.id, None) is None:
            return
        own = self._of_client[kept.client]
        del own[kept.id]
        if not own:
            del self._of_client[kept.client]
        if kept.timer is not None:
            kept.timer.cancel()
        kept.forgotten()
        for charge in kept.charges.values():
            charge.end()
        kept.client.release()

    def close(self) -> None:
        """Forget all."""
        for kept in tuple(self._items.values()):
            self.forget(kept)


class HttpCall(Kept):
    """Call of a service, from sending it until its outcome is read.

    A call that requires approval may outlive its request.

    Attributes:
        service: absolute name of the service.
        outcome: response or error; None while the call is pending.
        notices: notices of the gate about the request, such as clamping.
        on_end: called when the call has ended.

    Args:
        client: client that calls.
        service: absolute name of the service.
    """

    def __init__(self, client: HttpClient, service: str) -> None:
        super().__init__(client)
        self.id = uuid4().hex
        self.service = service
        self.outcome: Payload | CallFailed | None = None
        self.notices: list[str] = []
        self.on_end: Callable[[], None] | None = None
        self._pending: PendingCall | None = None
        self._answered = anyio.Event()

    @property
    def ended(self) -> bool:
        """See :attr:`Kept.ended`."""
        return self.outcome is not None

    def keep_outcome(self) -> None:
        """Charge the client for the response; without quota, the call has failed."""
        if isinstance(self.outcome, Payload):
            try:
                self.charge("response", self.outcome)
            except QuotaExceeded as exceeded:
                self.outcome = CallFailed(f"the response is not kept: {exceeded}")

    def send(self, payload: Payload, seconds: float) -> None:
        """Send the call. Raises what :meth:`rwt.access.client_graph.ClientGraph.call_service` does."""

        def request_of(type: MessageType) -> Payload:
            if type is not payload.type:
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
        # Not required, or approved meanwhile: the call ends at the latest with the timeout given to `send`.
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
