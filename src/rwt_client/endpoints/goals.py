"""Sending goals to actions."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import AsyncIterator, Callable
from typing import TYPE_CHECKING, Any, Protocol

import anyio

from rwt_client.endpoints.services import call_error, failure_text
from rwt_client.errors import ConnectionLost
from rwt_client.wire.decoding import MessageReader
from rwt_client.wire.future import Outcome
from rwt_program.errors import CallFailed, GoalRejected, InvalidMessage
from rwt_program.goals import GoalResult, GoalStatus
from rwt_program.messages import Message
from rwt_protocol.ops import ActionFeedback, ActionResult, CancelActionGoal, SendActionGoal
from rwt_protocol.payloads import RawJson

if TYPE_CHECKING:
    from rwt_client.wire.session import ReconnectingSession

logger = logging.getLogger("rwt_client")

_FEEDBACK_KEPT = 1000


class GoalChannel(Protocol):
    """How a goal's wishes reach its action."""

    def send_cancel(self) -> None:
        """Ask that the goal end early."""

    def forget(self) -> None:
        """Nothing more is wanted of this goal."""


class Goal:
    """A goal that was sent: its feedback, its result, and how to cancel it.

    Attributes:
        action: the action's name.
        id: the goal's id on the wire.
        status: what is known of it so far.
    """

    def __init__(self, action: str, id: str, on_feedback: Callable[[Any], object] | None) -> None:
        self.action = action
        self.id = id
        self.status = GoalStatus.ACCEPTED
        self.channel: GoalChannel | None = None
        self._on_feedback = on_feedback
        self._feedback: deque[Message] = deque(maxlen=_FEEDBACK_KEPT)
        self._awake = anyio.Event()
        self._outcome: Outcome[GoalResult] = Outcome()

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self._outcome.done

    async def result(self, timeout: float | None = None) -> GoalResult:
        """Wait for the end of the goal.

        Args:
            timeout: seconds; None waits for ever. The goal goes on when they are over.

        Raises:
            CallFailed: the action did not run it: GoalRejected, ProviderNotFound; the server's text.
            CallTimeout: it has not ended in time.
            ConnectionLost: the connection was lost first. The goal may go on, unheard.
        """
        return await self._outcome.get(timeout, f"the goal of {self.action} has not ended")

    async def feedback(self) -> AsyncIterator[Message]:
        """The feedback, until the goal ends.

        Raises:
            CallFailed: the action did not run it.
            ConnectionLost: the connection was lost first.
        """
        while True:
            while self._feedback:
                yield self._feedback.popleft()
            if self._outcome.done:
                await self._outcome.get(None, "")
                return
            self._awake = anyio.Event()
            await self._awake.wait()

    def __aiter__(self) -> AsyncIterator[Message]:
        return self.feedback()

    def cancel(self) -> None:
        """Ask that the goal end early; how it ends is its result (ACT-08).

        Raises:
            NotConnected: there is no connection now.
        """
        if not self.done and self.channel is not None:
            self.channel.send_cancel()
            self.status = GoalStatus.CANCELING

    def __repr__(self) -> str:
        return f"<Goal {self.id} {self.status.name}>"

    # -- what the action says --------------------------------------------------------------------------------

    def take_feedback(self, message: Message) -> None:
        """How far it has come."""
        if self.done:
            return
        if self.status is GoalStatus.ACCEPTED:
            self.status = GoalStatus.EXECUTING
        if self._on_feedback is None:
            self._feedback.append(message)
            self._awake.set()
            return
        try:
            self._on_feedback(message)
        except Exception:
            logger.exception("the feedback callback for %s failed", self.action)

    def end(self, outcome: GoalResult | Exception) -> None:
        """It has ended, or nothing more can be heard of it."""
        if isinstance(outcome, GoalResult):
            self.status = outcome.status
            self._outcome.resolve(outcome)
        else:
            self._outcome.fail(outcome)
        self._awake.set()
        if self.channel is not None:
            self.channel.forget()


class SentGoal:
    """A goal of ROS 2's kind on its way; satisfies :class:`GoalChannel`."""

    def __init__(self, goals: SentGoals, goal: Goal, feedback: MessageReader, result: MessageReader) -> None:
        self.goal = goal
        self._goals = goals
        self._feedback = feedback
        self._result = result

    def send_cancel(self) -> None:
        """Ask that it end early (ACT-07)."""
        self._goals.session.send(CancelActionGoal(id=self.goal.id, action=self.goal.action))

    def forget(self) -> None:
        """It has ended."""
        self._goals.forget(self.goal.id)

    def restore(self) -> None:
        """Nothing: a goal is not sent twice."""

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """What becomes of it will not be heard (ACT-19)."""
        self.goal.end(type(error)(f"{error}, before the goal of {self.goal.action} ended"))

    def refused(self, text: str) -> None:
        """The server complains instead of answering."""
        self.goal.end(call_error(text, self.goal.action, GoalRejected))

    def on_feedback(self, op: ActionFeedback) -> None:
        """Feedback has come (ACT-02)."""
        if not isinstance(op.values, str):
            self.goal.take_feedback(self._feedback.read(op.values))

    def on_result(self, op: ActionResult) -> None:
        """The result has come (ACT-03, ACT-04)."""
        if not op.result or isinstance(op.values, str):
            text = failure_text(op.values, f"{self.goal.action} failed and gave no reason")
            otherwise = CallFailed if op.status else GoalRejected
            self.goal.end(call_error(text, self.goal.action, otherwise))
            return
        try:
            message = self._result.read(op.values)
        except InvalidMessage as error:
            self.goal.end(error)
        else:
            self.goal.end(GoalResult(GoalStatus(op.status), message))


class SentGoals:
    """The goals that have not ended, by their id."""

    def __init__(self, session: ReconnectingSession) -> None:
        self.session = session
        self._sent: dict[str, SentGoal] = {}

    def send(
        self,
        goal: Goal,
        action_type: str,
        args: RawJson,
        readers: tuple[MessageReader, MessageReader],
    ) -> Goal:
        """Send a goal (ACT-01).

        Args:
            readers: of its feedback, and of its result.

        Raises:
            NotConnected: there is no connection now.
        """
        sent = SentGoal(self, goal, *readers)
        goal.channel = sent
        op = SendActionGoal(action=goal.action, action_type=action_type, args=args, feedback=True, id=goal.id)
        self.session.send(op)
        self.session.add(goal.id, sent)
        self._sent[goal.id] = sent
        return goal

    def forget(self, id: str) -> None:  # as on the wire
        """A goal has ended."""
        self._sent.pop(id, None)
        self.session.remove(id)

    def on_feedback(self, _: None, op: ActionFeedback) -> None:
        """Feedback of some goal."""
        sent = self._sent.get(op.id) if isinstance(op.id, str) else None
        if sent is not None:
            sent.on_feedback(op)

    def on_result(self, _: None, op: ActionResult) -> None:
        """The result of some goal."""
        sent = self._sent.get(op.id) if isinstance(op.id, str) else None
        if sent is not None:
            sent.on_result(op)
