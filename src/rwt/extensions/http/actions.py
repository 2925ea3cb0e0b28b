"""Actions as resources: goals are created under an action, queried, followed as events, and canceled."""

from __future__ import annotations

import re
from typing import Final

from rwt.access.errors import QuotaExceeded
from rwt.access.graph_view import GraphView
from rwt.extensions.http.calls import WAITING, Kept, KeptTable, approval_body
from rwt.extensions.http.clients import Clients, HttpClient, ReaderStream
from rwt.extensions.http.events import STREAM_BYTES, event, payload_event
from rwt.extensions.http.problems import HttpProblem
from rwt.extensions.http.representations import CBOR, EVENTS, JSON, chosen, value_response
from rwt.extensions.http.requests import Query, name_and_type, name_below, payload_of
from rwt_graph.api import ClientGoal, GoalEvents
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ActionType
from rwt_participant.errors import CallFailed, GoalRejected, ProviderNotFound
from rwt_participant.goals import GoalStatus
from rwt_participant.spelling import did_you_mean
from rwt_protocol.states import StateEnum
from rwt_transports.endpoint import DropReason
from rwt_transports.http.routes import HttpRequest, HttpResponse

PATH: Final = "/api/actions/"

REJECTED: Final = "rejected"
LOST: Final = "lost"

STATES: Final = (*(status.name.lower() for status in GoalStatus), WAITING, REJECTED, LOST)
"""States of a goal: those of `action_msgs/GoalStatus`, one before it is sent, and two without a result."""

_GOAL: Final = re.compile(r"/goals/([0-9a-f]{32})\Z")
_EVENTS: Final = 100
_RESULT_ID: Final = "result"


class _GoalState(StateEnum):
    ACTIVE = "ENDED", "REJECTED", "LOST"
    ENDED = ()
    REJECTED = ()
    LOST = ()


