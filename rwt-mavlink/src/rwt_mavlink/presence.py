"""Presence of a vehicle on its link: heard, lost, restarted, or two with the same id. No I/O."""

from __future__ import annotations

from collections import deque
from typing import Final

from rwt_mavlink.link.frames import MavlinkMessage
from rwt_mavlink.link.links import Source
from rwt_protocol.states import StateEnum

#: Time for which a clash is reported after its last sign.
CLASH_SECONDS: Final = 10.0

#: Another source within this time after its previous heartbeat is a second vehicle, not a moved one.
_MOVE_SECONDS: Final = 3.0
#: Boot times may arrive late by so much.
_LATE_MS: Final = 1000
_WRAP_MS: Final = 2**32
#: Restarts within CLASH_SECONDS that are two vehicles, whose boot times alternate.
_RESTARTS: Final = 3


class LinkState(StateEnum):
    """State of the link to a vehicle."""

    SILENT = "CONNECTED"
    CONNECTED = "CONNECTED", "LOST"
    LOST = "CONNECTED"


class Presence:
    """Signs of one vehicle's presence.

    Args:
        timeout: seconds without a message after which the link is lost.

    Attributes:
        state: state of the link.
        source: source to which messages for the vehicle are sent; None before the first heartbeat.
        heard_at: time of the last message.
    """

    def __init__(self, timeout: float) -> None:
        self.state = LinkState.SILENT
        self.source: Source | None = None
        self.heard_at = 0.0
        self._timeout = timeout
        self._sources: dict[Source, float] = {}
        self._boot_ms: int | None = None
        self._started_at = 0.0
        self._restarts: deque[float] = deque(maxlen=_RESTARTS)
        self._clash_until = 0.0

    def on_heartbeat(self, source: Source, now: float) -> bool:
        """Note a heartbeat; returns True if the link was not connected before."""
        earlier = self._sources.get(source)
        self._sources = {each: at for each, at in self._sources.items() if now - at < _MOVE_SECONDS}
        if source != self.source and earlier is not None and now - earlier < _MOVE_SECONDS:
            self._clash_until = now + CLASH_SECONDS  # Another one was heard between two of this source.
        self._sources[source] = now
        self.source = source
        self.heard_at = now
        is_new = self.state is not LinkState.CONNECTED
        self.state = self.state.become(LinkState.CONNECTED)
        return is_new

    def on_message(self, message: MavlinkMessage, now: float) -> bool:
        """Note the boot time in a message; returns True if the vehicle has restarted."""
        self.heard_at = now
        boot_ms: int | None = getattr(message, "time_boot_ms", None)
        if not boot_ms:
            return False
        started_at = now - boot_ms / 1000
        before, self._boot_ms = self._boot_ms, boot_ms
        earlier, self._started_at = self._started_at, started_at
        if before is None:
            return False
        if (boot_ms - before) % _WRAP_MS < _WRAP_MS // 2:
            # The messages after a restart may be lost until its time is later than the last that was heard.
            return abs(started_at - earlier) % (_WRAP_MS / 1000) > _LATE_MS / 1000 and started_at > earlier
        if (before - boot_ms) % _WRAP_MS <= _LATE_MS and abs(started_at - earlier) <= _LATE_MS / 1000:
            self._boot_ms, self._started_at = before, earlier
            return False
        self._restarts.append(now)
        if len(self._restarts) == _RESTARTS and now - self._restarts[0] < CLASH_SECONDS:
            self._clash_until = now + CLASH_SECONDS
        return True

    def check(self, now: float) -> bool:
        """Note the time; returns True if the link has just been lost."""
        if self.state is not LinkState.CONNECTED or now - self.heard_at < self._timeout:
            return False
        self.state = self.state.become(LinkState.LOST)
        return True

    def has_clash(self, now: float) -> bool:
        """Return True if two vehicles use the same id."""
        return now < self._clash_until
