"""Services and actions that this program offers."""

from __future__ import annotations

import logging
import threading
from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Self, TypeVar

from rwt_client.endpoints.remote_handle import ClientConnection, RemoteHandle
from rwt_client.errors import ConnectionLost
from rwt_client.wire.decoding import request_of
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ActionType, ServiceType
from rwt_participant.errors import InvalidMessage, RobotError, ServiceFailed
from rwt_participant.goals import Execute, GoalStatus, ReceivedGoal, run_goal
from rwt_participant.messages import MessageLike, ServiceHandler, call_handler, to_payload
from rwt_participant.threads.outbox import Outbox
from rwt_participant.threads.pool import call_soon_threadsafe
from rwt_protocol.ops import (
    ActionFeedback,
    ActionResult,
    AdvertiseAction,
    AdvertiseService,
    CallService,
    CancelActionGoal,
    Op,
    SendActionGoal,
    ServiceResponse,
    UnadvertiseAction,
    UnadvertiseService,
)
from rwt_protocol.payloads import RawJson

logger = logging.getLogger("rwt_client")

T = TypeVar("T", ServiceType, ActionType)
S = TypeVar("S")

HANDLER_FAILED = "the service's handler failed; its program's log says why"
EXECUTE_FAILED = "the action failed; its program's log says why"


class Offered(dict[str, S]):
    """Services or actions that this program offers, by name."""

    def find(self, name: str) -> S:
        """Return the one of that name. Raises :exc:`ServiceFailed`."""
        offered = self.get(name)
        if offered is None:
            raise ServiceFailed(f"this client does not offer {name}")
        return offered


class RemoteServer(RemoteHandle[T]):
    """Service or action of this program, until it is closed or replaced by another of the same name.

    Args:
        offered: services or actions that this program offers, by name.
    """

    def __init__(self, connection: ClientConnection, kind: str, name: str, offered: Offered[Self]) -> None:
        super().__init__(connection, kind, name)
        self._offered = offered
        previous = offered.get(name)
        if previous is not None:
            previous.close()
        offered[name] = self

    def release(self) -> None:
        if self._offered.get(self.name) is self:
            del self._offered[self.name]

    def restore(self) -> None:
        self._session.send(self.advertise(self._connection.types.wire_name(self.type)))

    def fail(self, error: RobotError) -> None:
        self.close()

    def lost(self, error: ConnectionLost, final: bool) -> None:
        """No-op: the server notifies all callers."""

    def refused(self, text: str) -> None:
        logger.error("%s is not offered: %s", self.name, text)

    @abstractmethod
    def advertise(self, wire_type: str) -> Op:
        """Return the op that offers it."""


class ServiceServer(RemoteServer[ServiceType]):
    """Service of this program, until :meth:`close`; advertised again after a reconnection."""

    def __init__(
        self,
        connection: ClientConnection,
        name: str,
        offered: Offered[ServiceServer],
        handler: ServiceHandler,
    ) -> None:
        super().__init__(connection, "advertise_service", name, offered)
        self._handler = handler

    def advertise(self, wire_type: str) -> AdvertiseService:
        return AdvertiseService(type=wire_type, service=self.name, id=self.id)

    def withdrawal(self) -> UnadvertiseService:
        return UnadvertiseService(service=self.name, id=self.id)

    def on_call(self, op: CallService) -> None:
        """Answer one call, now or from a task."""
        try:
            request = request_of(self.type.request, op.args)
        except Exception as error:
            self._fail(op, error)
            return
        reply, fail = partial(self._reply, op), partial(self._fail, op)
        start = self._connection.tasks.start_soon
        call_handler(self._handler, request, self.type.response, reply, fail, start)

    def _reply(self, op: CallService, response: Payload) -> None:
        self._session.send_if_connected(
            ServiceResponse(service=op.service, values=RawJson(response.json()), result=True, id=op.id)
        )

    def _fail(self, op: CallService, error: Exception) -> None:
        if not isinstance(error, ServiceFailed | InvalidMessage):
            logger.error("the handler of %s failed", self.name, exc_info=error)
        reason = str(error) if isinstance(error, RobotError) else HANDLER_FAILED
        self._session.send_if_connected(
            ServiceResponse(service=op.service, values=reason, result=False, id=op.id)
        )


class ActionServer(RemoteServer[ActionType]):
    """Action of this program, until :meth:`close`; advertised again after a reconnection."""

    def __init__(
        self, connection: ClientConnection, name: str, offered: Offered[ActionServer], execute: Execute
    ) -> None:
        super().__init__(connection, "advertise_action", name, offered)
        self._execute = execute
        self._goals: dict[str | int | None, ReceivedGoal] = {}

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

    def on_goal(self, op: SendActionGoal) -> None:
        """Run a received goal (ACT-12)."""
        try:
            request = request_of(self.type.goal, op.args)
        except InvalidMessage as error:
            raise ServiceFailed(f"not {self.type.goal.name}: {error}") from None
        goal = self._goals[op.id] = ReceivedGoal(op.id, request, self._feedback(op.id))
        self._connection.tasks.start_soon(self._run, goal)

    def on_cancel(self, op: CancelActionGoal) -> None:
        """Request that a goal be canceled (ACT-13)."""
        goal = self._goals.get(op.id)
        if goal is not None:
            goal.cancel_event.set()

    def _feedback(self, id: str | int | None) -> Callable[[MessageLike], None]:
        """Return a function that sends feedback from any thread."""
        loop = threading.get_ident()

        def send(payload: Payload) -> None:
            if id in self._goals:
                values = RawJson(payload.json())
                self._session.send_if_connected(ActionFeedback(action=self.name, values=values, id=id))

        outbox = Outbox(f"{self.name}, feedback", send, call_soon_threadsafe())

        def publish(message: MessageLike) -> None:
            payload = to_payload(self.type.feedback, message)
            if threading.get_ident() == loop:
                send(payload)
            else:
                outbox.put(payload, payload.kept_size)

        return publish

    async def _run(self, goal: ReceivedGoal) -> None:
        try:
            status, result, reason = await run_goal(self._execute, goal)
            values = RawJson(to_payload(self.type.result, {} if result is None else result).json())
            op = ActionResult(
                action=self.name,
                values=values,
                status=int(status),
                result=True,
                reason=reason or None,
                id=goal.id,
            )
        except Exception as error:
            logger.exception("the action %s failed", self.name)
            reason = str(error) if isinstance(error, RobotError) else EXECUTE_FAILED
            status = GoalStatus.ABORTED
            op = ActionResult(action=self.name, values=reason, status=int(status), result=False, id=goal.id)
        finally:
            # A function in a thread is not cancelled with this task: it looks at `cancel_requested`.
            goal.cancel_event.set()
        # The connection on which the goal was received may be gone.
        if self._goals.get(goal.id) is goal:
            del self._goals[goal.id]
            self._session.send_if_connected(op)
