"""Taking of serialised samples by rcl itself: `rclpy` of Jazzy does not report the publisher of a sample."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from rwt_graph.errors import Ros2Error
from rwt_graph.ros2.ament import library

if TYPE_CHECKING:
    from collections.abc import Callable

#: Bytes of a publisher's GID: those that ROS 2 compares, of up to 24 that a middleware stores.
GID_BYTES: Final = 16

#: Sequence number of a middleware that has none.
NO_NUMBER: Final = 2**64 - 1

#: RCL_RET_SUBSCRIPTION_TAKE_FAILED: no sample is waiting.
_NOTHING: Final = 401


class Gid(ctypes.Structure):
    """`rmw_gid_t`."""

    _fields_ = (("implementation", ctypes.c_char_p), ("data", ctypes.c_uint8 * 24))


class _Info(ctypes.Structure):
    """`rmw_message_info_t`."""

    _fields_ = (
        ("source_timestamp", ctypes.c_int64),
        ("received_timestamp", ctypes.c_int64),
        ("publication_sequence_number", ctypes.c_uint64),
        ("reception_sequence_number", ctypes.c_uint64),
        ("publisher_gid", Gid),
        ("from_intra_process", ctypes.c_bool),
    )


class _Allocator(ctypes.Structure):
    """`rcutils_allocator_t`."""

    _fields_ = tuple(
        (name, ctypes.c_void_p) for name in ("allocate", "deallocate", "reallocate", "zero_allocate", "state")
    )


class _Bytes(ctypes.Structure):
    """`rcutils_uint8_array_t`."""

    _fields_ = (
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    )


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


def raw_take() -> Callable[[Any], RawSample | None]:
    """Return a function that takes the next sample of a subscription of `rclpy`; None if none is waiting.

    Its samples share one receive buffer, so it belongs to one thread.
    """
    take = ctypes.CDLL(library("librcl.so")).rcl_take_serialized_message
    take.argtypes = (ctypes.c_void_p,) * 4
    default = ctypes.CDLL(library("librcutils.so")).rcutils_get_default_allocator
    default.restype = _Allocator
    received = _Bytes(None, 0, 0, default())
    info = _Info()

    def next_sample(subscription: Any) -> RawSample | None:
        result = take(subscription.pointer, ctypes.byref(received), ctypes.byref(info), None)
        if result == _NOTHING:
            return None
        if result != 0:
            raise Ros2Error(f"a sample of {subscription.get_topic_name()} cannot be taken: error {result}")
        return RawSample(
            ctypes.string_at(received.buffer, received.length),
            bytes(info.publisher_gid.data)[:GID_BYTES],
            info.publication_sequence_number,
            info.source_timestamp,
        )

    return next_sample
