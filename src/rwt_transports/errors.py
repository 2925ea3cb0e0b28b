"""Errors of the transports."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Mapping
from typing import Literal, TypeAlias

logger = logging.getLogger("rwt_transports")


class TransportError(Exception):
    """Base of all errors of this package. The text is one line and states the remedy."""


class BadUrl(TransportError):
    """The URL is invalid, or its scheme is not supported."""


class ListenError(TransportError):
    """The address could not be opened: it is in use, not of this machine, or not permitted."""


ConnectCause: TypeAlias = Literal[
    "refused", "unknown_host", "tls", "expired", "no_tls", "no_websocket", "hung_up", "permission",
    "unauthorized", "forbidden", "no_path", "other",
]  # fmt: skip
"""Cause of a failure to connect.

`no_tls`: the server does not use TLS; `no_websocket`: an HTTP server answers, and does not upgrade;
`no_path`: no pair of ICE candidates works.
"""


class ConnectError(TransportError):
    """No server responds at the address, or it refuses the connection.

    Attributes:
        cause: category of the failure, for programs that give advice.
    """

    def __init__(self, text: str, cause: ConnectCause = "other") -> None:
        super().__init__(text)
        self.cause = cause

    @staticmethod
    def cause_of(status: int) -> ConnectCause:
        """Return the cause for an HTTP status other than success."""
        if status in (401, 403):
            return "unauthorized" if status == 401 else "forbidden"
        return "no_websocket" if status < 429 or status in (501, 502) else "other"


class Refused(TransportError):
    """Raised by an accept function to reject a peer before its connection opens.

    Attributes:
        status: HTTP status of the response (4xx or 5xx), for transports that have one.
        reason: one line for the peer.
        headers: further headers of the response.
    """

    def __init__(self, status: int, reason: str, headers: Mapping[str, str] | None = None) -> None:
        super().__init__(reason)
        self.status = status
        self.reason = reason
        self.headers: Mapping[str, str] = headers or {}


def log_exception(text: str, *parts: object) -> None:
    """Log the current exception without raising another.

    A failing log handler (disk full, server away) must not affect connections or the listener; its record is
    lost.
    """
    with contextlib.suppress(Exception):
        logger.exception(text, *parts)
