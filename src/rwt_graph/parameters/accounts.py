"""On whose account parameters are kept.

What sets a parameter for somebody else, as a service does for its caller, is run with :data:`ACCOUNT` set to
that one's. Tasks that are started then keep it.
"""

from __future__ import annotations

from contextvars import ContextVar
from typing import Final, Protocol


class Charge(Protocol):
    """Bytes that are kept on an account."""

    def end(self) -> None:
        """They are kept no more."""


class Account(Protocol):
    """Somebody on whose behalf parameters are set."""

    def charge(self, amount: int, replaced: Charge | None) -> Charge:
        """Keep so many bytes, in the place of those of an older charge if that is on this account too.

        Raises:
            ParameterRejected: they are more than may be kept on it.
        """


ACCOUNT: Final[ContextVar[Account | None]] = ContextVar("parameter account", default=None)
"""The account of who has a parameter set now; None where that is a program of the robot itself."""


class Charges:
    """What each of several values is charged to, by name."""

    __slots__ = ("_by_name",)

    def __init__(self) -> None:
        self._by_name: dict[str, Charge] = {}

    def put(self, name: str, amount: int) -> None:
        """Charge a value of so many bytes to who sets it now, instead of to who had set the one before.

        Raises:
            ParameterRejected: the account has no room; nothing has changed then.
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
        """A value is kept no more."""
        charge = self._by_name.pop(name, None)
        if charge is not None:
            charge.end()

    def drop_below(self, prefix: str) -> None:
        """All values whose names begin so are kept no more."""
        for name in [name for name in self._by_name if name.startswith(prefix)]:
            self.drop(name)
