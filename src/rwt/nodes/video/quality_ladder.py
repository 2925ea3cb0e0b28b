"""Quality ladder: selects the quality of single images for a viewer by how long they are under way."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from rwt.media.stream_request import Jpeg, StreamRequest

RUNGS: Final = (Jpeg(), Jpeg(60), Jpeg(40, 0.75), Jpeg(25, 0.5), Jpeg(15, 0.5))
"""Images for slower and slower connections. Viewers on the same rung share an encoder."""
SLOW_SECONDS: Final = 0.2
"""Delivery time of an image above which smaller ones are sent."""
VERY_SLOW_SECONDS: Final = 0.6
FAST_SECONDS: Final = 0.07
"""Delivery time below which larger ones are tried."""
PATIENCE_SECONDS: Final = 4.0
"""Time of fast deliveries before that."""
MAX_PATIENCE_SECONDS: Final = 32.0


class QualityLadder:
    """Quality ladder of one viewer.

    Args:
        request: request of the viewer. A quality or size that it names is kept, and so are messages that it
            wants unchanged.
        now: time in seconds of a steady clock.

    Attributes:
        rung: index of the present request.
    """

    def __init__(self, request: StreamRequest, now: float) -> None:
        is_free = (
            request.coding == Jpeg()
            and request.width is None
            and request.height is None
            and not request.prefers_compressed
        )
        self._requests = tuple(replace(request, coding=each) for each in RUNGS) if is_free else (request,)
        self.rung = 0
        self._fast_since = now
        self._raised_at: float | None = None
        self._patience = PATIENCE_SECONDS

    @property
    def request(self) -> StreamRequest:
        """Present request."""
        return self._requests[self.rung]

    def delivered(self, seconds: float, now: float) -> None:
        """Handle the delivery time of an image."""
        if seconds > SLOW_SECONDS:
            if self._raised_at is not None and now - self._raised_at < self._patience:
                self._patience = min(2 * self._patience, MAX_PATIENCE_SECONDS)
            self._raised_at = None
            step = 2 if seconds > VERY_SLOW_SECONDS else 1
            self.rung = min(self.rung + step, len(self._requests) - 1)
            self._fast_since = now
        elif seconds > FAST_SECONDS:
            self._fast_since = now
        elif self.rung and now - self._fast_since >= self._patience:
            if self._raised_at is not None:
                self._patience = PATIENCE_SECONDS  # The last step up lasted.
            self.rung -= 1
            self._fast_since = self._raised_at = now
