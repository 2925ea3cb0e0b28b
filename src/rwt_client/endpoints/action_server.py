"""Actions that this program offers."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from rwt_client.endpoints.remote_handle import Offered, RemoteServer
from rwt_client.errors import ConnectionLost
from rwt_client.wire.decoding import request_of
from rwt_interfaces.structs import ActionType
from rwt_participant.errors import InvalidMessage, RobotError, ServiceFailed
from rwt_participant.goals import Execute, GoalStatus, ReceivedGoal, run_goal
from rwt_participant.messages import MessageLike, to_payload
from rwt_protocol.ops import (
    ActionFeedback,
    ActionResult,
    AdvertiseAction,
    CancelActionGoal,
    SendActionGoal,
    UnadvertiseAction,
)
from rwt_protocol.payloads import RawJson

if TYPE_CHECKING:
    from rwt_client.wire.session import ReconnectingSession
    from rwt_transports.background import TaskStarter

logger = logging.getLogger("rwt_client")

EXECUTE_FAILED = "the action failed; its program's log says why"


class ActionServer(RemoteServer[ActionType]):
    """Action of this program, until :meth:`close`; advertised again after a reconnection."""

    def __init__(
        self,
        session: ReconnectingSession,
        name: str,
        wire_name: Callable[[ActionType], str],
        offered: Offered[ActionServer],
        execute: Execute,
        tasks: TaskStarter,
    ) -> None:
        super().__init__(session, "advertise_action", name, wire_name, offered)
        self._execute = execute
        self._goals: dict[str | int | None, ReceivedGoal] = {}
        self._tasks = tasks

    def release(self) -> None:
        self._cancel_all()
        super().release()

    def advertise(self, wire_type: str) -> AdvertiseAction:
        return AdvertiseAction(type=wire_type, action=self.name, id=self.id)

    def withdrawal(self) -> UnadvertiseAction:
        return UnadvertiseAction(action=self.name, id=self.id)

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """Request that all goals end: their senders no longer hear of them (ACT-19)."""
        self._cancel_all()

    def _cancel_all(self) -> None:
        for goal in self._goals.values():
            goal.cancel_event.set()
        self._goals.clear()

    # -- goals -----------------------------------------------------------------------------------------------

    def on_goal(self, op: SendActionGoal) -> None:
        """Run a received goal (ACT-12)."""
        try:
            request = request_of(self.type.goal, op.args)
        except InvalidMessage as error:
            raise ServiceFailed(f"not {self.type.goal.name}: {error}") from None
        goal = self._goals[op.id] = ReceivedGoal(op.id, request, partial(self._send_feedback, op.id))
        self._tasks.start_soon(self._run, goal)

    def on_cancel(self, op: CancelActionGoal) -> None:
        """Request that a goal be canceled (ACT-13)."""
        goal = self._goals.get(op.id)
        if goal is not None:
            goal.cancel_event.set()

    def _send_feedback(self, id: str | int | None, message: MessageLike) -> None:
        values = RawJson(to_payload(self.type.feedback, message).json())
        if id in self._goals:
            self._session.send_if_connected(ActionFeedback(action=self.name, values=values, id=id))

    async def _run(self, goal: ReceivedGoal) -> None:
        try:
            status, result, _ = await run_goal(self._execute, goal)
            values = RawJson(to_payload(self.type.result, {} if result is None else result).json())
            op = ActionResult(action=self.name, values=values, status=int(status), result=True, id=goal.id)
        except Exception as error:
            logger.exception("the action %s failed", self.name)
            reason = str(error) if isinstance(error, RobotError) else EXECUTE_FAILED
            status = GoalStatus.ABORTED
            op = ActionResult(action=self.name, values=reason, status=int(status), result=False, id=goal.id)
        # The connection on which the goal was received may be gone.
        if self._goals.get(goal.id) is goal:
            del self._goals[goal.id]
            self._session.send_if_connected(op)
