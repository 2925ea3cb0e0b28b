"""From messages of `/tf` and `/tf_static` into a buffer, whatever comes."""

from __future__ import annotations

import logging
from typing import Final

from rwt_tf2.buffer import Buffer
from rwt_tf2.errors import InvalidTransform, StaleTransform
from rwt_tf2.messages import TransformMessage, TransformsMessage, read_transform

logger = logging.getLogger(__name__)

STALE_IN_A_ROW: Final = 3
"""So many messages with nothing but outdated transforms, one after the other, mean that time was set back."""

_MOST_REMEMBERED = 1000


class Feed:
    """Puts each transform of a message into a buffer, and says once a frame what is wrong with it.

    When a recording starts again, or a simulation, its times lie before what the buffer has: tf2 then forgets
    what moves, and so does this. A single late publisher is no reason to.

    Attributes:
        taken: transforms that went into the buffer.
        refused: transforms that did not.
    """

    def __init__(self, buffer: Buffer) -> None:
        self.buffer = buffer
        self.taken = 0
        self.refused = 0
        self._complained: set[str] = set()
        self._stale = 0

    def take(self, message: TransformsMessage, *, static: bool = False) -> None:
        """One message of `/tf`, or of `/tf_static`."""
        stale = [each for each in message.transforms if not self._put(each, static)]
        if not stale or len(stale) < len(message.transforms):
            self._stale = 0
            return
        self._stale += 1
        if self._stale >= STALE_IN_A_ROW:
            logger.warning("time was set back: what moves is forgotten")
            self._stale = 0
            self.buffer.clear()
            for each in stale:
                self._put(each, static)

    def _put(self, message: TransformMessage, static: bool) -> bool:
        """False for one that is only too old."""
        try:
            self.buffer.set_transform(read_transform(message), static=static)
        except InvalidTransform as error:
            self.refused += 1
            self._complain(message.child_frame_id, error)
            return not isinstance(error, StaleTransform)
        self.taken += 1
        return True

    def _complain(self, frame: str, error: InvalidTransform) -> None:
        if frame in self._complained or len(self._complained) >= _MOST_REMEMBERED:
            return
        self._complained.add(frame)
        logger.warning("a transform was left out: %s", error)
