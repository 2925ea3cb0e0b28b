"""What can be wrong with a request for images, and with images.

`VideoError`
    `RequestRefused`: the request cannot be answered; carries the HTTP status
    `ImageUnreadable`: a message that holds no image that can be shown
"""

from __future__ import annotations


class VideoError(Exception):
    """Base of all errors of this package."""


class RequestRefused(VideoError):
    """A request for images that cannot be answered.

    Attributes:
        status: the HTTP status to answer with; the error's text is the answer.
    """

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class ImageUnreadable(VideoError):
    """A message whose image cannot be shown; the text says why."""
