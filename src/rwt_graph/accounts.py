"""Accounts of clients: a request is charged to its client until the robot's program is done with it.

A call is charged to its caller until it is answered or cancelled. A program that needs the request for longer
(a coroutine that answers later, a running goal) holds the account, which is in :data:`WORK_ACCOUNT` during
the callback.

A service that sets parameters for its caller runs with :data:`ACCOUNT` set to the caller's; tasks started
meanwhile inherit it.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from contextvars import ContextVar
from typing import Final, Protocol

Release = Callable[[], None]
"""Releases a charge; call it once."""


Hold = Callable[[int], Release]
"""Keeps the request of a client charged to it until it is released; see :func:`hold_for_asker`."""

ASKER: Final[ContextVar[Hashable]] = ContextVar("asker", default=None)
"""Client whose call or goal is handled now, by which shared pools count; None for the robot's own programs.

Tasks started meanwhile inherit it.
"""

WORK_ACCOUNT: Final[ContextVar[Hold | None]] = ContextVar("work account", default=None)
"""Account of the client whose request is handled now; None for requests of the robot's own programs."""


def hold_for_asker(size: int) -> Release:
    """Keep the request that is handled now charged to its client, until the returned function is called.

    For handlers that keep a request after their callback has returned.

    Args:
        size: bytes to charge; 0 for a request that is charged already.

    Raises:
        CallFailed: the account has no room for that many bytes.
    """
    hold = WORK_ACCOUNT.get()
    return (lambda: None) if hold is None else hold(size)


class OpenCharge(Protocol):
    """Amount that is charged to a client until it is ended."""

    def end(self) -> None:
        """End the charge; no-op after the first call."""


ChargeBytes = Callable[[int, OpenCharge | None], OpenCharge]
"""Charges bytes to a client that sets parameters, in place of an older charge if that is on its account, too.

Raises ParameterRejected if the account has no room for them.
"""

ACCOUNT: Final[ContextVar[ChargeBytes | None]] = ContextVar("parameter account", default=None)
"""Account that parameters are set for now; None for the robot's own programs."""


class Charges:
    """Charges of several values, by name."""

    __slots__ = ("_by_name",)

    def __init__(self) -> None:
        self._by_name: dict[str, OpenCharge] = {}

    def put(self, name: str, amount: int) -> None:
        """Charge a value to the current account, and release the charge of the previous value.

        Raises:
            ParameterRejected: the account has no room; nothing has changed.
        """
        charge_bytes = ACCOUNT.get()
        if charge_bytes is None:
            self.drop(name)
        else:
            replaced = self._by_name.get(name)
            charge = charge_bytes(amount, replaced)
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
