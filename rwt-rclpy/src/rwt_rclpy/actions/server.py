"""`rclpy.action.server`: action servers.

Clients reach it as ROS 2 carries actions, by three services and two topics below `<action>/_action`, and as
an action of the graph, by which bridges and the programs of this project send goals.
"""

from __future__ import annotations

import functools
import threading
import traceback
from collections.abc import Callable, Iterator
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, Any, Final

from rwt_graph.errors import InvalidTransition
from rwt_participant.goals import GoalStatus
from rwt_rclpy.actions.entity import ActionEntity, uuid_message
from rwt_rclpy.clocks.clock import Clock
from rwt_rclpy.clocks.time import ClockType
from rwt_rclpy.endpoints.qos import (
    QoSProfile,
    qos_profile_action_status_default,
    qos_profile_default,
    qos_profile_services_default,
)
from rwt_rclpy.endpoints.serialization import message_of, payload_of
from rwt_rclpy.endpoints.service import RequestHeader, Service
from rwt_rclpy.endpoints.type_support import service_type
from rwt_rclpy.exceptions import RCLError
from rwt_rclpy.execution.executors import await_or_execute
from rwt_rclpy.execution.task import Future
from rwt_rclpy.execution.waitable import NumberOfEntities
from rwt_rclpy.messages.loaded import message_class

if TYPE_CHECKING:
    from rwt_graph import Release
    from rwt_graph.api import ServerGoal
    from rwt_rclpy.nodes.node import Node


