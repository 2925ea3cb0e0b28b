"""Early look: the check whether a frame presses the emergency stop, ahead of all that waits.

A frame that has to wait may be the operator's stop, so it is looked at first. The look is a privilege,
because it runs ahead of turns, rates and quotas. Every gateway grants it by the same rules:

1. Only a client whose role may press the stop that way has looks. That is known before a frame is decoded.
2. A connection has at most one look per turn of the event loop.
3. A look that ends without a stopped robot is charged at once. The connection then has none for
   :data:`SUSPENDED_SECONDS`: a press meanwhile is an ordinary message. Neither the address nor the credential
   loses anything, since an attacker may share both with an operator.
4. A press with a look waits for nothing.
"""

from __future__ import annotations

import re
from enum import Enum, auto
from typing import TYPE_CHECKING, Final

from rwt_protocol.states import StateEnum

if TYPE_CHECKING:
    from rwt_transports.scheduler import Scheduler

MAX_STOP_BYTES: Final = 1024
"""Maximum size of a frame that is looked at, in bytes.

All connections may have a look in the same turn. A frame of CBOR of this size takes about 0.1 ms.
"""

SUSPENDED_SECONDS: Final = 1.0
"""Seconds without looks after one that ended without a stopped robot."""


#: Name of the stop in a frame; JSON may escape the slash. `/gate/stopped` is read often.
_find_name: Final = re.compile(rb"gate\\?/stop(?!ped)").search


def may_name_stop(data: bytes) -> bool:
    """Return True if a frame may be a call of the stop, or a message on it; decodes nothing.

    True only for frames with the name of the stop and that of an op, or a tool, that presses it. In JSON,
    CBOR and BSON these are bytes of the frame. A frame that spells them by other escapes is read in its turn.
    """
    return _find_name(data) is not None and (b"call_service" in data or b"publish" in data)


class Seen(Enum):
    """What an early look has found."""

    OTHER = auto()
    """The frame was not looked at, or is not for the stop: it is read in its turn."""
    REFUSED = auto()
    """The frame was for the stop and has been read, but the robot is not stopped."""
    PRESSED = auto()
    """The frame has stopped the robot."""


class LookState(StateEnum):
    """States of the early look of one connection, see :class:`EarlyLook`."""

    READY = "LOOKING"
    LOOKING = "USED", "SUSPENDED"
    USED = "READY"
    SUSPENDED = "READY"


class EarlyLook:
    """Early look of one connection.

    States::

        READY ──begin()──> LOOKING ──end(), stopped──> USED ── next turn ──> READY
                              └──end(), not stopped──> SUSPENDED ── 1 s ──> READY

    Args:
        turns: scheduler whose turns and clock count.
    """

    __slots__ = ("_over_at", "_state", "_turn", "_turns")

    def __init__(self, turns: Scheduler) -> None:
        self._turns = turns
        self._state = LookState.READY
        self._turn = 0
        self._over_at = 0.0  # Monotonic time at which a suspension ends.

    @property
    def state(self) -> LookState:
        """State of the look now."""
        if (self._state is LookState.USED and self._turns.turn != self._turn) or (
            self._state is LookState.SUSPENDED and self._turns.monotonic() >= self._over_at
        ):
            self._state = self._state.become(LookState.READY)
        return self._state

    def begin(self) -> bool:
        """Begin a look. Returns False if the connection has none now."""
        if self.state is not LookState.READY:
            return False
        self._state = self._state.become(LookState.LOOKING)
        return True

    def end(self, *, is_stopped: bool) -> None:
        """End the look.

        Args:
            is_stopped: True if the robot is stopped now.
        """
        if is_stopped:
            self._state = self._state.become(LookState.USED)
            self._turn = self._turns.turn
        else:
            self._state = self._state.become(LookState.SUSPENDED)
            self._over_at = self._turns.monotonic() + SUSPENDED_SECONDS
