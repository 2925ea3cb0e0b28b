"""Read-ahead of a recording in a thread, off the event loop."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Iterator
from typing import Final

from rwt.extensions.recording.recording import RecordedMessage

logger = logging.getLogger(__name__)

AHEAD_MESSAGES: Final = 4096
AHEAD_BYTES: Final = 32 * 1024 * 1024


class ReadAhead:
    """Bounded queue of the messages of an iterator, filled by a thread.

    Attributes:
        failure: error that ended reading; empty if there was none.

    Args:
        messages: iterator to read; only the thread uses it, and closes it.
    """

    def __init__(self, messages: Iterator[RecordedMessage]) -> None:
        self._messages = messages
        self._ready: deque[RecordedMessage] = deque()
        self._bytes = 0
        self._ended = False
        self._closed = False
        self.failure = ""
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._read, name="read-ahead", daemon=True)
        self._thread.start()

    def next(self) -> RecordedMessage | None:
        """Return the next message, waiting for the disk if necessary; None at the end."""
        with self._changed:
            while not self._ready:
                if self._ended:
                    return None
                self._changed.wait()
            message = self._ready.popleft()
            self._bytes -= len(message.data)
            if len(self._ready) == AHEAD_MESSAGES // 2 or not self._ready:
                self._changed.notify()
            return message

    def close(self) -> None:
        """Stop reading."""
        with self._changed:
            self._closed = True
            self._ended = True
            self._ready.clear()
            self._changed.notify()
        self._thread.join()

    def _read(self) -> None:
        try:
            for message in self._messages:
                if not self._put(message):
                    break
        except Exception as error:
            # Play everything read so far: a file may be damaged anywhere, in any way.
            self.failure = str(error) or type(error).__name__
            logger.warning("the recording cannot be read any further: %s", self.failure)
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify()

    def _put(self, message: RecordedMessage) -> bool:
        """Add a message once there is room. Returns False after :meth:`close`."""
        with self._changed:
            while (len(self._ready) >= AHEAD_MESSAGES or self._bytes >= AHEAD_BYTES) and not self._closed:
                self._changed.wait()
            if self._closed:
                return False
            self._ready.append(message)
            self._bytes += len(message.data)
            self._changed.notify()
            return True