class HttpGoal(Kept):
    """Goal, from sending it until it is forgotten.

    Life cycle::

        ACTIVE ── result ──> ENDED
          ├────── the server rejects it ──> REJECTED
          └────── no result can come ──> LOST

    * **ACTIVE**: ``_sent`` has the status of the goal; None while it is being sent.
    * **ENDED**: ``_status`` is the final status, and ``_result`` the result if the client's quota admits it.
    * **REJECTED**, **LOST**: ``failure`` is the reason.

    Attributes:
        action: absolute name of the action.
        failure: reason for ending without a result; None if it has one, or is active.
    """

    def __init__(self, goals: KeptTable[HttpGoal], client: HttpClient, action: str) -> None:
        super().__init__(client)
        self._goals = goals
        self.action = action
        self.failure: CallFailed | None = None
        self.readers: set[GoalEventStream] = set()
        self._sent: ClientGoal | None = None
        self._state = _GoalState.ACTIVE
        self._status = GoalStatus.UNKNOWN
        self._feedback: Payload | None = None
        self._result: Payload | None = None
        self._reason = ""
        self._notices: list[str] = []

    def send(self, type: ActionType, payload: Payload) -> None:
        """Send the goal. Raises what :meth:`rwt.access.client_graph.ClientGraph.send_goal` does."""

        def goal_of(now: ActionType) -> Payload:
            if now.goal is not payload.type:
                raise HttpProblem("conflict", f"the type of {self.action} has changed meanwhile")
            return payload

        events = GoalEvents(self._on_result, self._on_feedback, self._on_accepted)
        with self.client.graph.notices() as self._notices:
            self._sent = self.client.graph.send_goal(self.action, goal_of, events)
        self.id = self._sent.id

    @property
    def ended(self) -> bool:
        """See :attr:`Kept.ended`."""
        return self._state is not _GoalState.ACTIVE

    def _state_name(self) -> str:
        if self.failure is not None:
            return REJECTED if self._state is _GoalState.REJECTED else LOST
        sent = self._sent if self._state is _GoalState.ACTIVE else None
        return (self._status if sent is None else sent.status).name.lower()

    def body(self) -> dict[str, object]:
        """Return the current state of the goal."""
        approval = None if self.ended else self.client.graph.approval_of(self._sent)
        return {
            "id": self.id,
            "action": self.action,
            "state": self._state_name() if approval is None else WAITING,
            "feedback": self._feedback,
            "result": self._result,
            "reason": self._reason if approval is None else approval.progress,
            **({} if approval is None else {"approval": approval_body(approval)}),
            **({"gate": self._notices} if self._notices else {}),
        }

    def _on_accepted(self) -> None:
        self._send_all(event({"state": GoalStatus.ACCEPTED.name.lower()}, "state"))

    def _on_feedback(self, feedback: Payload) -> None:
        if self._keep("feedback", feedback):
            self._feedback = feedback.detach()
        if self.readers:
            data = payload_event(feedback, "feedback")
            for reader in tuple(self.readers):
                reader.queue.put(data)

    def _on_result(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        if isinstance(outcome, CallFailed):
            self._state = self._state.become(
                _GoalState.REJECTED if isinstance(outcome, GoalRejected) else _GoalState.LOST
            )
            self.failure = outcome
            self._reason = str(outcome)
        else:
            self._state = self._state.become(_GoalState.ENDED)
            self._status = status
            self._reason = "" if self._sent is None else self._sent.reason
            if self._keep("result", outcome):
                self._result = outcome.detach()
        # Before the queues end: an ended queue accepts nothing.
        self._send_all(self.end_event())
        for reader in tuple(self.readers):
            reader.queue.end()
        self._goals.end(self)

    def end_event(self) -> bytes:
        """Return the last event of the goal's streams."""
        body = self.body()
        return event({name: body[name] for name in ("state", "result", "reason")}, "result", _RESULT_ID)

    def _keep(self, what: str, payload: Payload) -> bool:
        """Charge the client for the stored goal; return False if its quota is exceeded."""
        try:
            self.charge(what, payload)
        except QuotaExceeded as exceeded:
            self._reason = f"its {what} is not kept: {exceeded}"
            return False
        return True

    def _send_all(self, data: bytes) -> None:
        for reader in tuple(self.readers):
            reader.queue.tell(data)

    def forgotten(self) -> None:
        """End the streams; an active goal continues without readers."""
        if not self.ended and self._sent is not None:
            self._sent.abandon()
        for reader in tuple(self.readers):
            reader.queue.close()


class GoalEventStream(ReaderStream):
    """Event stream of one reader of a goal: ``state``, ``feedback`` and finally ``result``."""

    def __init__(self, client: HttpClient, goal: HttpGoal, max_bytes: int) -> None:
        action = goal.action
        super().__init__(client, _EVENTS, max_bytes, lambda graph: graph.role.allows("goals", action))
        self._goal = goal
        goal.readers.add(self)
        if goal.ended:
            self.queue.tell(goal.end_event())
            self.queue.end()
        else:
            body = goal.body()
            self.queue.tell(event({name: body[name] for name in ("state", "feedback")}, "state"))

    def _drop(self, reason: DropReason) -> None:
        self._dropped += 1
        if self._dropped & (self._dropped - 1) == 0:  # After 1, 2, 4, …: few notices about many drops.
            self.queue.tell(event({"dropped": self._dropped}, "drops"))

    def _close(self) -> None:
        self._goal.readers.discard(self)
        super()._close()


class ActionPages:
    """Routes of actions and goals."""

    def __init__(self, clients: Clients, goals: int, *, several_processes: bool = False) -> None:
        self._clients = clients
        self._several_processes = several_processes
        self.goals: KeptTable[HttpGoal] = KeptTable(goals, "goals of this address run")

    def get(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Return an action, or a goal of it: its state, or its events."""
        found = _GOAL.search(request.path.rstrip("/"))
        if found is not None:
            return self._goal(request, reader, found)
        Query(request)
        if request.path.rstrip("/").endswith("/goals"):
            return self._list_goals(request, reader)
        name = name_below(request.path, PATH, "action")
        action = reader.action(name)
        if action is None:
            meant = did_you_mean(name, (each.name for each in reader.actions()))
            raise HttpProblem("not-found", f"no action {name} is here{meant}")
        return value_response(request, name_and_type(reader, action))

    def _find(self, action: str, id: str) -> HttpGoal:
        """Return a goal by its action and id. Raises HttpProblem if it is unknown or forgotten."""
        goal = self.goals.get(id)
        if goal is not None and goal.action == action:
            return goal
        if self._several_processes:
            raise HttpProblem(
                "misdirected", f"no goal {id} of {action} is known to this process of the server, which has"
                " several (workers): each knows those that were sent to it", instead="ask over the connection"
                " that the goal was sent over, or again over another one",
            )  # fmt: skip
        raise HttpProblem(
            "not-found", f"no goal {id} of {action} is known here; those that have ended are kept for"
            f" {self.goals.seconds:g} s", instead="send one with POST",
        )  # fmt: skip

    def _goal(self, request: HttpRequest, reader: GraphView, found: re.Match[str]) -> HttpResponse:
        Query(request)
        action = name_below(request.path[: found.start()], PATH, "action")
        reader.require("goals", action)
        media = chosen(request, (JSON, CBOR, EVENTS))
        goal = self._find(action, found[1])
        if media != EVENTS:
            return value_response(request, goal.body())
        if goal.ended and request.headers.get("last-event-id") == _RESULT_ID:
            return HttpResponse(status=204)  # A reader that has received the end must not reconnect.
        with self._clients.client_of(request, reader) as client:
            return GoalEventStream(client, goal, STREAM_BYTES).response(request)

    def _list_goals(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """List the client's own goals of an action, oldest first."""
        action = name_below(request.path.rstrip("/").removesuffix("/goals"), PATH, "action")
        reader.require("goals", action)
        with self._clients.client_of(request, reader) as client:
            goals = [goal.body() for goal in self.goals.of_client(client) if goal.action == action]
            return value_response(request, goals)

    async def send(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Send a goal to an action, and make it a resource."""
        Query(request)
        path = request.path.rstrip("/")
        if not path.endswith("/goals"):
            allowed = "GET, DELETE" if _GOAL.search(path) else "GET"
            raise HttpProblem(
                "method-not-allowed", f"nothing is sent to {path}", headers={"Allow": allowed},
                instead="goals are sent to `/api/actions/NAME/goals`",
            )  # fmt: skip
        action = name_below(path.removesuffix("/goals"), PATH, "action")
        with self._clients.client_of(request, reader) as client:
            graph = client.graph
            graph.require("goals", action)
            found = graph.action(action)
            if found is None:
                raise ProviderNotFound(f"no action {action} is here")
            payload = await payload_of(found.type.goal, request, graph.clock.time_ns)
            self.goals.make_room(client)
            goal = HttpGoal(self.goals, client, action)
            goal.send(found.type, payload)
            self.goals.add(goal)
        if goal.failure is not None:
            failure = goal.failure
            self.goals.forget(goal)
            raise failure
        where = f"{request.prefix}{PATH}{action.lstrip('/')}/goals/{goal.id}"
        return value_response(request, goal.body(), 201, {"Location": where, "Cache-Control": "no-store"})

    def cancel(self, request: HttpRequest, reader: GraphView) -> HttpResponse:
        """Cancel a goal, or remove one that has ended."""
        Query(request)
        found = _GOAL.search(request.path.rstrip("/"))
        if found is None:
            allowed = "POST" if request.path.rstrip("/").endswith("/goals") else "GET"
            raise HttpProblem(
                "method-not-allowed", f"{request.path} is no goal: only goals can be canceled",
                headers={"Allow": allowed},
            )  # fmt: skip
        action = name_below(request.path[: found.start()], PATH, "action")
        with self._clients.client_of(request, reader) as client:
            client.graph.require("goals", action)
            goal = self._find(action, found[1])
            if goal.ended:
                self.goals.forget(goal)
                return HttpResponse(status=204)
            client.graph.cancel_goal(action, goal.id)
            return value_response(request, goal.body(), 202)
