"""Actions for robot programs: a coroutine that runs a goal, and a handle on a goal that was sent."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import anyio
import anyio.lowlevel

from rwt_graph.api import ClientGoal, GoalEvents, Graph, Participant, ServerGoal
from rwt_graph.program.future import Outcome
from rwt_graph.program.service_handlers import failure_text
from rwt_interfaces.payload import Payload
from rwt_program.errors import CallFailed, GoalAborted, GoalCanceled, GoalEnded
from rwt_program.goals import GoalStatus
from rwt_program.messages import Message, MessageLike, is_coroutine_function, to_payload

if TYPE_CHECKING:
    from rwt_interfaces.structs import ActionType

logger = logging.getLogger(__name__)


class ActionGoal:
    """One goal as an action's `execute` sees it.

    Attributes:
        id: 32 hex digits.
        request: the goal's message.
        cancel_event: set when a client asks to cancel; the goal may still finish otherwise.
    """

    def __init__(
        self, goal: ServerGoal, request: Message, interface: ActionType, now: Callable[[], int]
    ) -> None:
        self.id = goal.id
        self.request = request
        self.cancel_event = anyio.Event()
        self._goal = goal
        self._interface = interface
        self._now = now

    @property
    def status(self) -> GoalStatus:
        """The state now."""
        return self._goal.status

    @property
    def cancel_requested(self) -> bool:
        """Whether a client asked to cancel."""
        return self._goal.cancel_requested

    @property
    def feedback_wanted(self) -> bool:
        """Whether a client takes feedback now; while False, feedback need not be computed."""
        return self._goal.feedback_wanted

    def publish_feedback(self, feedback: MessageLike) -> None:
        """Send feedback to the client.

        Raises:
            InvalidMessage: it does not fit the action's type.
        """
        self._goal.feedback(to_payload(self._interface.feedback, feedback, self._now))


#: Runs a goal as a task; what it returns is the result of a goal that succeeded, None one of defaults.
Execute: TypeAlias = Callable[[ActionGoal], Awaitable["MessageLike | None"]]

#: Looks at a goal's message before it is accepted: True accepts, False or a reason rejects.
AcceptGoal: TypeAlias = Callable[[Message], "bool | str"]


class ActionFunction:
    """Runs a coroutine function for each goal, in a task of its own."""

    def __init__(
        self, graph: Graph, action: str, interface: ActionType, execute: Execute, accept: AcceptGoal | None
    ) -> None:
        if not is_coroutine_function(execute):
            raise TypeError(f"the function that executes {action} must be a coroutine function (async def)")
        self._graph = graph
        self._action = action
        self._interface = interface
        self._execute = execute
        self._accept = accept

    def __call__(self, goal: ServerGoal) -> None:
        """Take or refuse one goal."""
        if not self._graph.running:
            goal.reject(f"action {self._action} cannot run: the graph is not running")
            return
        # Read now: the goal may be a view of a receive buffer that is used again when this has returned.
        request: Message = goal.goal.value()
        refusal = self._refusal(request)
        if refusal is not None:
            goal.reject(refusal)
            return
        goal.accept()
        self._graph.spawn(partial(self._run, goal, request), f"goal of {self._action}")

    def _refusal(self, request: Message) -> str | None:
        if self._accept is None:
            return None
        try:
            verdict = self._accept(request)
        except Exception as error:
            logger.exception("action %s failed to look at a goal", self._action)
            return failure_text(error)
        if isinstance(verdict, str):
            return verdict
        return None if verdict else f"action {self._action} rejected the goal"

    async def _run(self, goal: ServerGoal, request: Message) -> None:
        with anyio.CancelScope() as scope:
            # Two ends: the server is closed under the goal, or `execute` is done.
            goal.on_end = lambda _gone: scope.cancel()
            if goal.status.is_terminal:
                return
            running = ActionGoal(goal, request, self._interface, self._graph.clock.time_ns)
            goal.on_cancel = running.cancel_event.set
            if goal.cancel_requested:
                running.cancel_event.set()
            try:
                result = await self._execute(running)
            except GoalEnded as end:
                self._finish(goal, _END_STATUS[type(end)], end.result, end.reason)
            except Exception as error:
                logger.exception("action %s failed", self._action)
                self._finish(goal, GoalStatus.ABORTED, None, failure_text(error))
            else:
                self._finish(goal, GoalStatus.SUCCEEDED, result, "")

    def _finish(self, goal: ServerGoal, status: GoalStatus, result: object, reason: str) -> None:
        if goal.status.is_terminal:
            return
        try:
            payload = self._result(result)
            goal.finish(status, payload, reason)
        except Exception as error:
            logger.exception("action %s could not end a goal as %s", self._action, status.name)
            goal.finish(GoalStatus.ABORTED, self._result(None), failure_text(error))

    def _result(self, result: object) -> Payload:
        kind, now = self._interface.result, self._graph.clock.time_ns
        # What an exception carries may be anything: a payload is checked by its type, the rest by value.
        if isinstance(result, Payload):
            return to_payload(kind, result, now)
        return Payload.from_value(kind, {} if result is None else result, now)


_END_STATUS: dict[type[GoalEnded], GoalStatus] = {
    GoalCanceled: GoalStatus.CANCELED,
    GoalAborted: GoalStatus.ABORTED,
}


class GoalHandle:
    """One goal as its client sees it.

    Attributes:
        id: 32 hex digits.
        action: absolute name.
    """

    def __init__(self, action: str, on_feedback: Callable[[Message], None] | None) -> None:
        self.action = action
        self.id = ""
        self._on_feedback = on_feedback
        self._goal: ClientGoal | None = None
        self._accepted: Outcome[CallFailed | None] = Outcome()
        self._ended: Outcome[tuple[GoalStatus, Payload | CallFailed]] = Outcome()

    def send(self, participant: Participant, goal: Payload, goal_id: str | None) -> None:
        """Send the goal. Called once, by :meth:`Node.send_goal`."""
        on_feedback = None if self._on_feedback is None else self._feedback
        events = GoalEvents(self._result, on_feedback, lambda: self._accepted.set(None))
        self._goal = participant.send_goal(self.action, goal, events, goal_id)
        self.id = self._goal.id

    def _feedback(self, feedback: Payload) -> None:
        if self._on_feedback is not None:
            self._on_feedback(feedback.value())

    def _result(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        self._ended.set((status, outcome))
        self._accepted.set(outcome if isinstance(outcome, CallFailed) else None)

    @property
    def status(self) -> GoalStatus:
        """The last state that the server reported."""
        return GoalStatus.UNKNOWN if self._goal is None else self._goal.status

    @property
    def reason(self) -> str:
        """Why the server ended the goal as it did; empty while it runs or when nothing was said."""
        return "" if self._goal is None else self._goal.reason

    async def accepted(self) -> None:
        """Wait until the server has taken the goal.

        Raises:
            CallFailed: it did not: GoalRejected, ProviderNotFound, ProviderGone.
        """
        failure = await self._accepted.wait()
        if failure is not None:
            raise failure

    async def cancel(self) -> None:
        """Ask the server to cancel; the outcome comes as the result."""
        if self._goal is not None:
            self._goal.cancel()
        await anyio.lowlevel.checkpoint()

    def abandon(self) -> None:
        """Drop the goal's callbacks; the goal goes on running, and `result` never returns."""
        if self._goal is not None:
            self._goal.abandon()

    async def result(self) -> tuple[GoalStatus, Message]:
        """The state in which the goal ended, and its result.

        Raises:
            ProviderGone: the server went away first.
        """
        status, outcome = await self._ended.wait()
        if isinstance(outcome, CallFailed):
            raise outcome
        return status, outcome.value()


__all__ = ["AcceptGoal", "ActionFunction", "ActionGoal", "Execute", "GoalHandle"]
