"""A message's picture as a wish wants it. Imported by encoders only."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rwt_nodes.video.pixels import Bytes, read_compressed, read_raw, shaped
from rwt_nodes.video.topics import COMPRESSED

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload
    from rwt_nodes.video.wish import Wish


def read_picture(payload: Payload, wish: Wish) -> Bytes:
    """The picture in its size.

    Raises:
        PictureUnreadable: it cannot be shown.
    """
    message: Any = payload.value()
    compressed = payload.type.name == COMPRESSED
    return shaped(read_compressed(message) if compressed else read_raw(message), wish)


def stamp_ns(payload: Payload) -> int:
    """The time in the message's header, nanoseconds since 1970, however the distribution spells it."""
    message: Any = payload.value()
    stamp = message.header.stamp
    if hasattr(stamp, "sec"):
        return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
    return int(stamp.secs) * 1_000_000_000 + int(stamp.nsecs)
