"""Actions in memory, and the state machine of a goal, which is ROS 2's: :data:`TRANSITIONS`.

A goal is proposed (`UNKNOWN`), then accepted and executed, perhaps asked to cancel, and ends in one of three
states. A cancel of a goal that is still proposed waits for its acceptance.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator
from enum import Enum, auto
from functools import partial
from typing import Any, Final, Protocol
from uuid import uuid4

from rwt_graph.api import (
    MOST_GOALS,
    ActionInfo,
    CallObserver,
    ClientGoal,
    GoalEvents,
    ServerGoal,
    ServiceCall,
)
from rwt_graph.errors import InvalidGraphName, InvalidTransition
from rwt_graph.memory.tables import NodeResources, Provider, ProviderTable, RemoteProviders
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ActionType, ServiceType
from rwt_participant.errors import CallFailed, GoalRejected, ProviderGone, ProviderNotFound
from rwt_participant.goals import GoalStatus

logger = logging.getLogger(__name__)

OnGoal = Callable[[ServerGoal], None]

_LOGGED_CHARACTERS: Final = 500
"""Maximum length of a reason in the log."""

_GOAL_ID = re.compile(r"[0-9a-f]{32}\Z")


class GoalEvent(Enum):
    """An event in the life of a goal."""

    ACCEPT = auto()
    EXECUTE = auto()
    CANCEL = auto()  # the request
    SUCCEED = auto()
    CANCELED = auto()  # the server has granted the request
    ABORT = auto()
    LOSE = auto()  # the server has left


_RUNNING = (GoalStatus.ACCEPTED, GoalStatus.EXECUTING, GoalStatus.CANCELING)

#: States in which each event is possible, and the state that follows.
TRANSITIONS: dict[GoalEvent, tuple[tuple[GoalStatus, ...], GoalStatus]] = {
    GoalEvent.ACCEPT: ((GoalStatus.UNKNOWN,), GoalStatus.ACCEPTED),
    GoalEvent.EXECUTE: ((GoalStatus.ACCEPTED,), GoalStatus.EXECUTING),
    GoalEvent.CANCEL: (_RUNNING, GoalStatus.CANCELING),
    GoalEvent.SUCCEED: ((GoalStatus.EXECUTING, GoalStatus.CANCELING), GoalStatus.SUCCEEDED),
    GoalEvent.CANCELED: ((GoalStatus.CANCELING,), GoalStatus.CANCELED),
    GoalEvent.ABORT: (_RUNNING, GoalStatus.ABORTED),
    GoalEvent.LOSE: ((GoalStatus.UNKNOWN, *_RUNNING), GoalStatus.ABORTED),
}

#: Event that ends a goal in a state.
ENDINGS = {
    GoalStatus.SUCCEEDED: GoalEvent.SUCCEED,
    GoalStatus.CANCELED: GoalEvent.CANCELED,
    GoalStatus.ABORTED: GoalEvent.ABORT,
}


class GoalWatcher(Protocol):
    """Observer of the goals of one action server, for clients in other processes."""

    @property
    def feedback_wanted(self) -> bool:
        """True if a client takes feedback now."""

    def changed(self, goal_id: str) -> None:
        """Called when a goal's state has changed."""

    def fed_back(self, goal_id: str, feedback: Payload) -> None:
        """Called when the server sent feedback on a goal."""

    def ended(self, goal_id: str, status: GoalStatus, result: Payload | None, reason: str) -> None:
        """Called when a goal has ended; without a result if it was rejected or its server left."""


class RemoteActions(RemoteProviders, Protocol):
    """Actions of other processes."""

    def info(self, name: str) -> ActionInfo | None:
        """Return an action of another process; None if it does not exist."""

    def send(
        self, action: str, payload: Payload, events: GoalEvents, goal_id: str, client: NodeResources
    ) -> ClientGoal | None:
        """Send a goal to another process; None if no other process offers the action."""

    def cancel(self, action: str, goal_id: str, client: NodeResources) -> None:
        """Request cancellation of a goal in another process by its id."""

    def cancel_every(self, action: str, client: NodeResources) -> None:
        """Request cancellation of all goals of an action in another process."""


