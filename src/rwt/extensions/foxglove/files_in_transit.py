"""Memory of files that clients have requested, and have not read yet."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Final

from rwt_transports.shared_pool import Holder, PoolFull, PoolRow, Share, SharedPool

MAX_BYTES: Final = 64 * 1024 * 1024
"""Maximum size of a file that a client may fetch, in bytes."""

CAPACITY_BYTES: Final = 2 * MAX_BYTES
"""Maximum size of the files of all clients together, in bytes."""

GRACE_SECONDS: Final = 1.0
"""Seconds after which a client that waits may get the room of another."""

OVERDUE_SECONDS: Final = 10.0
"""Seconds that a client has to read a file while others wait, whatever it has."""

LOOK_SECONDS: Final = 0.02
"""Seconds between two looks for room."""

FILES: Final = PoolRow("files in transit", "", "bytes of files that are not read yet")


class FilesInTransit:
    """Files for all clients: a shared pool of :data:`CAPACITY_BYTES`, for which clients wait.

    The size of a file counts as :data:`MAX_BYTES` until it has been read from the disk. A client that has
    waited for :data:`GRACE_SECONDS` gets the room of one with more, which loses its connection.

    Args:
        sleep: sleeps for so many seconds.

    Attributes:
        pool: the pool.
        waiting: number of clients that wait.
    """

    def __init__(self, sleep: Callable[[float], Awaitable[None]]) -> None:
        self.pool = SharedPool(FILES, CAPACITY_BYTES)
        self.waiting = 0
        self._sleep = sleep

    async def enter(
        self, holder: Holder, cut: Callable[[str], None], is_wanted: Callable[[], bool]
    ) -> Share | None:
        """Wait until there is room for a file, and return the room; None if the file is not wanted any more.

        Args:
            cut: disconnects the client; called with the reason if another gets the room.
        """
        waited = 0.0
        self.waiting += 1
        try:
            while is_wanted():
                if waited >= GRACE_SECONDS or self.pool.used + MAX_BYTES <= CAPACITY_BYTES:
                    with suppress(PoolFull):
                        return self.pool.take(holder, cut, MAX_BYTES)
                await self._sleep(LOOK_SECONDS)
                waited += LOOK_SECONDS
            return None
        finally:
            self.waiting -= 1

    async def read(self, is_unread: Callable[[], bool], cut: Callable[[str], None]) -> None:
        """Wait until a client has read its file. While others wait, it has `OVERDUE_SECONDS`."""
        waited = 0.0
        while is_unread():
            if waited >= OVERDUE_SECONDS and self.waiting:
                cut("a file was not read while other clients wait for theirs: request it again")
                return
            await self._sleep(LOOK_SECONDS)
            waited += LOOK_SECONDS
