"""Point clouds that arrive in compact form."""

from __future__ import annotations

import time
from typing import Any, Final

from rwt_client.wire.decoding import MessageReader, UnparsedMessage
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.payload import Payload
from rwt_interfaces.point_clouds.errors import InvalidCloud
from rwt_participant.messages import Message

_MARK: Final = "compressed_data"
"""Member of a compact cloud, which a whole one has not."""


class CloudReader:
    """Reader of a topic of clouds: as the server sends them, whole or compact.

    Args:
        whole, compact: readers of both forms.
    """

    def __init__(self, whole: MessageReader, compact: MessageReader) -> None:
        self._whole = whole
        self._compact = compact

    def read(self, arrived: UnparsedMessage) -> Message:
        """Decode a message. Raises InvalidMessage."""
        if not _is_compact(arrived):
            return self._whole.read(arrived)
        from rwt_interfaces.point_clouds.compressed import decompress  # optional import: zstandard

        found: Any = self._compact.read(arrived)
        try:
            cloud = decompress(found)
        except InvalidCloud as error:
            raise InvalidMessage(_MARK, str(error)) from None
        return self._whole.finish(Payload.from_value(self._whole.type, cloud, time.time_ns).value())


def _is_compact(arrived: UnparsedMessage) -> bool:
    if isinstance(arrived, dict):
        return _MARK in arrived
    text = arrived[0] if isinstance(arrived, tuple) else arrived.json()
    return _MARK.encode() in text
