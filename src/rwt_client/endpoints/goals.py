"""Goals for the actions of a robot: ops for those of ROS 2, messages on five topics for ROS 1 (ALB-01)."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from rwt_client.endpoints.services import call_error, failure_text
from rwt_client.errors import ConnectionLost
from rwt_client.wire.decoding import MessageReader
from rwt_interfaces import NOETIC, Payload
from rwt_participant.errors import CallFailed, GoalRejected, InvalidMessage, ProviderNotFound
from rwt_participant.goals import Goal, GoalResult, GoalStatus
from rwt_participant.messages import Message
from rwt_protocol.ops import ActionFeedback, ActionResult, CancelActionGoal, SendActionGoal
from rwt_protocol.payloads import RawJson

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt_client.endpoints.remote_handle import ClientConnection
    from rwt_interfaces.structs import ActionType
    from rwt_participant.handles import Handle, Publisher
    from rwt_participant.transforms import SubscribeVerb


class SentGoal(Goal):
    """Goal whose connection is released at its end."""

    def end(self, outcome: GoalResult | Exception, reason: str = "") -> None:
        super().end(outcome, reason)
        self.abandon()


class WireGoal(SentGoal):
    """Goal that is sent as an op; satisfies :class:`rwt_client.wire.session.Restorable`."""

    def __init__(
        self, connection: ClientConnection, action: str, on_feedback: Callable[[Message], object] | None
    ) -> None:
        super().__init__(action, connection.session.next_id("send_action_goal", action), on_feedback)
        self._connection = connection
        self._session = connection.session

    def send(self, action_type: str, args: RawJson, feedback: MessageReader, result: MessageReader) -> None:
        """Send the goal (ACT-01).

        Raises:
            NotConnected: there is no connection now.
        """
        self._read_feedback = feedback.read
        self._read_result = result.read
        op = SendActionGoal(action=self.action, action_type=action_type, args=args, feedback=True, id=self.id)
        self._session.send(op)
        self._session.add(self.id, self)

    def _send_cancel(self) -> None:
        self._session.send(CancelActionGoal(id=self.id, action=self.action))

    def abandon(self) -> None:
        self._session.remove(self.id)

    def restore(self) -> None:
        """No-op: a goal is not sent twice."""

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """End the goal with an error: its outcome stays unknown (ACT-19)."""
        self.end(type(error)(f"{error}, before the goal of {self.action} ended"))

    def refused(self, text: str) -> None:
        self.end(call_error(text, self.action, GoalRejected), text)

    def receive(self, op: ActionFeedback | ActionResult) -> None:
        """Pass on feedback (ACT-02), or end the goal with its result (ACT-03, ACT-04)."""
        if isinstance(op, ActionFeedback):
            if not isinstance(op.values, str):
                self.take_feedback(self._read_feedback(op.values))
        elif not op.result or isinstance(op.values, str):
            text = failure_text(op.values, f"{self.action} failed and gave no reason")
            error = call_error(text, self.action, CallFailed if op.status else GoalRejected)
            if isinstance(error, ProviderNotFound):
                self._connection.tasks.start_soon(self._end_with_advice, error)
            else:
                self.end(error, text)
        else:
            try:
                self.end(GoalResult(GoalStatus(op.status), self._read_result(op.values)), op.reason or "")
            except InvalidMessage as error:
                self.end(error)

    async def _end_with_advice(self, error: ProviderNotFound) -> None:
        meant = await self._connection.types.meant("action", self.action)
        self.end(ProviderNotFound(f"{error}{meant}"), str(error))


_ENDED: Final = {
    2: GoalStatus.CANCELED,  # PREEMPTED
    3: GoalStatus.SUCCEEDED,
    4: GoalStatus.ABORTED,
    8: GoalStatus.CANCELED,  # RECALLED: canceled before it started
}
"""Final states of ``actionlib_msgs/GoalStatus``, which differ from those of ROS 2 (ALB-08)."""


class ActionlibGoal(SentGoal):
    """Goal of ROS 1, which is sent as a message."""

    _cancels: Publisher
    _handles: tuple[Handle, ...] = ()

    async def send(
        self,
        subscribe: SubscribeVerb,
        advertise: Callable[[str, str], Publisher],
        action_type: ActionType,
        payload: Payload,
    ) -> None:
        """Send the goal, after subscribing to its feedback and result."""
        name, type = self.action, action_type.name
        feedback = await subscribe(f"{name}/feedback", self._on_feedback_message, f"{type}ActionFeedback")
        result = await subscribe(f"{name}/result", self._on_result, f"{type}ActionResult")
        self._cancels = await advertise(f"{name}/cancel", "actionlib_msgs/GoalID")
        goals = await advertise(f"{name}/goal", f"{type}ActionGoal")
        self._handles = (feedback, result, self._cancels, goals)
        stamp = NOETIC.time(time.time_ns())
        goals.publish({"goal_id": {"id": self.id, "stamp": stamp}, "goal": payload.value()})

    def _send_cancel(self) -> None:
        self._cancels.publish({"id": self.id})

    def abandon(self) -> None:
        for handle in self._handles:
            handle.close()

    # The topics carry the messages of all goals.

    def _on_feedback_message(self, message: Message) -> None:
        if message.status.goal_id.id == self.id:
            self.take_feedback(message.feedback)

    def _on_result(self, message: Message) -> None:
        if message.status.goal_id.id != self.id:
            return
        status, reason = _ENDED.get(message.status.status), message.status.text
        if status is None:
            self.end(GoalRejected(reason or f"{self.action} rejected the goal"), reason)
        else:
            self.end(GoalResult(status, message.result), reason)
