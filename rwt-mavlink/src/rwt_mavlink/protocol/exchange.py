"""Messages between this station and one vehicle, as the protocols use them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import anyio

from rwt_mavlink.link.frames import MavlinkMessage
from rwt_mavlink.protocol.errors import VehicleError
from rwt_participant.timers import RobotClock

#: Messages that an inbox keeps; older ones are dropped, as if the link had lost them.
_INBOX_MESSAGES: Final = 4096
#: Key of inboxes that take messages of any type with the time since the vehicle's start.
_ANY_BOOT_TIME: Final = "*"


@dataclass(frozen=True, slots=True)
class Identity:
    """Sender or receiver of messages.

    Attributes:
        system: system id.
        component: component id.
    """

    system: int
    component: int


class Inbox:
    """Messages of some types, from the beginning to the end of a block.

    Args:
        clock: clock of timeouts.
        accepts: returns True for a message to keep.
    """

    def __init__(self, clock: RobotClock, accepts: Callable[[MavlinkMessage], bool]) -> None:
        self._clock = clock
        self._accepts = accepts
        self._messages: deque[MavlinkMessage] = deque(maxlen=_INBOX_MESSAGES)
        self._error: VehicleError | None = None
        self._wake = anyio.Event()

    def put(self, message: MavlinkMessage) -> None:
        """Add a message, unless it is not accepted."""
        if self._accepts(message):
            self._messages.append(message)
            self._wake.set()

    def fail(self, error: VehicleError) -> None:
        """End the exchange: :meth:`get` raises the error."""
        self._error = error
        self._wake.set()

    async def get(self, seconds: float) -> MavlinkMessage | None:
        """Return the next message; None if there is none in time.

        Raises:
            VehicleError: the exchange was ended.
        """
        with self._clock.within(seconds):
            while not self._messages and self._error is None:
                self._wake = anyio.Event()
                await self._wake.wait()
        if self._error is not None:
            raise self._error
        return self._messages.popleft() if self._messages else None


class Exchange:
    """Messages to and from one vehicle.

    Args:
        clock: clock of timeouts.
        own: identity of this station.
        target: identity of the vehicle's autopilot.
        send: sends a message to the vehicle.
        check: raises :exc:`Unavailable` while the vehicle cannot be commanded.

    Attributes:
        clock: clock of timeouts.
        target: identity of the vehicle's autopilot.
        send: sends a message to the vehicle.
        check: raises :exc:`Unavailable` while the vehicle cannot be commanded.
    """

    def __init__(
        self,
        clock: RobotClock,
        own: Identity,
        target: Identity,
        send: Callable[[MavlinkMessage], None],
        check: Callable[[], None],
    ) -> None:
        self.clock = clock
        self.target = target
        self.send = send
        self.check = check
        self._own = own
        self._inboxes: dict[str, list[Inbox]] = {}
        self._has_boot_times = False

    def is_for_us(self, message: MavlinkMessage) -> bool:
        """Return True if a message is addressed to this station, or to everyone."""
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self._own.system) and component in (0, self._own.component)

    @contextmanager
    def listening(
        self, *types: str, where: Callable[[MavlinkMessage], bool] = lambda message: True
    ) -> Iterator[Inbox]:
        """Receive messages of some types that are for this station within the block."""
        inbox = Inbox(self.clock, lambda message: self.is_for_us(message) and where(message))
        for type in types:
            self._inboxes.setdefault(type, []).append(inbox)
        try:
            yield inbox
        finally:
            for type in types:
                self._inboxes[type].remove(inbox)

    async def is_running(self, seconds: float) -> bool:
        """Wait until the vehicle shows that it has not restarted; returns False if it does not in time.

        Its messages have the time since its start. Vehicles that never sent it are taken to be running.

        Raises:
            VehicleError: it has restarted, or its link is lost.
        """
        if not self._has_boot_times:
            return True
        with self.listening(_ANY_BOOT_TIME) as inbox:
            return await inbox.get(seconds) is not None

    def deliver(self, message: MavlinkMessage) -> None:
        """Pass a message of the vehicle to the exchanges that wait for its type."""
        types = [message.get_type()]
        if getattr(message, "time_boot_ms", 0):
            self._has_boot_times = True
            types.append(_ANY_BOOT_TIME)
        for type in types:
            for inbox in tuple(self._inboxes.get(type, ())):
                inbox.put(message)

    def interrupt(self, error: VehicleError) -> None:
        """End all running exchanges with an error."""
        for inbox in {inbox for each in self._inboxes.values() for inbox in each}:
            inbox.fail(error)
