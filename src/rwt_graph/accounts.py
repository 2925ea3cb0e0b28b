"""Accounts of clients: a request is charged to its client until the robot's program is done with it.

A call is charged to its caller until it is answered or cancelled. A program that needs the request for longer
(a coroutine that answers later, a running goal) holds the account, which is in :data:`WORK_ACCOUNT` during
the callback.
"""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from typing import Final, Protocol

Release = Callable[[], None]
"""Releases a charge; call it once."""


class WorkAccount(Protocol):
    """Account of the client whose request a program of the robot handles."""

    def hold(self, size: int) -> Release:
        """Keep the request charged until it is released.

        Args:
            size: bytes to charge; 0 for a request that is charged already.

        Raises:
            CallFailed: the account has no room for that many bytes.
        """


WORK_ACCOUNT: Final[ContextVar[WorkAccount | None]] = ContextVar("work account", default=None)
"""Account of the client whose request is handled now; None for requests of the robot's own programs."""


def hold_for_asker(size: int) -> Release:
    """Keep the request that is handled now charged to its client, until the returned function is called.

    For handlers that keep a request after their callback has returned.

    Args:
        size: bytes to charge; 0 for a request that is charged already.

    Raises:
        CallFailed: the account has no room for that many bytes.
    """
    account = WORK_ACCOUNT.get()
    return _nothing if account is None else account.hold(size)


def _nothing() -> None:
    """No-op release of a request that is not charged."""
