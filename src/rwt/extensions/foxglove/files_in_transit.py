"""Memory of files that clients have requested, and have not read yet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from time import monotonic
from typing import Final

import anyio

from rwt_transports.http.addresses import network_of

MAX_BYTES: Final = 64 * 1024 * 1024
"""Maximum size of a file that a client may fetch, in bytes."""

CAPACITY_BYTES: Final = 2 * MAX_BYTES
"""Maximum size of the files of all clients together, in bytes."""

LOOK_SECONDS: Final = 1.0
"""Seconds after which a client that waits may get the room of another."""

OVERDUE_SECONDS: Final = 10.0
"""Seconds that a client has to read a file while others wait, whatever it has."""


class FileInTransit:
    """File for one client. Its size counts as :data:`MAX_BYTES` until it has been read from the disk.

    Args:
        address: address of the client; those of one network count as one.
        cut: disconnects the client; called with the reason if others need the room.
    """

    __slots__ = ("admitted", "cut", "network", "since", "size")

    def __init__(self, address: str, cut: Callable[[str], None]) -> None:
        self.network = network_of(address)
        self.cut = cut
        self.size = MAX_BYTES
        self.since = 0.0
        self.admitted = anyio.Event()


class FilesInTransit:
    """Files for all clients, within :data:`CAPACITY_BYTES`.

    Clients wait for room, those of the network with fewest bytes first. A network that has more than the
    one that waits would have is disconnected from its oldest file; so is a client that takes too long.
    """

    def __init__(self, now: Callable[[], float] = monotonic) -> None:
        self._now = now
        self._held: dict[FileInTransit, None] = {}
        self._waiting: dict[FileInTransit, None] = {}
        self._bytes: Counter[str] = Counter()
        self.used = 0

    async def enter(self, file: FileInTransit) -> None:
        """Wait until there is room for a file, or until it leaves."""
        self._waiting[file] = None
        self._admit()
        try:
            while file in self._waiting:
                with anyio.move_on_after(LOOK_SECONDS):
                    await file.admitted.wait()
                if file in self._waiting:
                    self._make_room(file)
        except BaseException:
            self.leave(file)
            raise

    def resize(self, file: FileInTransit, size: int) -> None:
        """Set the actual size of a file, once; no-op if it has left."""
        if file in self._held:
            self._add(file, size - file.size)
            file.size = size
            self._admit()

    def leave(self, file: FileInTransit) -> None:
        """Release the room of a file, or end its wait; idempotent."""
        if file in self._waiting:
            del self._waiting[file]
            file.admitted.set()
        elif file in self._held:
            del self._held[file]
            self._add(file, -file.size)
            self._admit()

    def _add(self, file: FileInTransit, size: int) -> None:
        self.used += size
        self._bytes[file.network] += size
        if not self._bytes[file.network]:
            del self._bytes[file.network]

    def _admit(self) -> None:
        while self._waiting and self.used + MAX_BYTES <= CAPACITY_BYTES:
            file = min(self._waiting, key=lambda each: self._bytes[each.network])
            del self._waiting[file]
            self._held[file] = None
            file.since = self._now()
            self._add(file, file.size)
            file.admitted.set()

    def _make_room(self, asker: FileInTransit) -> None:
        """Disconnect a client from its file, if the one who asks has less, or if it takes too long."""
        largest = max(self._bytes, key=self._bytes.__getitem__, default="")
        oldest = next((each for each in self._held if each.network == largest), None)
        has_less = self._bytes[asker.network] + MAX_BYTES < self._bytes[largest]
        if oldest is None or not (has_less and self._now() - oldest.since >= LOOK_SECONDS):
            late = self._now() - OVERDUE_SECONDS
            oldest = next((each for each in self._held if each.since <= late), None)
        if oldest is not None:
            self.leave(oldest)
            oldest.cut("a file was not read while other clients wait for theirs: request it again")