class GoalResponse(Enum):
    """Decision on a new goal."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """Decision on a cancel request."""

    REJECT = 1
    ACCEPT = 2


class GoalEvent(IntEnum):
    """Event in the life of a goal."""

    EXECUTE = 0
    CANCEL_GOAL = 1
    SUCCEED = 2
    ABORT = 3
    CANCELED = 4


#: Allowed transitions (ROS 2's design article "Actions").
TRANSITIONS: Final = {
    (GoalStatus.ACCEPTED, GoalEvent.EXECUTE): GoalStatus.EXECUTING,
    (GoalStatus.ACCEPTED, GoalEvent.CANCEL_GOAL): GoalStatus.CANCELING,
    (GoalStatus.EXECUTING, GoalEvent.CANCEL_GOAL): GoalStatus.CANCELING,
    (GoalStatus.EXECUTING, GoalEvent.SUCCEED): GoalStatus.SUCCEEDED,
    (GoalStatus.EXECUTING, GoalEvent.ABORT): GoalStatus.ABORTED,
    (GoalStatus.CANCELING, GoalEvent.SUCCEED): GoalStatus.SUCCEEDED,
    (GoalStatus.CANCELING, GoalEvent.ABORT): GoalStatus.ABORTED,
    (GoalStatus.CANCELING, GoalEvent.CANCELED): GoalStatus.CANCELED,
}


class RequestQueue(Service):
    """Service whose callback gets the request's header, and may respond later.

    The caller is charged for the request until it is answered; for a goal that is accepted, until that ends.
    """

    def _answer(self, request: Any, header: RequestHeader) -> Any:
        return self.callback(request, header)

    def answer(self, response: Any, header: RequestHeader) -> None:
        """Answer a request, and release its charge."""
        self.send_response(response, header)
        self._link.post(header.release)


class ServerGoalHandle:
    """Accepted goal."""

    def __init__(
        self,
        action_server: ActionServer,
        goal_info: Any,
        goal_request: Any,
        graph_goal: ServerGoal | None = None,
    ) -> None:
        self._action_server = action_server
        self._goal_info = goal_info
        self._goal_request = goal_request
        self._graph_goal = graph_goal
        self._status = GoalStatus.ACCEPTED
        self._destroyed = False
        self._lock = threading.Lock()
        self._rwt_expires_ns: int | None = None
        #: Releases the charge of the goal's client.
        self._rwt_release: Release | None = None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ServerGoalHandle) and self.goal_id == other.goal_id

    @property
    def request(self) -> Any:
        """Message of the goal."""
        return self._goal_request

    @property
    def goal_id(self) -> Any:
        """Its `unique_identifier_msgs/UUID`."""
        return self._goal_info.goal_id

    @property
    def is_active(self) -> bool:
        """True until the goal has ended."""
        return not self._destroyed and not self._status.is_terminal

    @property
    def is_cancel_requested(self) -> bool:
        """True if cancellation was requested."""
        return self.status == GoalStatus.CANCELING

    @property
    def status(self) -> int:
        """State, a number of `action_msgs/GoalStatus`."""
        return int(GoalStatus.UNKNOWN if self._destroyed else self._status)

    def _update_state(self, event: GoalEvent) -> None:
        with self._lock:
            if self._destroyed:
                return
            after = TRANSITIONS.get((self._status, event))
            if after is None:
                raise RCLError(
                    f"Failed to update goal state: goal_handle attempted invalid transition from state"
                    f" {self._status.name} with event {event.name}"
                )
            self._status = after
        self._action_server._rwt_publish_status()
        if not self.is_active:
            self._action_server.notify_goal_done(self)

    def execute(self, execute_callback: Callable[..., Any] | None = None) -> None:
        """Start to execute the goal."""
        if not self.is_cancel_requested:
            self._update_state(GoalEvent.EXECUTE)
        self._action_server.notify_execute(self, execute_callback)

    def publish_feedback(self, feedback: Any) -> None:
        """Send feedback. Raises TypeError for another class."""
        server = self._action_server
        if not isinstance(feedback, server.action_type.Feedback):
            raise TypeError(f"Expected {server.action_type.Feedback}, got {type(feedback)}")
        if not self._destroyed:
            server._rwt_send_feedback(self, feedback)

    def succeed(self, response: Any = None) -> None:
        """End the goal as succeeded. Raises RCLError if its state does not allow this."""
        self._update_state(GoalEvent.SUCCEED)

    def abort(self, response: Any = None) -> None:
        """End the goal as aborted. Raises RCLError if its state does not allow this."""
        self._update_state(GoalEvent.ABORT)

    def canceled(self, response: Any = None) -> None:
        """End the goal as canceled. Raises RCLError if its state does not allow this."""
        self._update_state(GoalEvent.CANCELED)

    def destroy(self) -> None:
        """Destroy the handle."""
        self._destroyed = True


def default_handle_accepted_callback(goal_handle: ServerGoalHandle) -> None:
    """Execute the goal."""
    goal_handle.execute()


def default_goal_callback(goal_request: Any) -> GoalResponse:
    """Accept every goal."""
    return GoalResponse.ACCEPT


def default_cancel_callback(cancel_request: Any) -> CancelResponse:
    """Reject every cancel request."""
    return CancelResponse.REJECT


class ActionServer(ActionEntity):
    """Server of one action of a node.

    Args:
        node: the node.
        action_type: the class of the action.
        action_name: its name.
        execute_callback: executes a goal; takes a :class:`ServerGoalHandle`, returns the result.
        callback_group: which callbacks may run beside its own.
        goal_callback: takes the message of a goal, returns whether it is accepted.
        handle_accepted_callback: called with each accepted goal; executes it by default.
        cancel_callback: takes a :class:`ServerGoalHandle`, returns whether it will be canceled.
        result_timeout: seconds for which results are kept; negative: as long as the server exists.
    """

    _what = "action server"

    def __init__(
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        execute_callback: Callable[..., Any],
        *,
        callback_group: Any = None,
        goal_callback: Callable[..., Any] = default_goal_callback,
        handle_accepted_callback: Callable[..., Any] = default_handle_accepted_callback,
        cancel_callback: Callable[..., Any] = default_cancel_callback,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_pub_qos_profile: QoSProfile = qos_profile_default,
        status_pub_qos_profile: QoSProfile = qos_profile_action_status_default,
        result_timeout: float = 900,
    ) -> None:
        super().__init__(node, action_type, action_name, callback_group)
        self.register_handle_accepted_callback(handle_accepted_callback)
        self.register_goal_callback(goal_callback)
        self.register_cancel_callback(cancel_callback)
        self.register_execute_callback(execute_callback)
        self._goal_handles: dict[bytes, ServerGoalHandle] = {}
        self._result_futures: dict[bytes, Future] = {}
        self._result_timeout = result_timeout
        self._clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._logger = node.get_logger().get_child("action_server")
        name, impl, make = self._name, action_type.Impl, node.create_publisher
        self._feedback = make(impl.FeedbackMessage, f"{name}/_action/feedback", feedback_pub_qos_profile)
        self._status = make(impl.GoalStatusMessage, f"{name}/_action/status", status_pub_qos_profile)
        self._services = tuple(
            self._service(kind, f"{name}/_action/{short}", callback, profile)
            for kind, short, callback, profile in (
                (impl.CancelGoalService, "cancel_goal", self._on_cancel, cancel_service_qos_profile),
                (impl.GetResultService, "get_result", self._on_get_result, result_service_qos_profile),
                (impl.SendGoalService, "send_goal", self._on_send_goal, goal_service_qos_profile),
            )
        )
        self._registration = self._link.run(self._advertise)
        self._join()

    def _advertise(self) -> Any:
        """Offer the action and its services in one turn of the graph, so that no goal comes between them."""
        participant = self._node._rwt_participant
        # The graph's action comes first: its own services are displaced by those here.
        registration = participant.advertise_action(self._name, self._interface, self._on_graph_goal)
        for service in self._services:
            kind = service_type(service.srv_type)
            service._rwt_opened(participant.advertise_service(service.srv_name, kind, service._rwt_on_call))
        return registration

    def _service(
        self, kind: Any, name: str, callback: Callable[..., Any], profile: QoSProfile
    ) -> RequestQueue:
        service = RequestQueue(self._node, kind, name, name, callback, self.callback_group, profile)
        service._rwt_wake = self._wake
        return service

    @property
    def action_type(self) -> Any:
        """Class of the action."""
        return self._action_type

    # Callbacks of the program

    def register_handle_accepted_callback(self, callback: Callable[..., Any] | None) -> None:
        """Set the callback for accepted goals; None executes them."""
        self._handle_accepted_callback = callback or default_handle_accepted_callback

    def register_goal_callback(self, callback: Callable[..., Any] | None) -> None:
        """Set the callback that accepts goals; None accepts all."""
        self._goal_callback = callback or default_goal_callback

    def register_cancel_callback(self, callback: Callable[..., Any] | None) -> None:
        """Set the callback that accepts cancel requests; None rejects all."""
        self._cancel_callback = callback or default_cancel_callback

    def register_execute_callback(self, callback: Callable[..., Any]) -> None:
        """Set the callback that executes goals. Raises TypeError if it is not callable."""
        if not callable(callback):
            raise TypeError("Failed to register goal execution callback: not callable")
        self._execute_callback = callback

    # Goals

    async def _take_goal(
        self, goal_id: bytes, goal: Any, graph_goal: ServerGoal | None
    ) -> ServerGoalHandle | None:
        """Ask the program about a goal; return its handle, or None if it is rejected."""
        if goal_id in self._goal_handles:
            return None
        answer = await await_or_execute(self._goal_callback, goal)
        if not isinstance(answer, GoalResponse):
            self._logger.warning("Goal request callback did not return a GoalResponse type. Rejecting goal.")
            return None
        if answer is not GoalResponse.ACCEPT:
            return None
        info = message_class("action_msgs/GoalInfo")(
            goal_id=uuid_message(goal_id), stamp=self._node.get_clock().now().to_msg()
        )
        handle = ServerGoalHandle(self, info, goal, graph_goal)
        self._goal_handles[goal_id] = handle
        self._result_futures[goal_id] = Future()
        self._rwt_publish_status()
        return handle

    async def _on_send_goal(self, request: Any, header: RequestHeader) -> None:
        goal_id = bytes(request.goal_id.uuid)
        handle = await self._take_goal(goal_id, request.goal, None)
        response: Any = self._action_type.Impl.SendGoalService.Response()
        response.accepted = handle is not None
        if handle is None:
            self._services[2].answer(response, header)
            return
        handle._rwt_release = header.release
        response.stamp = handle._goal_info.stamp
        self._services[2].send_response(response, header)
        await await_or_execute(self._handle_accepted_callback, handle)

    def _on_graph_goal(self, goal: ServerGoal) -> None:
        payload = goal.goal.detach()
        goal_id = bytes.fromhex(goal.id)
        goal.on_cancel = lambda: self._later(lambda: self._cancel_of_graph(goal_id))
        self._later(lambda: self._consider(goal, goal_id, message_of(payload, self._action_type.Goal)))

    async def _consider(self, goal: ServerGoal, goal_id: bytes, message: Any) -> None:
        handle = await self._take_goal(goal_id, message, goal)
        if handle is None:
            self._link.post(lambda: goal.reject(f"the action server of {self._name} rejected the goal"))
            return
        self._link.post(goal.accept)
        await await_or_execute(self._handle_accepted_callback, handle)

    async def _cancel_of_graph(self, goal_id: bytes) -> None:
        handle = self._goal_handles.get(goal_id)
        if handle is not None:
            await self._ask_to_cancel(handle)

    async def _ask_to_cancel(self, handle: ServerGoalHandle) -> bool:
        if await await_or_execute(self._cancel_callback, handle) is not CancelResponse.ACCEPT:
            return False
        try:
            handle._update_state(GoalEvent.CANCEL_GOAL)
        except RCLError as error:
            self._logger.debug(f"a goal has ended before it could be cancelled: {error}")
            return False
        return True

    async def _on_cancel(self, request: Any, header: RequestHeader) -> None:
        response: Any = self._action_type.Impl.CancelGoalService.Response()
        chosen, response.return_code = self._to_cancel(request.goal_info)
        accepted = [handle for handle in chosen if await self._ask_to_cancel(handle)]
        response.goals_canceling = [handle._goal_info for handle in accepted]
        self._services[0].answer(response, header)

    def _to_cancel(self, info: Any) -> tuple[list[ServerGoalHandle], int]:
        """Return the goals of a cancel request, by id, up to a time, or all; and the error if none."""
        wanted = bytes(info.goal_id.uuid)
        stamp = (info.stamp.sec, info.stamp.nanosec)
        response: Any = self._action_type.Impl.CancelGoalService.Response
        named = self._goal_handles.get(wanted)
        if any(wanted) and named is None:
            return [], response.ERROR_UNKNOWN_GOAL_ID
        if named is not None and not named.is_active and stamp == (0, 0):
            return [], response.ERROR_GOAL_TERMINATED
        chosen = [
            handle
            for goal_id, handle in self._goal_handles.items()
            if handle.is_active
            and (
                goal_id == wanted
                or (not any(wanted) and stamp == (0, 0))
                or (stamp != (0, 0) and _stamp(handle) <= stamp)
            )
        ]
        return chosen, response.ERROR_NONE

    async def _on_get_result(self, request: Any, header: RequestHeader) -> None:
        goal_id = bytes(request.goal_id.uuid)
        future = self._result_futures.get(goal_id)
        if future is None:
            response: Any = self._action_type.Impl.GetResultService.Response()
            response.status = int(GoalStatus.UNKNOWN)
            self._services[1].answer(response, header)
            return
        future.add_done_callback(functools.partial(self._send_result, header))

    def _send_result(self, header: RequestHeader, future: Future) -> None:
        self._services[1].answer(future.result(), header)

    async def _execute_goal(self, execute_callback: Callable[..., Any], handle: ServerGoalHandle) -> None:
        try:
            result = await await_or_execute(execute_callback, handle)
        except Exception as error:
            self._logger.error(f"Error raised in execute callback: {error}")
            traceback.print_exc()
            result = self._action_type.Result()
        if result is None:
            raise AttributeError("the execute callback returned None, not a result")
        if handle.is_active:
            self._logger.warning(
                "Goal state not set, assuming aborted. Goal ID: " + bytes(handle.goal_id.uuid).hex()
            )
            handle.abort()
        status = handle._status
        response: Any = self._action_type.Impl.GetResultService.Response()
        response.status = int(status)
        response.result = result
        future = self._result_futures.get(bytes(handle.goal_id.uuid))
        if future is not None:
            future._set_executor(self._node.executor)
            future.set_result(response)
        goal = handle._graph_goal
        if goal is not None:
            payload = payload_of(result)
            self._link.post(functools.partial(self._finish, goal, status, payload))

    def _finish(self, goal: ServerGoal, status: GoalStatus, payload: Any) -> None:
        try:
            goal.finish(status, payload)
        except InvalidTransition as error:
            self._logger.debug(f"the goal had ended in the graph: {error}")

    # Interface of goals

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: Callable[..., Any] | None
    ) -> None:
        """Execute a goal in the executor."""
        call = execute_callback or self._execute_callback
        executor = self._node.executor
        if executor is None:
            self._later(lambda: self._execute_goal(call, goal_handle))
        else:
            executor.create_task(self._execute_goal, call, goal_handle)

    def notify_goal_done(self, goal_handle: ServerGoalHandle) -> None:
        """End a goal: keep its result for a time, and release its charge."""
        self._charge_no_more(goal_handle)
        if self._result_timeout >= 0:
            now = self._clock.handle.now_ns()
            goal_handle._rwt_expires_ns = now + int(self._result_timeout * 1e9)
        self._rwt_wake()

    def _charge_no_more(self, handle: ServerGoalHandle) -> None:
        release, handle._rwt_release = handle._rwt_release, None
        if release is not None:
            self._link.post(release)

    def _rwt_send_feedback(self, goal_handle: ServerGoalHandle, feedback: Any) -> None:
        """Send the feedback of a goal to all subscribers."""
        message: Any = self._action_type.Impl.FeedbackMessage()
        message.goal_id = goal_handle.goal_id
        message.feedback = feedback
        self._feedback.publish(message)
        goal = goal_handle._graph_goal
        if goal is not None:
            payload = payload_of(feedback)
            self._link.post(lambda: goal.feedback(payload))

    def _rwt_publish_status(self) -> None:
        """Publish the states of all goals."""
        status = message_class("action_msgs/GoalStatus")
        self._status.publish(
            self._action_type.Impl.GoalStatusMessage(
                status_list=[
                    status(goal_info=handle._goal_info, status=handle.status)
                    for handle in tuple(self._goal_handles.values())
                ]
            )
        )

    # What an executor asks

    def _rwt_has_work(self) -> bool:
        """True if a request is pending, or a result has expired."""
        due = self._rwt_due_in_ns() if self._handle else None
        return super()._rwt_has_work() or (due is not None and due <= 0)

    def _parts(self) -> Iterator[RequestQueue]:
        return reversed(self._services)

    def _rwt_due_in_ns(self) -> int | None:
        """Return the nanoseconds until a result expires."""
        ends = [
            each._rwt_expires_ns
            for each in tuple(self._goal_handles.values())
            if each._rwt_expires_ns is not None
        ]
        return min(ends) - self._clock.handle.now_ns() if ends else None

    def _rwt_take(self) -> Callable[[], object] | None:
        """Return the oldest request; without one, forget results that have expired."""
        call = super()._rwt_take()
        if call is None:
            self._forget_expired()
        return call

    def _forget_expired(self) -> None:
        now = self._clock.handle.now_ns()
        for goal_id, handle in tuple(self._goal_handles.items()):
            if handle._rwt_expires_ns is not None and handle._rwt_expires_ns <= now:
                handle.destroy()
                del self._goal_handles[goal_id]
                self._result_futures.pop(goal_id, None)

    def get_num_entities(self) -> NumberOfEntities:
        """Return the numbers of three services, and a timer for results."""
        return NumberOfEntities(num_timers=1, num_services=3)

    def _close(self) -> None:
        """Withdraw the action; active goals end as aborted for clients of the graph."""
        for handle in self._goal_handles.values():
            self._charge_no_more(handle)
            handle.destroy()
        self._node.destroy_publisher(self._feedback)
        self._node.destroy_publisher(self._status)
        for service in self._services:
            service.destroy()
        self._link.post(self._registration.close)


def _stamp(handle: ServerGoalHandle) -> tuple[int, int]:
    stamp = handle._goal_info.stamp
    return stamp.sec, stamp.nanosec
