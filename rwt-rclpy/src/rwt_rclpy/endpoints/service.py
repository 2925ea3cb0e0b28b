"""`rclpy.service`."""

from __future__ import annotations

import inspect
import itertools
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from rwt_graph import hold_for_asker
from rwt_interfaces.errors import InvalidMessage
from rwt_rclpy.destroyable import Destroyable
from rwt_rclpy.endpoints.introspection import ServiceEndpoint
from rwt_rclpy.endpoints.qos import QoSProfile
from rwt_rclpy.endpoints.serialization import message_of, payload_of
from rwt_rclpy.endpoints.type_variables import SrvType as SrvType
from rwt_rclpy.endpoints.type_variables import SrvTypeRequest as SrvTypeRequest
from rwt_rclpy.endpoints.type_variables import SrvTypeResponse as SrvTypeResponse

if TYPE_CHECKING:
    from rwt_graph import Release
    from rwt_graph.api import ServiceCall
    from rwt_rclpy.nodes.node import Node

#: `service_msgs/ServiceEventInfo`.
REQUEST_RECEIVED, RESPONSE_SENT = 1, 2


class RequestHeader:
    """Header of a request, for :meth:`Service.send_response`.

    Attributes:
        call: request in the graph.
        sequence_number: number of the request of the service.
        release: releases the caller's charge for the request, on the graph's thread.
    """

    __slots__ = ("call", "release", "sequence_number")

    def __init__(self, call: ServiceCall, sequence_number: int, release: Release) -> None:
        self.call = call
        self.sequence_number = sequence_number
        self.release = release


class Service(ServiceEndpoint):
    """Service of a node, created by :meth:`Node.create_service`.

    Attributes:
        callback: takes a request and a response to fill, and returns the response.
    """

    def __init__(
        self,
        node: Node,
        srv_type: Any,
        srv_name: str,
        full_name: str,
        callback: Callable[..., Any],
        callback_group: Any,
        qos_profile: QoSProfile,
    ) -> None:
        super().__init__(node, srv_type, srv_name, full_name, qos_profile, callback_group)
        self._registration: Any = None
        self._handle = Destroyable(self._close)
        self._calls: deque[RequestHeader] = deque()
        self._numbers = itertools.count(1)
        self.callback = callback

    def _rwt_opened(self, registration: Any) -> None:
        """Set the endpoint of the graph."""
        self._registration = registration

    def _close(self) -> None:
        if self._registration is not None:
            self._link.post(self._registration.close)

    def _rwt_on_call(self, call: ServiceCall) -> None:
        """Queue a request for the executor, on the graph's thread."""
        # Charged as long as it is kept, even if its caller no longer waits.
        self._calls.append(RequestHeader(call, next(self._numbers), hold_for_asker(0)))
        self._rwt_wake()

    def send_response(self, response: Any, header: RequestHeader) -> None:
        """Answer a request. Raises TypeError for another class, InvalidHandle after :meth:`destroy`."""
        self._handle.check()
        if not isinstance(response, self.srv_type.Response):
            raise TypeError(f"Expected {self.srv_type.Response}, got {type(response)}")
        payload = payload_of(response)
        self._link.post(lambda: header.call.reply(payload))
        if self._steps is not None:
            self._steps.publish(RESPONSE_SENT, header.sequence_number, response=response)

    # Interface of executors

    def _rwt_has_work(self) -> bool:
        """True if a request is pending."""
        return bool(self._calls) and bool(self._handle)

    def _rwt_take(self) -> Callable[[], object] | None:
        """Return the callback with the oldest request, which another server may have answered, as on ROS."""
        while self._calls:
            header = self._calls.popleft()
            try:
                request = message_of(header.call.request, self.srv_type.Request)
            except InvalidMessage as error:
                reason = str(error)
                self._link.post(partial(header.call.fail, reason))
                self._link.post(header.release)
                continue
            if self._steps is not None:
                self._steps.publish(REQUEST_RECEIVED, header.sequence_number, request=request)
            return lambda: self._answer(request, header)
        return None

    def _answer(self, request: Any, header: RequestHeader) -> Any:
        try:
            response = self.callback(request, self.srv_type.Response())
            if inspect.isawaitable(response):
                return self._answer_later(response, header)
            self.send_response(response, header)
        except Exception as error:
            self._fail(error, header)
            raise
        self._link.post(header.release)
        return None

    async def _answer_later(self, response: Any, header: RequestHeader) -> None:
        try:
            self.send_response(await response, header)
        except Exception as error:
            self._fail(error, header)
            raise
        self._link.post(header.release)

    def _fail(self, error: Exception, header: RequestHeader) -> None:
        # The exception ends the spin, as on ROS. Callers other than rclpy's hear of it.
        reason = f"{type(error).__name__} in the service's callback"
        self._link.post(lambda: header.call.fail(reason))
        self._link.post(header.release)
