"""Endpoints of services that exchange serialised messages.

The middleware has no serialised form of requests and responses. Its own functions convert them, from and to
C structs.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, Literal, NamedTuple

from rwt.extensions.ros2.ament import library
from rwt.extensions.ros2.rcl import CallInfo, RequestId, SerialisedMessage, check, rcl, rmw, taken
from rwt.extensions.ros2.type_supports import type_support


@cache
def _buffer() -> SerialisedMessage:
    """Return the buffer that all conversions share; it belongs to the graph's thread."""
    return SerialisedMessage()


class _Structs:
    """C structs of one message type, by its full name, and their serialised form."""

    def __init__(self, name: str) -> None:
        package, folder, short = name.split("/")
        generator = ctypes.CDLL(library(f"lib{package}__rosidl_generator_c.so"))
        self._name = name
        self._support = type_support(name, "message")
        self._create = generator[f"{package}__{folder}__{short}__create"]
        self._create.restype = ctypes.c_void_p
        self._destroy = generator[f"{package}__{folder}__{short}__destroy"]
        self._destroy.argtypes = (ctypes.c_void_p,)

    @contextmanager
    def empty(self) -> Iterator[int]:
        """Return the address of an empty struct, valid within the context."""
        address = self._create()
        try:
            yield address
        finally:
            self._destroy(address)

    @contextmanager
    def filled(self, data: bytes) -> Iterator[int]:
        """Return the address of a struct with these contents, valid within the context."""
        given = SerialisedMessage()
        given.buffer = ctypes.cast(ctypes.c_char_p(data), ctypes.c_void_p)
        given.length = given.capacity = len(data)
        with self.empty() as address:
            result = rmw().rmw_deserialize(ctypes.byref(given), self._support, address)
            check(result, f"cannot convert a message of type {self._name}")
            yield address

    def serialise(self, address: int) -> bytes:
        """Return the serialised form of a struct."""
        made, capacity = _buffer(), -1
        while made.capacity != capacity:
            capacity = made.capacity
            # Padding is left as it was in memory, also in memory that the middleware adds.
            ctypes.memset(made.buffer, 0, capacity)
            result = rmw().rmw_serialize(address, self._support, ctypes.byref(made))
            check(result, f"cannot convert a message of type {self._name}")
        return made.contents()


_structs = cache(_Structs)


class RawCall(NamedTuple):
    """Serialised request or response, with the id of the request."""

    id: RequestId
    data: bytes


class _RawCalls:
    """Client or service that exchanges serialised messages.

    Args:
        endpoint: client or service of `rclpy`.
        name: name of the service.
        type: full name of the service type.
    """

    _receives: Literal["request", "response"]

    def __init__(self, endpoint: Any, name: str, type: str) -> None:
        self.endpoint = endpoint
        self._name = name
        structs = {kind.lower(): _structs(f"{type}_{kind}") for kind in ("Request", "Response")}
        self._received = structs.pop(self._receives)
        (self._sent,) = structs.values()
        self._take = getattr(rcl(), f"rcl_take_{self._receives}_with_info")

    def take(self) -> RawCall | None:
        """Return the next request or response; None if none is waiting."""
        info = CallInfo()
        with self._received.empty() as message:
            result = self._take(self.endpoint.pointer, ctypes.byref(info), message)
            if not taken(result, f"cannot take a {self._receives} of {self._name}"):
                return None
            return RawCall(info.request_id, self._received.serialise(message))


class RawClient(_RawCalls):
    """Client that exchanges serialised messages."""

    _receives = "response"

    def send(self, request: bytes) -> int:
        """Send a request; return its number."""
        number = ctypes.c_int64()
        with self._sent.filled(request) as message:
            result = rcl().rcl_send_request(self.endpoint.pointer, message, ctypes.byref(number))
            check(result, f"cannot call {self._name}")
        return number.value


class RawService(_RawCalls):
    """Service that exchanges serialised messages."""

    _receives = "request"

    def answer(self, request_id: RequestId, response: bytes) -> None:
        """Send the response to a request."""
        with self._sent.filled(response) as message:
            result = rcl().rcl_send_response(self.endpoint.pointer, ctypes.byref(request_id), message)
            check(result, f"cannot answer a call of {self._name}")
