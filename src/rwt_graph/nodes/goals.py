"""Actions for robot programs: execution of goals by coroutines, and handles of sent goals."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import anyio

from rwt_graph.api import ClientGoal, GoalEvents, Graph, ServerGoal
from rwt_graph.clock import Clock
from rwt_graph.nodes.service_handlers import failure_text
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ActionType
from rwt_participant.errors import CallFailed, InvalidMessage
from rwt_participant.future import Future
from rwt_participant.goals import (
    BlockingExecute,
    Execute,
    Goal,
    GoalResult,
    GoalStatus,
    ReceivedGoal,
    check_execute,
    run_goal,
)
from rwt_participant.messages import Message, MessageLike, to_payload
from rwt_participant.threads.outbox import Outbox

logger = logging.getLogger(__name__)


#: Checks a goal's message before it is accepted: True accepts, False or a reason rejects.
AcceptGoal: TypeAlias = Callable[[Message], "bool | str"]


class ActionFunction:
    """Runs a coroutine function for each goal, in a task of its own."""

    def __init__(
        self,
        graph: Graph,
        action: str,
        interface: ActionType,
        execute: Execute | BlockingExecute,
        accept: AcceptGoal | None,
    ) -> None:
        self._graph = graph
        self._action = action
        self._interface = interface
        self._execute = check_execute(action, execute)
        self._accept = accept

    def __call__(self, goal: ServerGoal) -> None:
        if not self._graph.running:
            goal.reject(f"action {self._action} cannot run: the graph is not running")
            return
        # Read now: the goal may be a view of a receive buffer that is reused after this returns.
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
            # Two ends: the server is closed while the goal runs, or `execute` returns.
            goal.on_end = lambda _gone: scope.cancel()
            if goal.status.is_terminal:
                return
            running = ReceivedGoal(goal.id, request, self._feedback(goal), lambda: goal.feedback_wanted)
            goal.on_cancel = running.cancel_event.set
            if goal.cancel_requested:
                running.cancel_event.set()
            try:
                self._finish(goal, *await run_goal(self._execute, running))
            except Exception as error:
                logger.exception("action %s failed", self._action)
                self._finish(goal, GoalStatus.ABORTED, None, failure_text(error))
            finally:
                # A function in a thread is not cancelled with this task: it looks at `cancel_requested`.
                running.cancel_event.set()

    def _feedback(self, goal: ServerGoal) -> Callable[[MessageLike], None]:
        """Return a function that sends feedback from any thread."""
        graph, kind = self._graph, self._interface.feedback
        outbox = Outbox(f"{self._action}, feedback", goal.feedback, graph.run_on_graph)

        def publish(feedback: MessageLike) -> None:
            payload = to_payload(kind, feedback, graph.clock.time_ns)
            if graph.on_graph_thread():
                goal.feedback(payload)
            else:
                outbox.put(payload, payload.kept_size)

        return publish

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
        # A payload is checked by its type, any other result by its values.
        if isinstance(result, Payload):
            return to_payload(kind, result, now)
        return Payload.from_value(kind, {} if result is None else result, now)


class GraphGoal(Goal):
    """Goal that was sent in this process, by a program or for a client.

    Attributes:
        accepted: set when the action server accepts the goal; an error if it does not.
    """

    def __init__(self, clock: Clock, action: str, on_feedback: Callable[[Message], object] | None) -> None:
        super().__init__(action, "", on_feedback, clock.within)
        self._goal: ClientGoal | None = None
        self.accepted: Future[None] = Future()

    def send(self, send: Callable[[GoalEvents], ClientGoal]) -> None:
        """Send the goal; raises what `send` raises."""
        events = GoalEvents(self._on_result, self._on_feedback_payload, lambda: self.accepted.set(None))
        self._goal = send(events)
        self.id = self._goal.id

    def _on_feedback_payload(self, feedback: Payload) -> None:
        try:
            message = feedback.value()
        except InvalidMessage as error:
            logger.info("feedback of %s is dropped: %s", self.action, error)
        else:
            self.take_feedback(message)

    def _on_result(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        if isinstance(outcome, CallFailed):
            self.end(outcome, self.reason)
            self.accepted.set(outcome)
            return
        try:
            self.end(GoalResult(status, outcome.value()), self.reason)
        except InvalidMessage as error:
            self.end(error, self.reason)
        self.accepted.set(None)

    @property
    def status(self) -> GoalStatus:
        return GoalStatus.UNKNOWN if self._goal is None else self._goal.status

    @property
    def reason(self) -> str:
        return "" if self._goal is None else self._goal.reason

    def _send_cancel(self) -> None:
        if self._goal is not None:
            self._goal.cancel()

    def abandon(self) -> None:
        if self._goal is not None:
            self._goal.abandon()
