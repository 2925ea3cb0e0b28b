"""Accounts of clients for the parameters that they set.

A service that sets parameters for its caller runs with :data:`ACCOUNT` set to the caller's; tasks started
meanwhile inherit it.
"""

from __future__ import annotations

from contextvars import ContextVar
from typing import Final, Protocol


class Charge(Protocol):
    """Bytes charged to an account."""

    def end(self) -> None:
        """Release the bytes."""


class Account(Protocol):
    """Account of a client that sets parameters."""

    def charge(self, amount: int, replaced: Charge | None) -> Charge:
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
        self._by_name: dict[str, Charge] = {}

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
        """Release the charge of a value."""
        charge = self._by_name.pop(name, None)
        if charge is not None:
            charge.end()

    def drop_below(self, prefix: str) -> None:
        """Release the charges of all values whose names begin with `prefix`."""
        for name in [name for name in self._by_name if name.startswith(prefix)]:
            self.drop(name)
