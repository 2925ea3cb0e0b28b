"""A message's picture as a request wants it. Imported by encoders only."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rwt_nodes.video.encoders.pixels import Bytes, read_compressed, read_raw, shaped
from rwt_nodes.video.topics import COMPRESSED

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload
    from rwt_nodes.video.stream_request import StreamRequest


def read_picture(payload: Payload, request: StreamRequest) -> Bytes:
    """The picture in its size.

    Raises:
        PictureUnreadable: it cannot be shown.
    """
    message: Any = payload.value()
    compressed = payload.type.name == COMPRESSED
    return shaped(read_compressed(message) if compressed else read_raw(message), request)
