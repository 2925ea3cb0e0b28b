"""Sending goals to actions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_client.endpoints.services import call_error, failure_text
from rwt_client.errors import ConnectionLost
from rwt_client.wire.decoding import MessageReader
from rwt_participant.errors import CallFailed, GoalRejected, InvalidMessage, ProviderNotFound
from rwt_participant.goals import Goal, GoalResult, GoalStatus
from rwt_protocol.ops import ActionFeedback, ActionResult, CancelActionGoal, SendActionGoal
from rwt_protocol.payloads import RawJson

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rwt_client.wire.session import ReconnectingSession
    from rwt_transports.background import TaskStarter


class WireGoal:
    """Goal of ROS 2's kind in flight; satisfies :class:`rwt_participant.goals.GoalChannel`."""

    def __init__(self, goals: SentGoals, goal: Goal, feedback: MessageReader, result: MessageReader) -> None:
        self.goal = goal
        self._goals = goals
        self._feedback = feedback
        self._result = result

    def send_cancel(self) -> None:
        self._goals.session.send(CancelActionGoal(id=self.goal.id, action=self.goal.action))

    def forget(self) -> None:
        self._goals.session.remove(self.goal.id)

    def restore(self) -> None:
        """No-op: a goal is not sent twice."""

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """End the goal with an error: its outcome stays unknown (ACT-19)."""
        self.goal.end(type(error)(f"{error}, before the goal of {self.goal.action} ended"))

    def refused(self, text: str) -> None:
        self.goal.end(call_error(text, self.goal.action, GoalRejected))

    def on_feedback(self, op: ActionFeedback) -> None:
        """Pass on feedback (ACT-02)."""
        if not isinstance(op.values, str):
            self.goal.take_feedback(self._feedback.read(op.values))

    def on_result(self, op: ActionResult) -> None:
        """End the goal with its result (ACT-03, ACT-04)."""
        if not op.result or isinstance(op.values, str):
            text = failure_text(op.values, f"{self.goal.action} failed and gave no reason")
            otherwise = CallFailed if op.status else GoalRejected
            self._goals.end(self.goal, call_error(text, self.goal.action, otherwise))
            return
        try:
            message = self._result.read(op.values)
        except InvalidMessage as error:
            self.goal.end(error)
        else:
            self.goal.end(GoalResult(GoalStatus(op.status), message))


class SentGoals:
    """Goals in flight, by id.

    Args:
        meant: asks the robot for a suggestion, for the error about an action that does not exist.
    """

    def __init__(
        self,
        session: ReconnectingSession,
        tasks: TaskStarter,
        meant: Callable[[str, str], Awaitable[str]],
    ) -> None:
        self.session = session
        self._tasks = tasks
        self._meant = meant

    def send(
        self,
        goal: Goal,
        action_type: str,
        args: RawJson,
        readers: tuple[MessageReader, MessageReader],
    ) -> Goal:
        """Send a goal (ACT-01).

        Raises:
            NotConnected: there is no connection now.
        """
        sent = WireGoal(self, goal, *readers)
        goal.channel = sent
        op = SendActionGoal(action=goal.action, action_type=action_type, args=args, feedback=True, id=goal.id)
        self.session.send(op)
        self.session.add(goal.id, sent)
        return goal

    def cancel(self, action: str, id: str) -> None:
        """Request the cancellation of a goal by its id, whether this client sent it or another (ACT-07).

        Raises:
            NotConnected: there is no connection now.
        """
        sent = self.session.find(id)
        if isinstance(sent, WireGoal):
            sent.goal.cancel()
        else:
            self.session.send(CancelActionGoal(id=id, action=action))

    def end(self, goal: Goal, error: CallFailed) -> None:
        """End a goal with an error, with a suggestion if its action does not exist."""
        if isinstance(error, ProviderNotFound):
            self._tasks.start_soon(self._end_with_advice, goal, error)
        else:
            goal.end(error)

    async def _end_with_advice(self, goal: Goal, error: ProviderNotFound) -> None:
        goal.end(ProviderNotFound(f"{error}{await self._meant('action', goal.action)}"))

    def on_feedback(self, _: None, op: ActionFeedback) -> None:
        """Pass feedback to its goal."""
        sent = self.session.find(op.id)
        if isinstance(sent, WireGoal):
            sent.on_feedback(op)

    def on_result(self, _: None, op: ActionResult) -> None:
        """Pass a result to its goal."""
        sent = self.session.find(op.id)
        if isinstance(sent, WireGoal):
            sent.on_result(op)
