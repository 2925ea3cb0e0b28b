"""Feed of messages from `/tf` and `/tf_static` into a buffer."""

from __future__ import annotations

import logging
from typing import Final

from rwt_tf2.buffer import Buffer
from rwt_tf2.errors import InvalidTransform, StaleTransform
from rwt_tf2.messages import Message, read_transform

logger = logging.getLogger(__name__)

STALE_IN_A_ROW: Final = 3
"""Number of consecutive messages with only outdated transforms that indicates a jump back in time."""

_MOST_REMEMBERED = 1000


class Feed:
    """Adds the transforms of messages to a buffer, and logs the first problem of each frame.

    When a recording or simulation restarts, time jumps back; the feed then clears moving transforms, like
    tf2. A single late publisher does not have that effect.

    Attributes:
        taken: number of transforms added.
        refused: number of rejected transforms.
    """

    def __init__(self, buffer: Buffer) -> None:
        self.buffer = buffer
        self.taken = 0
        self.refused = 0
        self._logged: set[str] = set()
        self._stale = 0

    def take(self, message: Message, *, static: bool = False) -> None:
        """Add the transforms of a `tf2_msgs/TFMessage` of `/tf` or `/tf_static`."""
        stale = [each for each in message.transforms if not self._put(each, static)]
        if not stale or len(stale) < len(message.transforms):
            self._stale = 0
            return
        self._stale += 1
        if self._stale >= STALE_IN_A_ROW:
            logger.warning("time jumped back: clearing the transform buffer; static transforms are kept")
            self._stale = 0
            self.buffer.clear()
            for each in stale:
                self._put(each, static)

    def _put(self, message: Message, static: bool) -> bool:
        """Add a transform. Returns False if it is only too old."""
        try:
            self.buffer.set_transform(read_transform(message), static=static)
        except InvalidTransform as error:
            self.refused += 1
            frame = message.child_frame_id
            if frame not in self._logged and len(self._logged) < _MOST_REMEMBERED:
                self._logged.add(frame)
                logger.warning("transform rejected: %s", error)
            return not isinstance(error, StaleTransform)
        self.taken += 1
        return True
