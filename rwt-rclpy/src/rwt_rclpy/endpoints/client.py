"""`rclpy.client`."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed
from rwt_rclpy.destroyable import Destroyable
from rwt_rclpy.endpoints.introspection import ServiceEndpoint
from rwt_rclpy.endpoints.qos import QoSProfile
from rwt_rclpy.endpoints.serialization import message_of, payload_of
from rwt_rclpy.endpoints.type_variables import SrvType as SrvType
from rwt_rclpy.endpoints.type_variables import SrvTypeRequest as SrvTypeRequest
from rwt_rclpy.endpoints.type_variables import SrvTypeResponse as SrvTypeResponse
from rwt_rclpy.execution.blocking import Wait
from rwt_rclpy.execution.executors import ExternalShutdownException
from rwt_rclpy.execution.task import Future
from rwt_rclpy.logs.logger import get_logger
from rwt_rclpy.release import FROM_KILTED

if TYPE_CHECKING:
    from rwt_rclpy.execution.context import Context
    from rwt_rclpy.nodes.node import Node

#: `service_msgs/ServiceEventInfo`.
REQUEST_SENT, RESPONSE_RECEIVED = 0, 3
#: Polling interval of waits for an entity, in nanoseconds.
LOOK_AGAIN_NS = 10_000_000


class Client(ServiceEndpoint):
    """Client of a service, created by :meth:`Node.create_client`."""

    def __init__(
        self,
        node: Node,
        srv_type: Any,
        srv_name: str,
        full_name: str,
        qos_profile: QoSProfile,
        callback_group: Any,
    ) -> None:
        super().__init__(node, srv_type, srv_name, full_name, qos_profile, callback_group)
        self.context = node.context
        self._handle = Destroyable(self._close)
        self._replies: deque[tuple[int, Payload | CallFailed]] = deque()
        self._pending_requests: dict[int, Future] = {}
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        self._link.clients.add(self)

    def _close(self) -> None:
        self._link.clients.discard(self)
        self._pending_requests.clear()

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Call the service and wait for the response, while an executor spins in another thread.

        Returns:
            The response; None when none came in time, on ROS 2 Jazzy.

        Raises:
            TypeError: the request is of another class.
            TimeoutError: no response came in time, from ROS 2 Kilted on.
            ExternalShutdownException: the context ended before the response arrived.
            InvalidHandle: the client was destroyed.
        """
        wait = Wait(self.context)
        future = self.call_async(request)
        future._rwt_resume_with(wait.wake)
        if wait.until(future.done, timeout_sec):
            return future.result()
        self.remove_pending_request(future)
        if not self.context.ok():
            raise ExternalShutdownException
        if FROM_KILTED:
            raise TimeoutError
        return None

    def call_async(self, request: Any) -> Future:
        """Call the service; the future gets the response from the executor.

        As on ROS, it is never done if no node offers the service, or if the service fails.

        Raises:
            TypeError: the request is of another class.
            InvalidHandle: the client was destroyed.
        """
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"Expected {self.srv_type.Request}, got {type(request)}")
        with self._handle:
            payload = payload_of(request)
            future = Future()
            with self._lock:
                number = next(self._numbers)
                self._pending_requests[number] = future
            future._rwt_resume_with(lambda: self._forget(number))
            if self._steps is not None:
                self._steps.publish(REQUEST_SENT, number, request=request)

            def on_reply(reply: Payload | CallFailed) -> None:
                self._replies.append((number, reply.detach() if isinstance(reply, Payload) else reply))
                self._rwt_wake()

            participant = self._node._rwt_participant
            self._link.post(lambda: participant.call_service(self._name, payload, on_reply))
            return future

    def _forget(self, number: int) -> None:
        self._pending_requests.pop(number, None)

    def get_pending_request(self, sequence_number: int) -> Future:
        """Return the future of a request. Raises KeyError if it is not pending."""
        return self._pending_requests[sequence_number]

    def remove_pending_request(self, future: Future) -> None:
        """Drop a pending request."""
        for number, pending in tuple(self._pending_requests.items()):
            if pending is future:
                self._forget(number)

    def service_is_ready(self) -> bool:
        """True if a node offers the service."""
        with self._handle:
            return self._link.run(lambda: self._link.graph.service(self._name)) is not None

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait until a node offers the service. Returns False after the timeout."""
        return wait_until(self.context, self.service_is_ready, timeout_sec)

    # Interface of executors

    def _rwt_has_work(self) -> bool:
        """True if a response is pending."""
        return bool(self._replies)

    def _rwt_take(self) -> Callable[[], object] | None:
        """Return a function that passes the oldest response to its future."""
        try:
            number, reply = self._replies.popleft()
        except IndexError:
            return None
        future = self._pending_requests.get(number)
        if future is None:
            return None
        executor = self._node.executor

        def settle() -> None:
            future._set_executor(executor)
            if isinstance(reply, Payload):
                response = message_of(reply, self.srv_type.Response)
                if self._steps is not None:
                    self._steps.publish(RESPONSE_RECEIVED, number, response=response)
                future.set_result(response)
            else:  # ROS has no way to say this, so the call stays without a response.
                get_logger("rclpy").debug(f"{self._name}: {reply}")

        return settle


def wait_until(context: Context, ready: Callable[[], bool], timeout_sec: float | None) -> bool:
    """Poll until an entity exists. Returns False after the timeout."""
    keeper = context._rwt_link.timekeeper
    condition = keeper.condition()
    deadline = keeper.deadline(timeout_sec)
    while context.ok():
        if ready():
            return True
        now = keeper.steady_ns()
        if deadline is not None and now >= deadline:
            return False
        again = now + LOOK_AGAIN_NS
        with condition:
            keeper.wait(condition, again if deadline is None else min(again, deadline))
    return False
