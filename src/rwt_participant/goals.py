"""Goals, as their sender and as the program that executes them see them."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Awaitable, Callable
from enum import IntEnum
from typing import NamedTuple, TypeAlias, cast

import anyio

from rwt_participant.errors import GoalAborted, GoalCanceled
from rwt_participant.future import Future, Within
from rwt_participant.handles import QUEUE_BYTES, MessageQueue
from rwt_participant.messages import Message, MessageLike, is_coroutine_function

logger = logging.getLogger(__name__)

_FEEDBACK_KEPT = 1000


class GoalStatus(IntEnum):
    """States of a goal, with the numbers of `action_msgs/GoalStatus`."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @property
    def is_terminal(self) -> bool:
        """True if the state is final."""
        return self >= GoalStatus.SUCCEEDED


class GoalResult(NamedTuple):
    """End of a goal: ``status, result = await goal.result()``.

    Attributes:
        status: `SUCCEEDED`, `CANCELED` or `ABORTED`.
        result: result message of the action.
    """

    status: GoalStatus
    result: Message

    @property
    def succeeded(self) -> bool:
        """True if the goal was reached."""
        return self.status is GoalStatus.SUCCEEDED


class Goal(ABC):
    """Goal that was sent: feedback, result, cancellation.

    Iterate over it for the feedback, unless it was sent with `on_feedback`.

    Attributes:
        action: name of the action.
        id: id of the goal.
    """

    def __init__(
        self,
        action: str,
        id: str,
        on_feedback: Callable[[Message], object] | None,
        within: Within = anyio.move_on_after,
    ) -> None:
        self.action = action
        self.id = id
        self._status = GoalStatus.ACCEPTED
        self._on_feedback = on_feedback
        self._within = within
        self._feedback = MessageQueue[Message](action, _FEEDBACK_KEPT, QUEUE_BYTES)
        self._end: Future[GoalResult] = Future()
        self._reason = ""

    @property
    def status(self) -> GoalStatus:
        """Last known state."""
        return self._status

    @property
    def done(self) -> bool:
        """True if it has ended."""
        return self._end.done

    @property
    def reason(self) -> str:
        """Reason that the server gave for the end of the goal; empty while it runs or if there is none."""
        return self._reason

    async def result(self, timeout: float | None = None) -> GoalResult:
        """Wait for the end of the goal.

        Args:
            timeout: seconds; None waits without limit. The goal goes on when they are over.

        Raises:
            GoalRejected: the action server rejected it.
            ProviderNotFound: the action does not exist.
            ProviderGone: the action server left first.
            CallTimeout: it has not ended in time.
            ConnectionLost: the connection was lost first. The goal may go on.
        """
        return await self._end.get(timeout, f"the goal of {self.action} has not ended", self._within)

    async def feedback(self) -> AsyncIterator[Message]:
        """Yield the feedback until the goal ends. Raises what :meth:`result` raises."""
        while True:
            while self._feedback:
                yield self._feedback.pop()
            if self._end.done:
                await self._end.wait()
                return
            await self._feedback.wait()

    def __aiter__(self) -> AsyncIterator[Message]:
        return self.feedback()

    def cancel(self) -> None:
        """Request that the goal be canceled; the outcome is its result (ACT-08).

        Raises:
            NotConnected: there is no connection now.
        """
        if not self.done:
            self._send_cancel()
            self._status = GoalStatus.CANCELING

    @abstractmethod
    def _send_cancel(self) -> None:
        """Request the cancellation of a goal that has not ended."""

    @abstractmethod
    def abandon(self) -> None:
        """Receive nothing more of the goal; it goes on, and `result` never returns."""

    def __repr__(self) -> str:
        return f"<Goal {self.id} of {self.action}: {self.status.name}>"

    # -- from the action server ------------------------------------------------------------------------------

    def take_feedback(self, message: Message) -> None:
        """Pass on a feedback message."""
        if self.done:
            return
        if self._status is GoalStatus.ACCEPTED:
            self._status = GoalStatus.EXECUTING
        if self._on_feedback is None:
            self._feedback.put(message, 0)
            return
        try:
            self._on_feedback(message)
        except Exception:
            logger.exception("the feedback callback for %s failed", self.action)

    def end(self, outcome: GoalResult | Exception, reason: str = "") -> None:
        """Set the result, or the error that ends the goal."""
        self._reason = reason
        if isinstance(outcome, GoalResult):
            self._status = outcome.status
        self._end.set(outcome)
        self._feedback.wake()


class ReceivedGoal:
    """Goal as an action's `execute` sees it.

    Attributes:
        id: id of the goal.
        request: message of the goal.
        cancel_event: set when a client requests cancellation; the goal may still end otherwise.
    """

    def __init__(
        self,
        id: str | int | None,
        request: Message,
        publish_feedback: Callable[[MessageLike], None],
        feedback_wanted: Callable[[], bool] = lambda: True,
    ) -> None:
        self.id = id
        self.request = request
        self.cancel_event = anyio.Event()
        self._publish_feedback = publish_feedback
        self._feedback_wanted = feedback_wanted

    @property
    def cancel_requested(self) -> bool:
        """True if a client requests cancellation; raise :exc:`GoalCanceled` to comply."""
        return self.cancel_event.is_set()

    @property
    def feedback_wanted(self) -> bool:
        """False if no client takes feedback now, so that it need not be computed."""
        return self._feedback_wanted()

    def publish_feedback(self, feedback: MessageLike) -> None:
        """Send feedback to the client (ACT-14).

        Raises:
            InvalidMessage: the feedback does not fit the action's type.
        """
        self._publish_feedback(feedback)


#: Executes a goal in a task of its own. Returns the result of a goal that succeeded, None for one of
#: defaults; raises GoalCanceled or GoalAborted to end it otherwise.
Execute: TypeAlias = Callable[[ReceivedGoal], Awaitable["MessageLike | None"]]


#: Executes a goal as :data:`Execute` does, in a thread (`threaded=True`).
BlockingExecute: TypeAlias = Callable[[ReceivedGoal], "MessageLike | None"]


def check_execute(action: str, execute: Execute | BlockingExecute) -> Execute:
    """Return an action's function, checked to be a coroutine function.

    Raises:
        TypeError: it is not.
    """
    if not is_coroutine_function(execute):
        raise TypeError(
            f"the function that executes {action} must be a coroutine function (async def); pass"
            " `threaded=True` with a plain function"
        )
    return cast(Execute, execute)


async def run_goal(execute: Execute, goal: ReceivedGoal) -> tuple[GoalStatus, object, str]:
    """Run an action's function on a goal; return the final status, the result and the reason.

    Raises:
        Exception: exception of the function, other than GoalCanceled and GoalAborted.
    """
    try:
        return GoalStatus.SUCCEEDED, await execute(goal), ""
    except GoalCanceled as end:
        return GoalStatus.CANCELED, end.result, end.reason
    except GoalAborted as end:
        return GoalStatus.ABORTED, end.result, end.reason
