"""Accounts of clients: a request is charged to its client until the robot's program is done with it.

A call is charged to its caller until it is answered or cancelled. A program that needs the request for longer
(a coroutine that answers later, a running goal) holds the account, which is in :data:`WORK_ACCOUNT` during
the callback.

A service that sets parameters for its caller runs with :data:`ACCOUNT` set to the caller's; tasks started
meanwhile inherit it.
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
        """Keep the request charged until it is released; see :func:`hold_for_asker`."""


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
    return (lambda: None) if account is None else account.hold(size)


class ParameterCharge(Protocol):
    """Bytes charged to an account."""

    def end(self) -> None:
        """Release the bytes."""


class Account(Protocol):
    """Account of a client that sets parameters."""

    def charge(self, amount: int, replaced: ParameterCharge | None) -> ParameterCharge:
        """Charge `amount` bytes, in place of an older charge if that is on this account too.

        Raises:
            ParameterRejected: the account has no room for that many bytes.
        """


ACCOUNT: Final[ContextVar[Account | None]] = ContextVar("parameter account", default=None)
"""Account that parameters are set for now; None for the robot's own programs."""


class Charges:
    """Charges of several values, by name."""

    __slots__ = ("_by_name",)

    def __init__(self) -> None:
        self._by_name: dict[str, ParameterCharge] = {}

    def put(self, name: str, amount: int) -> None:
        """Charge a value to the current account, and release the charge of the previous value.

        Raises:
            ParameterRejected: the account has no room; nothing has changed.
        """
        account = ACCOUNT.get()
        if account is None:
            self.drop(name)
        else:
            replaced = self._by_name.get(name)
            charge = account.charge(amount, replaced)
            if replaced is not None:
                replaced.end()
            self._by_name[name] = charge

    def drop(self, name: str) -> None:
        charge = self._by_name.pop(name, None)
        if charge is not None:
            charge.end()

    def drop_below(self, prefix: str) -> None:
        """Release the charges of all values whose names begin with `prefix`."""
        for name in [name for name in self._by_name if name.startswith(prefix)]:
            self.drop(name)