def _log_end(goal: NotifyingGoal, outcome: Payload | CallFailed) -> None:
    """Log a goal that ended other than by success, with its reason."""
    if goal.status is GoalStatus.SUCCEEDED:
        return
    was_executed = isinstance(outcome, Payload)
    end = "rejected" if isinstance(outcome, GoalRejected) else "lost"
    if was_executed:
        end = goal.status.name.lower()
    reason = (goal.reason if was_executed else str(outcome)) or "the action server gave no reason"
    level = logging.INFO if goal.status is GoalStatus.CANCELED else logging.WARNING
    logger.log(level, "goal %s of %s: %s: %s", goal.id, goal.action, end, reason[:_LOGGED_CHARACTERS])


def _run_callback(goal: ClientGoal, callback: Callable[[], None]) -> None:
    try:
        callback()
    except Exception:
        logger.exception("a callback of goal %s of %s failed", goal.id, goal.action)


class NotifyingGoal(ClientGoal):
    """Goal that calls its client's callbacks, until it has ended or the client has left.

    Attributes:
        client: node that sent it.
    """

    status = GoalStatus.UNKNOWN
    reason = ""

    def __init__(self, goal_id: str, action: str, events: GoalEvents, client: NodeResources) -> None:
        self.id = goal_id
        self.action = action
        self.client = client
        self._events: GoalEvents | None = events
        client.add(self, self.client_closed)

    @property
    def is_heard(self) -> bool:
        """True until the goal has ended, or its client has left."""
        return self._events is not None

    @property
    def wants_feedback(self) -> bool:
        """True if the client takes feedback."""
        return self._events is not None and self._events.on_feedback is not None

    def notify_accepted(self) -> None:
        """Report that the server has accepted the goal."""
        if self._events is not None and self._events.on_accepted is not None:
            _run_callback(self, self._events.on_accepted)

    def notify_feedback(self, feedback: Payload) -> None:
        """Report feedback."""
        if self._events is not None and self._events.on_feedback is not None:
            _run_callback(self, partial(self._events.on_feedback, feedback))

    def notify_end(self, outcome: Payload | CallFailed) -> None:
        """Report the end with the present status; no-op if it was reported."""
        events = self._events
        self._let_go()
        if events is not None:
            _log_end(self, outcome)
            _run_callback(self, partial(events.on_result, self.status, outcome))

    def client_closed(self) -> None:
        """Drop the callbacks of a client whose node leaves; the goal continues (ACT-19)."""
        self.notify_end(CallFailed(f"node {self.client.name} was closed"))

    def abandon(self) -> None:
        self._let_go()

    def _let_go(self) -> None:
        self._events = None
        self.client.drop(self)


