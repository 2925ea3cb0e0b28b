"""On whose account a program of the robot works on: what it is asked for stays charged until it is done.

A call is charged to its caller until it is answered, or nobody waits for it any more. A program may need the
request for longer: a coroutine that answers later, a goal that runs. It then holds the account, which it
finds in :data:`WORK_ACCOUNT` while it is asked, for as long as that takes.
"""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from typing import Final, Protocol

Release = Callable[[], None]
"""Gives back what was held; to be called once."""


class WorkAccount(Protocol):
    """Somebody on whose behalf a program of the robot is asked for something."""

    def hold(self, size: int) -> Release:
        """Keep what is asked for charged until it is released.

        Args:
            size: bytes that are kept, where what is asked for is not charged already.

        Raises:
            CallFailed: they are more than may be kept on the account.
        """


WORK_ACCOUNT: Final[ContextVar[WorkAccount | None]] = ContextVar("work account", default=None)
"""The account of who asks now; None where that is a program of the robot itself."""


def hold_for_asker(size: int) -> Release:
    """Keep what is asked for now charged to who asks, until it is released.

    Args:
        size: see :meth:`WorkAccount.hold`.

    Raises:
        CallFailed: see :meth:`WorkAccount.hold`.
    """
    account = WORK_ACCOUNT.get()
    return _nothing if account is None else account.hold(size)


def _nothing() -> None:
    """What is given back where nobody is charged."""
