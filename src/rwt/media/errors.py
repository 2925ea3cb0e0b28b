"""Errors of requests for images, and of images.

`VideoError`
    `RequestRefused`: the request is rejected; has the HTTP status
    `StreamEnded`: the server has ended the stream of a viewer
    `ImageUnreadable`: the image of a message cannot be decoded
"""

from __future__ import annotations


class VideoError(Exception):
    """Base of all errors of this package."""


class RequestRefused(VideoError):
    """A request for images is rejected.

    Attributes:
        status: HTTP status of the response; the text of the error is its body.
    """

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class StreamEnded(VideoError):
    """The server has ended a stream, for example in favour of another client; the text gives the reason."""


class ImageUnreadable(VideoError):
    """The image of a message cannot be decoded; the text gives the reason."""
