"""Taking of serialised samples by rcl itself: `rclpy` of Jazzy does not report the publisher of a sample."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from rwt_graph.ros2.rcl import GID_BYTES, MessageInfo, SerialisedMessage, rcl, taken

if TYPE_CHECKING:
    from collections.abc import Callable

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


def raw_take() -> Callable[[Any], RawSample | None]:
    """Return a function that takes the next sample of a subscription of `rclpy`; None if none is waiting.

    Its samples share one receive buffer, so it belongs to one thread.
    """
    take = rcl().rcl_take_serialized_message
    received, info = SerialisedMessage(), MessageInfo()

    def next_sample(subscription: Any) -> RawSample | None:
        result = take(subscription.pointer, ctypes.byref(received), ctypes.byref(info), None)
        if result != 0 and not taken(result, f"cannot take a sample of {subscription.get_topic_name()}"):
            return None
        return RawSample(
            received.contents(),
            bytes(info.publisher_gid.data)[:GID_BYTES],
            info.publication_sequence_number,
            info.source_timestamp,
        )

    return next_sample
