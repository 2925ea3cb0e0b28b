"""The time that a message says it is of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload


def stamp_ns(payload: Payload) -> int:
    """The time in the message's header, nanoseconds since 1970, however the distribution spells it."""
    message: Any = payload.value()
    stamp = message.header.stamp
    if hasattr(stamp, "sec"):
        return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
    return int(stamp.secs) * 1_000_000_000 + int(stamp.nsecs)