class MemoryGoal(NotifyingGoal, ServerGoal):
    """Goal as both sides see it.

    States, which are ROS 2's (:data:`TRANSITIONS`)::

        UNKNOWN ── accept() ──> ACCEPTED ──> EXECUTING ── cancel() ──> CANCELING
           │                                     │                         │
        reject()                          finish(), lose()          finish(), lose()
           v                                     v                         v
        UNKNOWN, ended               SUCCEEDED or ABORTED    SUCCEEDED, CANCELED or ABORTED

    A goal has ended once its server's ``goals`` do not contain it. A cancel request before the acceptance
    waits for it (``cancel_requested``), and reaches the server once (``_cancel_notified``).
    """

    cancel_requested = False

    def __init__(
        self,
        server: MemoryActionServer,
        goal_id: str,
        goal: Payload,
        events: GoalEvents,
        client: NodeResources,
    ) -> None:
        super().__init__(goal_id, server.name, events, client)
        self._goal: Payload | None = goal
        self.on_cancel: Callable[[], None] | None = None
        self.on_end: Callable[[CallFailed], None] | None = None
        self._server = server
        self._cancel_notified = False
        self._listening = True

    @property
    def goal(self) -> Payload:
        if self._goal is None:
            raise InvalidTransition(f"goal {self.id} of {self.action} was taken: its message is not kept")
        return self._goal

    def taken(self) -> None:
        """Release the goal's message after the server's callback."""
        self._goal = None

    @property
    def feedback_wanted(self) -> bool:
        if self._listening and self.wants_feedback:
            return True
        return self._server.watcher is not None and self._server.watcher.feedback_wanted

    def _step(self, event: GoalEvent) -> None:
        before, after = TRANSITIONS[event]
        if self.status not in before:
            raise InvalidTransition(
                f"goal {self.id} of {self.action} is {self.status.name}: {event.name} is not possible"
            )
        changed = after is not self.status
        self.status = after
        if changed and self._server.watcher is not None:
            self._server.watcher.changed(self.id)

    def accept(self) -> None:
        """UNKNOWN → ACCEPTED → EXECUTING; then pass on an earlier cancel request."""
        self._step(GoalEvent.ACCEPT)
        self._step(GoalEvent.EXECUTE)
        self.notify_accepted()
        if self.cancel_requested:
            self.cancel()

    def reject(self, reason: str) -> None:
        if self.status is not GoalStatus.UNKNOWN or self._server.goals.pop(self.id, None) is None:
            raise InvalidTransition(
                f"goal {self.id} of {self.action} is {self.status.name}: too late to reject"
            )
        self._end(GoalRejected(reason), reason)

    def feedback(self, feedback: Payload) -> None:
        """Send feedback. Ignored before the goal was accepted and once it has ended (ACT-06)."""
        if self.status is GoalStatus.UNKNOWN or self.status.is_terminal:
            return
        if self._listening:
            self.notify_feedback(feedback)
        if self._server.watcher is not None:
            self._server.watcher.fed_back(self.id, feedback)

    def finish(self, status: GoalStatus, result: Payload, reason: str = "") -> None:
        event = ENDINGS.get(status)
        if event is None:
            raise InvalidTransition(f"a goal cannot be finished as {status.name}, which is not an end")
        self._step(event)
        self._server.goals.pop(self.id, None)
        self._end(result, reason)

    def lose(self) -> None:
        """End the goal as ABORTED because its server left, and notify both sides."""
        self._step(GoalEvent.LOSE)
        gone = ProviderGone(f"Action {self.action} was unadvertised")
        on_end = self.on_end
        self._end(gone, str(gone))
        if on_end is not None:
            _run_callback(self, partial(on_end, gone))

    def _end(self, outcome: Payload | CallFailed, reason: str) -> None:
        self.reason = reason
        if self._server.watcher is not None:
            result = None if isinstance(outcome, CallFailed) else outcome
            self._server.watcher.ended(self.id, self.status, result, reason)
        self.notify_end(outcome)

    def cancel(self) -> None:
        """Pass a cancel request to the server, once, after the goal was accepted (ACT-07)."""
        if self.status.is_terminal or self.id not in self._server.goals:
            return
        self.cancel_requested = True
        if self.status is GoalStatus.UNKNOWN:
            return
        self._step(GoalEvent.CANCEL)
        if self.on_cancel is not None and not self._cancel_notified:
            self._cancel_notified = True
            _run_callback(self, self.on_cancel)

    def want_feedback(self, wanted: bool) -> None:
        self._listening = wanted


class _RefusedGoal(ClientGoal):
    """Goal that did not reach a server; its client receives the error."""

    status = GoalStatus.UNKNOWN
    reason = ""

    def __init__(self, goal_id: str, action: str) -> None:
        self.id = goal_id
        self.action = action

    def cancel(self) -> None:
        """No-op."""

    def abandon(self) -> None:
        """No-op."""


class MemoryActionServer(Provider):
    """Action that a node offers.

    Attributes:
        goals: goals that have not ended, by id.
        on_close: withdraws the services and topics of the action on ROS 2.
        watcher: observer for other processes.
    """

    def __init__(
        self, actions: Actions, name: str, interface: ActionType, owner: NodeResources, on_goal: OnGoal
    ) -> None:
        super().__init__(name, owner)
        self.type = interface
        self.info = ActionInfo(name, interface, owner.name)
        self.on_goal = on_goal
        self.goals: dict[str, MemoryGoal] = {}
        self.on_close: Callable[[], None] | None = None
        self.watcher: GoalWatcher | None = None
        self._actions = actions

    def withdraw(self) -> None:
        self._actions.remove(self)
        # Break the reference cycle, so that both are freed without the garbage collector.
        on_close, self.on_close = self.on_close, None
        if on_close is not None:
            on_close()

    def end_requests(self) -> None:
        while self.goals:
            self.goals.popitem()[1].lose()


