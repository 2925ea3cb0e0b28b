"""Messages that other threads publish, on their way to the thread of a graph or of a connection."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

from rwt_participant.handles import QUEUE_BYTES

logger = logging.getLogger(__name__)

T = TypeVar("T")

OUTBOX_MESSAGES: Final = 1000
"""Maximum number of messages of one publisher that wait for the thread that sends them."""


class Outbox(Generic[T]):
    """Newest messages of one publisher, until the thread that sends them takes them.

    :meth:`put` never waits for that thread. While it is held by other work, the oldest messages beyond
    :data:`OUTBOX_MESSAGES` and :data:`~rwt_participant.handles.QUEUE_BYTES` are dropped.

    Args:
        topic: topic of the messages, for the log.
        send: sends one message; called in that thread.
        post: runs a function in that thread, soon and in order.

    Attributes:
        dropped: messages that were dropped for newer ones.
    """

    def __init__(
        self, topic: str, send: Callable[[T], object], post: Callable[[Callable[[], None]], object]
    ) -> None:
        self.dropped = 0
        self._topic = topic
        self._send = send
        self._post = post
        self._lock = threading.Lock()
        self._messages: deque[tuple[T, int]] = deque()
        self._bytes = 0
        # Posted calls of `_take`: one for each message, so that messages keep their order among other calls.
        self._posted = 0

    def put(self, message: T, size: int) -> None:
        """Queue a message of `size` bytes. Safe from any thread."""
        messages = self._messages
        with self._lock:
            before = self.dropped
            self._bytes += size
            while messages and (len(messages) >= OUTBOX_MESSAGES or self._bytes > QUEUE_BYTES):
                self._bytes -= messages.popleft()[1]
                self.dropped += 1
            messages.append((message, size))
            is_call_missing = self._posted < len(messages)
            self._posted += is_call_missing
            is_first_drop = before == 0 < self.dropped
        if is_first_drop:
            logger.warning(
                "messages of %s are dropped: the event loop does not send them in time; `dropped` of the"
                " publisher counts them",
                self._topic,
            )
        if is_call_missing:
            self._post(self._take)

    def _take(self) -> None:
        with self._lock:
            self._posted -= 1
            if not self._messages:
                return
            message, size = self._messages.popleft()
            self._bytes -= size
        self._send(message)
