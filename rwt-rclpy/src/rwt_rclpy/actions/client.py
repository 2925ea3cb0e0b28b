"""`rclpy.action.client`: sends goals to servers of this package and of the graph."""

from __future__ import annotations

import uuid
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rwt_graph.api import ClientGoal, GoalEvents
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, GoalRejected
from rwt_participant.goals import GoalStatus
from rwt_rclpy.actions.entity import ActionEntity, uuid_message
from rwt_rclpy.endpoints.client import Client, wait_until
from rwt_rclpy.endpoints.qos import (
    QoSProfile,
    graph_qos,
    qos_profile_action_status_default,
    qos_profile_default,
    qos_profile_services_default,
)
from rwt_rclpy.endpoints.serialization import message_of, payload_of
from rwt_rclpy.endpoints.subscription import Subscription
from rwt_rclpy.endpoints.type_support import message_type
from rwt_rclpy.exceptions import RCLError
from rwt_rclpy.execution.blocking import Wait
from rwt_rclpy.execution.executors import ExternalShutdownException
from rwt_rclpy.execution.task import Future
from rwt_rclpy.execution.waitable import NumberOfEntities
from rwt_rclpy.messages.loaded import message_class

if TYPE_CHECKING:
    from rwt_rclpy.nodes.node import Node


class ClientGoalHandle:
    """Goal that was sent."""

    def __init__(self, action_client: ActionClient, goal_id: Any, goal_response: Any) -> None:
        self._action_client = action_client
        self._goal_id = goal_id
        self._goal_response = goal_response
        self._status = int(GoalStatus.UNKNOWN)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ClientGoalHandle) and self._goal_id == other._goal_id

    def __repr__(self) -> str:
        return f"ClientGoalHandle <id={self.goal_id.uuid}, accepted={self.accepted}, status={self.status}>"

    @property
    def goal_id(self) -> Any:
        """Id of the goal, a `unique_identifier_msgs/UUID`."""
        return self._goal_id

    @property
    def stamp(self) -> Any:
        """Time of acceptance."""
        return self._goal_response.stamp

    @property
    def accepted(self) -> bool:
        """True if the server has accepted the goal."""
        return bool(self._goal_response.accepted)

    @property
    def status(self) -> int:
        """Last known state, a number of `action_msgs/GoalStatus`."""
        return self._status

    def cancel_goal(self) -> Any:
        """Request cancellation, and wait for the response while an executor spins in another thread."""
        return self._action_client._wait(self.cancel_goal_async())

    def cancel_goal_async(self) -> Future:
        """Request cancellation; the future gets an `action_msgs/srv/CancelGoal` response."""
        return self._action_client._cancel_goal_async(self)

    def get_result(self) -> Any:
        """Wait for the result, while an executor spins in another thread."""
        return self._action_client._wait(self.get_result_async())

    def get_result_async(self) -> Future:
        """Request the result; the future gets a response with `status` and `result`."""
        return self._action_client._get_result_async(self)


class _GraphGoal:
    """Goal that was sent through the graph's own actions."""

    def __init__(self) -> None:
        self.goal: ClientGoal | None = None
        self.response: Any = None
        self.waiting: list[Future] = []