class Actions(ProviderTable[MemoryActionServer]):
    """Actions of one graph. Those of other processes count as services in `changes`.

    Attributes:
        observer: observer of every goal of this process's actions.
    """

    remote: RemoteActions | None = None
    observer: CallObserver | None = None

    def advertise(
        self, name: str, interface: ActionType, owner: NodeResources, on_goal: OnGoal
    ) -> MemoryActionServer:
        """Offer an action; a server of the same name is replaced (ACT-18) until this one closes."""
        server = MemoryActionServer(self, name, interface, owner, on_goal)
        if not owner.for_clients:
            self.displace(name, f"{name}: the robot offers this action now")
        old = self.put(server)
        if old is not None:
            logger.warning("action %s of node %s replaces the one of node %s", name, owner.name, old.node)
            old.end_requests()
        return server

    def send(
        self, action: str, payload: Payload, events: GoalEvents, goal_id: str | None, client: NodeResources
    ) -> ClientGoal:
        """Send a goal; a server of this process has priority over others."""
        if goal_id is None:
            goal_id = uuid4().hex
        elif not _GOAL_ID.match(goal_id):
            raise InvalidGraphName(f"{goal_id[:80]!r} is not a goal id: it must be 32 lower-case hex digits")
        server = self.current.get(action)
        if server is not None:
            return self.send_here(server, payload, events, goal_id, client)
        if self.remote is not None:
            sent = self.remote.send(action, payload, events, goal_id, client)
            if sent is not None:
                return sent
        return _refused(goal_id, action, events, ProviderNotFound(f"Action {action} does not exist"))

    def send_here(
        self,
        server: MemoryActionServer,
        payload: Payload,
        events: GoalEvents,
        goal_id: str,
        client: NodeResources,
    ) -> ClientGoal:
        action = server.name
        if goal_id in server.goals:
            return _refused(goal_id, action, events, GoalRejected(f"goal id {goal_id} is in use on {action}"))
        if len(server.goals) >= MOST_GOALS:
            full = f"{action} has {MOST_GOALS} goals that have not ended, which is the limit"
            return _refused(goal_id, action, events, GoalRejected(full))
        if self.observer is not None:
            try:
                events = self.observer.on_goal(server.info, goal_id, payload, events)
            except Exception:
                logger.exception("a goal of %s could not be observed", action)
        goal = server.goals[goal_id] = MemoryGoal(server, goal_id, payload, events, client)
        try:
            server.on_goal(goal)
        except Exception:
            logger.exception("action %s failed on a new goal", action)
            if goal.status is GoalStatus.UNKNOWN and goal_id in server.goals:
                goal.reject("internal error")
        goal.taken()
        return goal

    def cancel(self, action: str, goal_id: str, client: NodeResources) -> None:
        server = self.current.get(action)
        goal = None if server is None else server.goals.get(goal_id)
        if goal is not None:
            goal.cancel()
        elif server is None and self.remote is not None:
            self.remote.cancel(action, goal_id, client)

    def cancel_every(self, action: str, client: NodeResources) -> Iterator[None]:
        server = self.current.get(action)
        if server is not None:
            return map(MemoryGoal.cancel, tuple(server.goals.values()))
        if self.remote is not None:
            self.remote.cancel_every(action, client)
        return iter(())

    def info(self, name: str) -> ActionInfo | None:
        server = self.current.get(name)
        if server is not None:
            return server.info
        return None if self.remote is None else self.remote.info(name)


def _refused(goal_id: str, action: str, events: GoalEvents, why: CallFailed) -> ClientGoal:
    goal = _RefusedGoal(goal_id, action)
    _run_callback(goal, partial(events.on_result, GoalStatus.UNKNOWN, why))
    return goal


#: Return codes of `action_msgs/CancelGoal`.
ERROR_NONE, ERROR_REJECTED, ERROR_UNKNOWN_GOAL_ID = 0, 1, 2

_EVERY_GOAL = bytes(16)


def cancel_service(server: MemoryActionServer, type: ServiceType) -> Callable[[ServiceCall], None]:
    """Return the handler of `<action>/_action/cancel_goal`, which cancels one goal or all of them on ROS 2.

    Without a goal id, all goals are cancelled. Cancelling by the time of acceptance is rejected with
    `ERROR_REJECTED`.
    """

    def on_call(call: ServiceCall) -> None:
        request: Any = call.request.value()
        info = request.goal_info
        wanted = bytes(info.goal_id.uuid)
        if info.stamp.sec or info.stamp.nanosec:
            code, goals = ERROR_REJECTED, []
        elif wanted == _EVERY_GOAL:
            code, goals = ERROR_NONE, list(server.goals.values())
        else:
            goals = [goal for goal in server.goals.values() if goal.id == wanted.hex()]
            code = ERROR_NONE if goals else ERROR_UNKNOWN_GOAL_ID
        canceling = [{"goal_id": {"uuid": bytes.fromhex(goal.id)}} for goal in goals]
        call.reply(Payload.from_value(type.response, {"return_code": code, "goals_canceling": canceling}))
        for goal in goals:
            goal.cancel()

    return on_call
