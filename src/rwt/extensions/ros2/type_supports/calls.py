"""Endpoints of services that exchange serialised messages."""

from __future__ import annotations

import ctypes
from typing import Any, Literal, NamedTuple, Protocol

from rwt.extensions.ros2.rcl import CallInfo, RequestId, check, rcl, taken
from rwt_graph.errors import Ros2Error


class Form(Protocol):
    """Requests or responses of one endpoint, in the form that rcl takes and gives."""

    def fill(self, data: bytes) -> int:
        """Return the address of a message with these contents, valid until :meth:`clear`.

        Raises:
            Ros2Error: they cannot be sent.
        """

    def empty(self) -> int:
        """Return the address of an empty message, valid until :meth:`clear`."""

    def contents(self) -> bytes:
        """Return the contents of a message that rcl has filled; raises Ros2Error."""

    def clear(self) -> None:
        """Release the message."""


class Forms(NamedTuple):
    """Forms of the two messages of one endpoint."""

    request: Form
    response: Form


class RawCall(NamedTuple):
    """Serialised request or response, with the id of the request."""

    id: RequestId
    data: bytes


class _RawCalls:
    """Client or service that exchanges serialised messages.

    Args:
        endpoint: client or service of `rclpy`.
        name: name of the service.
        forms: forms of this endpoint alone, used on one thread.
    """

    _receives: Literal["request", "response"]

    def __init__(self, endpoint: Any, name: str, forms: Forms) -> None:
        self.endpoint = endpoint
        self._name = name
        is_service = self._receives == "request"
        self._received, self._sent = forms if is_service else reversed(forms)
        self._take = getattr(rcl(), f"rcl_take_{self._receives}_with_info")

    def take(self) -> RawCall | Ros2Error | None:
        """Return the next request or response, or the reason why it cannot be read; None if none is waiting.

        What cannot be read is gone: the next one can be taken.
        """
        info = CallInfo()
        try:
            try:
                result = self._take(self.endpoint.pointer, ctypes.byref(info), self._received.empty())
                if not taken(result, f"a {self._receives} of {self._name} cannot be read"):
                    return None
                return RawCall(info.request_id, self._received.contents())
            finally:
                self._received.clear()
        except Ros2Error as error:
            return error


class RawClient(_RawCalls):
    """Client that exchanges serialised messages."""

    _receives = "response"

    def send(self, request: bytes) -> int:
        """Send a request; return its number. Raises Ros2Error."""
        number = ctypes.c_int64()
        try:
            message = self._sent.fill(request)
            result = rcl().rcl_send_request(self.endpoint.pointer, message, ctypes.byref(number))
            check(result, f"cannot call {self._name}")
        finally:
            self._sent.clear()
        return number.value


class RawService(_RawCalls):
    """Service that exchanges serialised messages."""

    _receives = "request"

    def answer(self, request_id: RequestId, response: bytes) -> None:
        """Send the response to a request. Raises Ros2Error."""
        try:
            message = self._sent.fill(response)
            result = rcl().rcl_send_response(self.endpoint.pointer, ctypes.byref(request_id), message)
            check(result, f"cannot answer a call of {self._name}")
        finally:
            self._sent.clear()
