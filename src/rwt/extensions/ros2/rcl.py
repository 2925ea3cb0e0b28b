"""Functions and structures of rcl and the middleware that `rclpy` does not offer."""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Callable
from functools import cache
from typing import Any, Final, NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from rwt.extensions.ros2.ament import library
from rwt_graph.errors import Ros2Error

#: Bytes of a GID that ROS 2 compares, of up to 24 that a middleware stores.
GID_BYTES: Final = 16

#: Name of M_ARENA_MAX for `mallopt`.
_ARENA_MAX: Final = -8

#: RCL_RET_…_TAKE_FAILED of subscriptions, clients and services: nothing is waiting.
_NOTHING: Final = (401, 501, 601)


class Gid(ctypes.Structure):
    """`rmw_gid_t`."""

    _fields_ = (("implementation", ctypes.c_char_p), ("data", ctypes.c_uint8 * 24))


class MessageInfo(ctypes.Structure):
    """`rmw_message_info_t`."""

    _fields_ = (
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("publication_sequence_number", ctypes.c_uint64),
        ("reception_sequence_number", ctypes.c_uint64),
        ("publisher_gid", Gid),
        ("from_intra_process", ctypes.c_bool),
    )


class RequestId(ctypes.Structure):
    """`rmw_request_id_t`."""

    _fields_ = (("client", ctypes.c_int8 * GID_BYTES), ("number", ctypes.c_int64))


class CallInfo(ctypes.Structure):
    """`rmw_service_info_t`."""

    _fields_ = (
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("request_id", RequestId),
    )


class _Allocator(ctypes.Structure):
    """`rcutils_allocator_t`."""

    _fields_ = tuple(
        (name, ctypes.c_void_p) for name in ("allocate", "deallocate", "reallocate", "zero_allocate", "state")
    )


class SerialisedMessage(ctypes.Structure):
    """`rcutils_uint8_array_t`, empty at first, which the middleware enlarges."""

    _fields_ = (
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    )

    def __init__(self) -> None:
        default = rcutils().rcutils_get_default_allocator
        default.restype = _Allocator
        super().__init__(None, 0, 0, default())

    def __enter__(self) -> SerialisedMessage:
        return self

    def __exit__(self, *_: object) -> None:
        """Free the memory; an object that is used for as long as the process lives need not be left."""
        rcutils().rcutils_uint8_array_fini(ctypes.byref(self))

    def contents(self) -> bytes:
        """Return a copy."""
        return ctypes.string_at(self.buffer, self.length)


@cache
def rcl() -> ctypes.CDLL:
    """Return the library rcl; functions without `argtypes` are given Python's integers as `int`."""
    loaded = ctypes.CDLL(library("librcl.so"))
    pointer = ctypes.c_void_p
    loaded.rcl_publisher_get_rmw_handle.restype = pointer
    loaded.rcl_publisher_get_rmw_handle.argtypes = (pointer,)
    loaded.rcl_take_serialized_message.argtypes = (pointer,) * 4
    loaded.rcl_send_request.argtypes = (pointer,) * 3
    for name in ("rcl_take_response_with_info", "rcl_take_request_with_info", "rcl_send_response"):
        getattr(loaded, name).argtypes = (pointer,) * 3
    return loaded


def middleware() -> str:
    """Return the name of the middleware, such as `rmw_fastrtps_cpp`."""
    return str(_rclpy.rclpy_get_rmw_implementation_identifier())


@cache
def rmw() -> ctypes.CDLL:
    """Return the library of the middleware."""
    loaded = ctypes.CDLL(library(f"lib{middleware()}.so"))
    pointer = ctypes.c_void_p
    loaded.rmw_get_gid_for_publisher.argtypes = (pointer,) * 2
    loaded.rmw_serialize.argtypes = (pointer,) * 3
    loaded.rmw_deserialize.argtypes = (pointer,) * 3
    return loaded


@cache
def rcutils() -> ctypes.CDLL:
    """Return the library rcutils."""
    return ctypes.CDLL(library("librcutils.so"))


def share_arenas() -> None:
    """Let the threads that start from now on share one arena of glibc's allocator, beside the main one.

    Each of the middleware's threads would have its own, and keep the most that it ever needed for samples.
    The variable `MALLOC_ARENA_MAX` precedes. No-op with other C libraries.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None and "MALLOC_ARENA_MAX" not in os.environ:
        mallopt(_ARENA_MAX, 2)


def taken(result: int, what: str) -> bool:
    """Return True if a function has taken something, and False if nothing was waiting.

    Raises:
        Ros2Error: it has failed.
    """
    # A message that the middleware cannot read counts as nothing, and leaves an error; others may be waiting.
    if result in _NOTHING and not rcutils().rcutils_error_is_set():
        return False
    check(result, what)
    return True


def check(result: int, what: str) -> None:
    """Check what a function of rcl or the middleware has returned.

    Raises:
        Ros2Error: it has failed.
    """
    if result != 0:
        rcutils().rcutils_reset_error()
        raise Ros2Error(f"{what}: error {result} of ROS 2")


#: Sequence number of a middleware that has none.
NO_NUMBER: Final = 2**64 - 1


class RawSample(NamedTuple):
    """Sample as the middleware has received it.

    Attributes:
        number: sequence number at its publisher, from 1, or :data:`NO_NUMBER`.
        stamp_ns: time of publishing, nanoseconds since the epoch.
    """

    data: bytes
    gid: bytes
    number: int
    stamp_ns: int


#: `rmw_message_info_t`: time of publishing, number at the publisher, and GID.
_INFO: Final = struct.Struct(f"=q8xQ{MessageInfo.publisher_gid.offset + Gid.data.offset - 24}x{GID_BYTES}s")

#: Buffer and length of a `rcutils_uint8_array_t`.
_CONTENTS: Final = struct.Struct("PN")


def raw_take() -> Callable[[Any], RawSample | None]:
    """Return a function that takes the next sample of a subscription of `rclpy`; None if none is waiting.

    `rclpy` of Jazzy does not report the publisher of a sample.

    Its samples share one receive buffer, so it belongs to one thread.
    """
    take = rcl().rcl_take_serialized_message
    received, info = SerialisedMessage(), MessageInfo()
    # Fields of a ctypes structure are objects of their own, which cost more than the take itself.
    arguments = ctypes.byref(received), ctypes.byref(info)
    contents, details = memoryview(received).cast("B"), memoryview(info).cast("B")
    copy = ctypes.string_at

    def next_sample(subscription: Any) -> RawSample | None:
        result = take(subscription.pointer, *arguments, None)
        if result != 0:
            if result not in _NOTHING:
                check(result, f"cannot take a sample of {subscription.get_topic_name()}")
            return None
        stamp, number, gid = _INFO.unpack_from(details)
        return RawSample(copy(*_CONTENTS.unpack_from(contents)), gid, number, stamp)

    return next_sample