class ActionClient(ActionEntity):
    """Client of one action.

    Args:
        node: the node.
        action_type: class of the action.
        action_name: name of the action.
        callback_group: group of its callbacks.
    """

    _what = "action client"

    def __init__(
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        *,
        callback_group: Any = None,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_sub_qos_profile: QoSProfile = qos_profile_default,
        status_sub_qos_profile: QoSProfile = qos_profile_action_status_default,
    ) -> None:
        super().__init__(node, action_type, action_name, callback_group)
        self._goal_handles: dict[bytes, weakref.ref[ClientGoalHandle]] = {}
        self._feedback_callbacks: dict[bytes, Callable[[Any], object]] = {}
        self._graph_goals: dict[bytes, _GraphGoal] = {}
        impl = action_type.Impl
        self._send, self._cancel, self._result = (
            self._client(kind, short, profile)
            for kind, short, profile in (
                (impl.SendGoalService, "send_goal", goal_service_qos_profile),
                (impl.CancelGoalService, "cancel_goal", cancel_service_qos_profile),
                (impl.GetResultService, "get_result", result_service_qos_profile),
            )
        )
        self._subscriptions = (
            self._subscription(impl.FeedbackMessage, "feedback", self._on_feedback, feedback_sub_qos_profile),
            self._subscription(impl.GoalStatusMessage, "status", self._on_status, status_sub_qos_profile),
        )
        self._join()

    def _client(self, kind: Any, short: str, profile: QoSProfile) -> Client:
        name = f"{self._name}/_action/{short}"
        client = Client(self._node, kind, name, name, profile, self.callback_group)
        client._rwt_wake = self._wake
        return client

    def _subscription(
        self, kind: Any, short: str, callback: Callable[..., object], profile: QoSProfile
    ) -> Subscription:
        name = f"{self._name}/_action/{short}"
        subscription = Subscription(
            self._link, kind, name, callback, self.callback_group, profile, False, [], lambda: 0
        )
        subscription._rwt_wake = self._wake
        interface, qos, participant = message_type(kind), graph_qos(profile), self._node._rwt_participant
        subscription._rwt_opened(
            self._link.run(lambda: participant.subscribe(name, subscription._rwt_on_sample, interface, qos))
        )
        return subscription

    def _wait(self, future: Future) -> Any:
        wait = Wait(self._node.context)
        future._rwt_resume_with(wait.wake)
        if not wait.until(future.done):
            raise ExternalShutdownException
        return future.result()

    # Goals

    def send_goal(
        self,
        goal: Any,
        feedback_callback: Callable[[Any], object] | None = None,
        goal_uuid: Any = None,
    ) -> Any:
        """Send a goal and wait for its result, while an executor spins in another thread.

        Returns:
            The response with `status` and `result`; None if the goal was rejected.

        Raises:
            TypeError: the goal is of another class.
            ExternalShutdownException: the context ended before the result came.
        """
        handle = self._wait(self.send_goal_async(goal, feedback_callback, goal_uuid))
        return handle.get_result() if handle.accepted else None

    def send_goal_async(
        self,
        goal: Any,
        feedback_callback: Callable[[Any], object] | None = None,
        goal_uuid: Any = None,
    ) -> Future:
        """Send a goal; the future gets a :class:`ClientGoalHandle`.

        Args:
            feedback_callback: takes messages with `goal_id` and `feedback`.
            goal_uuid: `unique_identifier_msgs/UUID` of the goal; generated by default.

        Raises:
            TypeError: the goal is of another class.
            RCLError: the client was destroyed.
        """
        if not isinstance(goal, self._action_type.Goal):
            raise TypeError(f"Expected goal type ({self._action_type.Goal}) but received ({type(goal)})")
        if not self._handle:
            raise RCLError("Error sending goal request: the action client was destroyed")
        goal_id = goal_uuid or uuid_message(uuid.uuid4().bytes)
        key = bytes(goal_id.uuid)
        if feedback_callback is not None:
            self._feedback_callbacks[key] = feedback_callback
        handed = Future()
        if not self._send.service_is_ready() and self._is_of_graph():
            self._send_to_graph(goal, goal_id, handed)
            return handed
        request = self._action_type.Impl.SendGoalService.Request(goal_id=goal_id, goal=goal)
        self._send.call_async(request).add_done_callback(
            lambda future: self._answered(goal_id, future, handed)
        )
        return handed

    def _answered(self, goal_id: Any, future: Future, handed: Future) -> None:
        error = future.exception()
        handed._set_executor(self._node.executor)
        if error is not None:
            handed.set_exception(error)
            return
        self._hand_over(goal_id, future.result(), handed)

    def _hand_over(self, goal_id: Any, response: Any, handed: Future) -> None:
        handle = ClientGoalHandle(self, goal_id, response)
        key = bytes(goal_id.uuid)
        if handle.accepted:
            self._goal_handles[key] = weakref.ref(handle)
        else:
            self._feedback_callbacks.pop(key, None)
        handed._set_executor(self._node.executor)
        handed.set_result(handle)

    def _cancel_goal_async(self, goal_handle: ClientGoalHandle) -> Future:
        if not isinstance(goal_handle, ClientGoalHandle):
            raise TypeError(f"Expected type ClientGoalHandle but received {type(goal_handle)}")
        info = message_class("action_msgs/GoalInfo")(goal_id=goal_handle.goal_id)
        graph_goal = self._graph_goals.get(bytes(goal_handle.goal_id.uuid))
        if graph_goal is not None and graph_goal.goal is not None:
            self._link.post(graph_goal.goal.cancel)
            future = Future(executor=self._node.executor)
            future.set_result(self._action_type.Impl.CancelGoalService.Response(goals_canceling=[info]))
            return future
        return self._cancel.call_async(self._action_type.Impl.CancelGoalService.Request(goal_info=info))

    def _get_result_async(self, goal_handle: ClientGoalHandle) -> Future:
        if not isinstance(goal_handle, ClientGoalHandle):
            raise TypeError(f"Expected type ClientGoalHandle but received {type(goal_handle)}")
        key = bytes(goal_handle.goal_id.uuid)
        graph_goal = self._graph_goals.get(key)
        if graph_goal is not None:
            future = Future(executor=self._node.executor)
            if graph_goal.response is None:
                graph_goal.waiting.append(future)
            else:
                self._settle(future, graph_goal.response)
            return future
        request = self._action_type.Impl.GetResultService.Request(goal_id=goal_handle.goal_id)
        future = self._result.call_async(request)
        # Referenced by the future's callback: the state of the goal is tracked while a program waits.
        future.add_done_callback(lambda done: self._ended(goal_handle, done))
        return future

    def _ended(self, goal_handle: ClientGoalHandle, future: Future) -> None:
        if future.exception() is None:
            goal_handle._status = future.result().status
        self._feedback_callbacks.pop(bytes(goal_handle.goal_id.uuid), None)

    def _on_feedback(self, message: Any) -> Any:
        callback = self._feedback_callbacks.get(bytes(message.goal_id.uuid))
        # Also before the acceptance is delivered, possibly by another thread of an executor.
        return None if callback is None else callback(message)

    def _on_status(self, message: Any) -> None:
        for status in message.status_list:
            self._set_status(status.goal_info.goal_id, status.status)

    def _set_status(self, goal_id: Any, status: int) -> None:
        weak = self._goal_handles.get(bytes(goal_id.uuid))
        handle = None if weak is None else weak()
        if handle is not None:
            handle._status = status

    # Servers of the graph's own actions

    def _is_of_graph(self) -> bool:
        return self._link.run(lambda: self._link.graph.action(self._name)) is not None

    def _send_to_graph(self, goal: Any, goal_id: Any, handed: Future) -> None:
        key = bytes(goal_id.uuid)
        record = self._graph_goals[key] = _GraphGoal()
        payload = payload_of(goal)

        def accepted() -> None:
            response = self._action_type.Impl.SendGoalService.Response(accepted=True)
            self._later(lambda: self._hand_over(goal_id, response, handed))

        def ended(status: GoalStatus, outcome: Payload | CallFailed) -> None:
            kept = outcome.detach() if isinstance(outcome, Payload) else outcome
            self._later(lambda: self._graph_ended(record, goal_id, status, kept, handed))

        def feedback(payload: Payload) -> None:
            kept = payload.detach()
            self._later(lambda: self._graph_feedback(goal_id, kept))

        events = GoalEvents(ended, feedback, accepted)
        participant = self._node._rwt_participant
        record.goal = self._link.run(lambda: participant.send_goal(self._name, payload, events, key.hex()))

    def _graph_feedback(self, goal_id: Any, payload: Payload) -> Any:
        callback = self._feedback_callbacks.get(bytes(goal_id.uuid))
        if callback is None:
            return None
        feedback = message_of(payload, self._action_type.Feedback)
        return callback(self._action_type.Impl.FeedbackMessage(goal_id=goal_id, feedback=feedback))

    def _graph_ended(
        self,
        record: _GraphGoal,
        goal_id: Any,
        status: GoalStatus,
        outcome: Payload | CallFailed,
        handed: Future,
    ) -> None:
        if not handed.done():
            response = self._action_type.Impl.SendGoalService.Response(accepted=False)
            self._node.get_logger().warning(f"{self._name}: {outcome}")
            self._hand_over(goal_id, response, handed)
            return
        if isinstance(outcome, GoalRejected):  # rosbridge reports a rejection only as the end of the goal.
            self._node.get_logger().warning(f"{self._name}: {outcome}")
            record.response = self._action_type.Impl.GetResultService.Response(status=int(status))
        elif isinstance(outcome, CallFailed):
            record.response = outcome
        else:
            record.response = self._action_type.Impl.GetResultService.Response(
                status=int(status), result=message_of(outcome, self._action_type.Result)
            )
        self._set_status(goal_id, int(status))
        for future in record.waiting:
            self._settle(future, record.response)

    @staticmethod
    def _settle(future: Future, response: Any) -> None:
        if isinstance(response, CallFailed):
            future.set_exception(response)
        else:
            future.set_result(response)

    # Servers

    def server_is_ready(self) -> bool:
        """True if a server offers the action."""
        with self._handle:
            return self._send.service_is_ready() or self._is_of_graph()

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        """Wait until a server offers the action. Returns False after the timeout."""
        return wait_until(self._node.context, self.server_is_ready, timeout_sec)

    # Interface of executors

    def _parts(self) -> tuple[Client | Subscription, ...]:
        # Feedback before results, after which it is not delivered any more.
        return (self._send, self._cancel, *self._subscriptions, self._result)

    def get_num_entities(self) -> NumberOfEntities:
        """Return the numbers of two subscriptions and three clients."""
        return NumberOfEntities(num_subscriptions=2, num_clients=3)

    def _close(self) -> None:
        for part in self._parts():
            part.destroy()
